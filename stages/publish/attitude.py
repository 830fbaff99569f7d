"""Attitude of the deck at the sub-IMU: ``R_n_s = R_n_m R_m_s``, or ``R_m(t0)_s`` where no attitude of m is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from physics import quaternions, rotations
from physics.interpolation import GAP_FACTOR, usual_interval
from schemas import scratch
from schemas.installation import main_installation
from schemas.products import Deformation
from schemas.rig import FloatArray
from schemas.trial import ImuSeries, IntArray, Trial
from stages.attitudes import Attitudes, attitudes, attitudes_of, gathered
from stages.slabs import rows, slabs

ENU = "enu"
START = "imu_main_start"


@dataclass(frozen=True)
class DeckAttitude:
    """stamp: (k,) ns. quaternion: (k, 4) x, y, z, w, s into frame. frame: "enu", or "imu_main_start" (see below)."""

    stamp: IntArray
    quaternion: FloatArray
    frame: str


def deck_attitude(deformation: Deformation, trial: Trial) -> DeckAttitude:
    """Attitude of s at the stamps of an estimate.

    In ENU where the log knows the attitude of m (its own, or a PHINS with known installation ``R_m_p``:
    ``R_n_m = R_n_p R_m_p^T``); stamps in a gap of that attitude are left out. Without any, in the frame
    ``imu_main_start``: fixed in inertial space, m at the first stamp, carried on by the main gyro.
    """
    known = _attitude_of_main(deformation, trial)
    frame, of_main = (ENU, known) if known is not None else (START, _gyro_attitude(deformation, trial.main))
    q_f_s, valid = gathered(of_main.at, deformation.stamp)
    stamp, total = rows(deformation.stamp, valid), rows(deformation.total, valid)
    for part in slabs(len(stamp)):
        q_f_s[part] = quaternions.multiply(q_f_s[part], quaternions.exp(total[part]))
        scratch.release(q_f_s, total)
    return DeckAttitude(stamp, q_f_s, frame)


def _attitude_of_main(deformation: Deformation, trial: Trial) -> Attitudes | None:
    """``R_n_m``; None where the log has none."""
    own = attitudes_of(trial.main)
    mount = main_installation(trial.rig, deformation.alignment)
    if own is not None or mount is None:
        return own
    m_p = quaternions.exp(rotations.log(mount[0]))
    return attitudes_of(trial.phins_main, lambda q: quaternions.multiply(q, quaternions.conjugate(m_p)))


def _gyro_attitude(deformation: Deformation, main: ImuSeries) -> Attitudes:
    """``R_m(t0)_m = prod Exp(omega_k dt_k)`` at the main IMU's stamps from t0, the estimate's first, onwards.

    Across a gap the rate is the mean of the last sample before it and the first after.
    """
    first = int(np.searchsorted(main.stamp, deformation.stamp[0]))
    stamp, gyro = main.stamp[first:], np.nan_to_num(main.gyro[first:])
    dt = np.diff(stamp) * 1e-9
    rate = gyro[1:].copy()
    gaps = np.flatnonzero(dt > GAP_FACTOR * usual_interval(stamp) * 1e-9)
    rate[gaps] = 0.5 * (gyro[gaps] + gyro[gaps + 1])
    steps = np.vstack([np.zeros((1, 3)), rate * dt[:, None]])
    return attitudes(stamp, running_product(quaternions.exp(steps)), lambda q: q)


def running_product(steps: FloatArray) -> FloatArray:
    """``out[k] = steps[0] steps[1] ... steps[k]`` of quaternions (n, 4), in blocks of sqrt(n) to keep loops short."""
    n = len(steps)
    width = int(np.ceil(np.sqrt(n)))
    padded = np.tile([0.0, 0.0, 0.0, 1.0], (width * width, 1))
    padded[:n] = steps
    blocks = padded.reshape(width, width, 4)
    for j in range(1, width):
        blocks[:, j] = _unit(quaternions.multiply(blocks[:, j - 1], blocks[:, j]))
    starts = np.tile([0.0, 0.0, 0.0, 1.0], (width, 1, 1))
    for j in range(1, width):
        starts[j] = _unit(quaternions.multiply(starts[j - 1], blocks[j - 1, -1]))
    return quaternions.multiply(starts, blocks).reshape(-1, 4)[:n]


def _unit(q: FloatArray) -> FloatArray:
    return q / np.linalg.norm(q, axis=-1, keepdims=True)
