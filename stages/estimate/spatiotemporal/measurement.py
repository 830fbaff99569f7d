"""The attitude match of TD-MA, (18)-(26).

    M = C_b2^b0 C_b2^i2 C_b0^b2 C_i1^b1 = A_m Exp(z) A_m^T,   Z = Log M = A_m z

As printed Z holds single elements of M: M_32, -M_31, and M_32 again where -M_12 is meant.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from schemas.rig import FloatArray
from stages.paired import Observations


def measured(obs: Observations, as_printed: bool) -> FloatArray:
    """(N, 3) rad, the match in m-axes: exact, or from the printed elements (20)-(22) of M."""
    if not as_printed:
        return obs.z
    z = np.full_like(obs.z, np.nan)
    seen = np.isfinite(obs.z[:, 0])
    A_m = obs.A_end[seen]
    M = A_m @ Rotation.from_rotvec(obs.z[seen]).as_matrix() @ np.swapaxes(A_m, 1, 2)
    z[seen] = np.einsum("kji,kj->ki", A_m, printed_elements(M))
    return z


def printed_elements(M: FloatArray) -> FloatArray:
    """(N, 3) Z = [M_32, -M_31, -Z(3)] with Z(3) = M_32 as printed in (22)."""
    return np.stack([M[:, 2, 1], -M[:, 2, 0], -M[:, 2, 1]], axis=1)
