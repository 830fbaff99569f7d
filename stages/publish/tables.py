"""The ``/deckflex/*`` channels: a Result as message tables, fields and meaning as in the log contract."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from schemas.products import Alignment, DeckShape, Deformation, FlexureModel, Result, Score
from schemas.rig import FloatArray
from schemas.trial import IntArray, Trial
from schemas.wire import Table
from stages.publish.attitude import deck_attitude
from stages.publish.best import static_angle, time_delay

MAIN_FRAME = "imu_main"
DECK_FRAME = "deck"
MESSAGE_ORDER = [0, 2, 1]  # DeckShape.std is vertical (x), horizontal (z), torsion (y)

Columns = Mapping[str, NDArray]


def result_tables(result: Result, trial: Trial, frame: str = MAIN_FRAME) -> list[Table]:
    """All channels of a result, in the order of the contract; frame: frame_id of the main IMU."""
    deformation = result.deformation
    attitude = deck_attitude(deformation, trial)
    first = deformation.stamp[:1]
    tables = [
        deformation_table(deformation, frame),
        table(
            "/deckflex/attitude", "geometry_msgs/msg/QuaternionStamped", attitude.stamp, attitude.frame,
            dict(zip((f"quaternion.{axis}" for axis in "xyzw"), attitude.quaternion.T)),
        ),
        alignment_table(deformation, first, frame),
        flexure_table(deformation.flexure, first, frame),
    ]  # fmt: skip
    if result.deck_shape is not None and result.deck_shape.passes:
        tables.append(deck_shape_table(result.deck_shape))
    if result.scores:
        tables.append(score_table(result.scores, first, frame))
    return tables


def table(topic: str, schema: str, stamp: IntArray, frame: str, columns: Columns) -> Table:
    """A table whose log and publish times are the measurement times, with its header filled in."""
    stamp = np.ascontiguousarray(stamp, dtype=np.int64)
    header = {"header.stamp": stamp, "header.frame_id": np.broadcast_to(np.array(frame, dtype=object), len(stamp))}
    return Table(topic, schema, {**header, **columns}, stamp, stamp, np.arange(len(stamp), dtype=np.uint32))


def vector(name: str, values: FloatArray) -> dict[str, FloatArray]:
    """Columns of a Vector3 or Point from (n, 3)."""
    return {f"{name}.{axis}": values[:, i] for i, axis in enumerate("xyz")}


def deformation_table(deformation: Deformation, frame: str) -> Table:
    """One row per main-IMU sample used."""
    columns = {
        **vector("total", deformation.total),
        **vector("static_part", deformation.static_part),
        **vector("dynamic_part", deformation.dynamic_part),
        "covariance": flat_covariance(deformation.covariance),
    }
    return table("/deckflex/deformation", "deckflex_msgs/msg/Deformation", deformation.stamp, frame, columns)


def flat_covariance(covariance: FloatArray) -> FloatArray:
    """(n, 9) row-major of (n, 3, 3); first element -1 (the rest 0) where it is unknown."""
    flat = covariance.reshape(-1, 9)
    unknown = np.flatnonzero(~np.isfinite(flat).all(axis=1))
    if len(unknown):
        flat = flat.copy()
        flat[unknown] = [-1.0] + [0.0] * 8
    return flat


def alignment_table(deformation: Deformation, stamp: IntArray, frame: str) -> Table:
    """Static angle and time delay as known at the end of the run, one row."""
    static, delay = static_angle(deformation), time_delay(deformation)
    columns = {
        **vector("static_angle", np.reshape(static.value, (1, 3))),
        "covariance": flat_covariance(_static_covariance(deformation.alignment, static.std)),
        "time_delay": np.reshape(delay.value, 1),
        "time_delay_std": np.reshape(delay.std, 1),
    }
    return table("/deckflex/alignment", "deckflex_msgs/msg/Alignment", stamp, frame, columns)


def _static_covariance(alignment: Alignment, std: FloatArray) -> FloatArray:
    """(1, 3, 3) rad^2: the alignment's, unless the estimator knows the angle with a std of its own."""
    if np.array_equal(std, alignment.static.std):
        return alignment.covariance[None]
    return np.diag(np.asarray(std, dtype=float) ** 2)[None]


def flexure_table(flexure: FlexureModel, stamp: IntArray, frame: str) -> Table:
    """The identified parameters, one row."""
    columns = {
        "method": np.array([flexure.method], dtype=object),
        **vector("damping", flexure.damping[None]),
        **vector("frequency", flexure.frequency[None]),
        **vector("std", flexure.std[None]),
    }
    return table("/deckflex/flexure_model", "deckflex_msgs/msg/FlexureModel", stamp, frame, columns)


def deck_shape_table(shape: DeckShape) -> Table:
    """One row per sliding-SINS sample used, in order of time."""
    runs = shape.passes
    stamp = np.concatenate([run.stamp for run in runs])
    order = np.argsort(stamp, kind="stable")
    curvature = np.concatenate([run.curvature for run in runs])[order]
    columns = {
        "pass_index": np.repeat([run.index for run in runs], [len(run.stamp) for run in runs])[order].astype(np.uint32),
        "arc_length": np.concatenate([run.arc_length for run in runs])[order],
        **vector("position", np.concatenate([run.position for run in runs])[order]),
        "vertical_curvature": curvature[:, 0],
        "horizontal_curvature": curvature[:, 2],
        "torsion": curvature[:, 1],
        "std": np.concatenate([run.std for run in runs])[order][:, MESSAGE_ORDER],
        "exceeds_limit": np.asarray(np.concatenate([run.exceeds for run in runs])[order].any(axis=1)),
    }
    return table("/deckflex/deck_shape", "deckflex_msgs/msg/DeckShape", stamp[order], DECK_FRAME, columns)


def score_table(scores: tuple[Score, ...], stamp: IntArray, frame: str) -> Table:
    """One row per reference, stamped at the start of what was scored against it."""
    first = np.array([score.stamp[0] if len(score.stamp) else stamp[0] for score in scores])
    columns = {
        "estimator": np.array([score.estimator for score in scores], dtype=object),
        "reference": np.array([score.reference for score in scores], dtype=object),
        **vector("rmse", np.stack([score.rmse for score in scores])),
        "duration": np.array([score.duration for score in scores]),
    }
    return table("/deckflex/score", "deckflex_msgs/msg/Score", first, frame, columns)
