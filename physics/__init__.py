"""Frames, symbols and units: the one page that states them.

Axes
    hull (body)  x starboard, y bow, z up, right-handed. Every body frame of the project after decoding.
    m            body of the main IMU. ``s``: body of the sub-IMU. ``p``: body of a PHINS.
    n            local-level ENU: x east, y north, z up.
    i            inertial; at the start of a record it coincides with m (``A_m(0) = I``) unless said otherwise.
    deck         hull axes with the origin at the deck's reference point.

Symbols
    R_a_b        (3, 3) maps b-coordinates into a-coordinates: ``v_a = R_a_b v_b``.
    omega_im_m   rate of m against i, resolved in m (rad/s).
    f_m          specific force (m/s^2), +g on z at rest.
    Phi, theta   static angle and dynamic flexure, rotation vectors in m-axes: ``R_m_s = Exp(theta) Exp(Phi)``.
    phi          total angle Log(R_m_s).
    r            lever arm main -> sub, m-axes, metres.
    delay        > 0: a sub-IMU sample stamped t was measured at t - delay.

Errors: ``e = Log(R_est R_ref^T)``, m-axes. Euler names: pitch about x, roll about y, heading about z
(``R_n_b = Rz(heading) Rx(pitch) Ry(roll)``), heading counter-clockwise from north.

Inside the code: SI and radians, quaternions x, y, z, w. People see arcminutes, deg/h, deg/sqrt(h), micro-g.
A gyro or accelerometer sample is the mean over the interval that ends at its stamp.
"""
