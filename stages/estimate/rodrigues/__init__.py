"""The inertial-frame matching of the IDAM paper with a Rodrigues vector (34)-(78), corrected by its errata.

i_m and i_s are the bodies of the two units at the start, kept inertially fixed; ``C = C_im^is`` is constant and
``C = (I + [l x])^-1 (I - [l x])`` (67). With A_m, A_s the attitudes integrated by the units' own gyros, V their
integrated specific force (the main one's moved to the sub-IMU over the rigid lever arm r) and W their rates, all in
their inertial frames::

    [V_s - V_m]   [V_s + V_m]                      [dV               ]                [V_r       ]
    [W_s - W_m] = [W_s + W_m] x l  +  (I + [l x])  [W_s x phi + A_s eps]  + (I - [l x]) [A_m theta'] + noise      (78)

    l'  = 0                                 dV'  = f_s x phi + A_s (nabla + w_a)
    phi' = -A_s (eps + w_g)                 eps' = nabla' = 0
    V_r' = A_m (A_r1 theta + A_r2 theta' + L_0 w_f)
    theta'' = -b^2 theta - 2 mu theta' + w_f,    PSD of w_f  4 mu b^2 sigma^2                                (74)-(77)

What is reported is the total angle ``R_m_s = A_m^T C^T Exp(phi) A_s``: theta and l share a constant that only long
records part. Only the difference of the two units' errors is observable: eps is R eps_s - eps_m, nabla likewise.
"""
