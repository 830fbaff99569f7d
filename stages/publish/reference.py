"""What a reference said at the scored stamps: ``R_ref = Exp(e)^T R_est`` from the error that scoring found."""

from __future__ import annotations

import numpy as np

from physics import quaternions
from schemas.products import Deformation, Score
from schemas.rig import FloatArray
from schemas.trial import IntArray


def reference_angles(deformation: Deformation, score: Score, every: int = 1) -> tuple[IntArray, FloatArray]:
    """Stamps (k,) ns and total angle (k, 3) rad of the reference, at every so many of the scored samples."""
    stamp, error = score.stamp[::every], score.error[::every]
    estimate = deformation.total[np.searchsorted(deformation.stamp, stamp)]
    return stamp, quaternions.log(quaternions.multiply(quaternions.exp(-error), quaternions.exp(estimate)))
