"""Estimates written back: into a copy of the log, alone, or as Parquet tables."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from physics.units import ARCMIN
from schemas.errors import DataError
from schemas.products import DeckShape, Deformation, Result
from schemas.trial import Trial
from schemas.wire import append_tables, write_log
from stages.publish import OWN_TOPICS
from stages.publish.tables import MAIN_FRAME, result_tables

if TYPE_CHECKING:
    import polars as pl

RECORD = "deckflex"  # name of the metadata record that says how the estimates came about


def publish_log(
    result: Result,
    trial: Trial,
    source: Path,
    target: Path,
    only_estimates: bool = False,
    frame: str = MAIN_FRAME,
) -> tuple[str, ...]:
    """Write target: the source log with the result's channels appended, or those channels alone.

    Estimates that the source holds already are replaced. The source is never changed; target appears whole or not at
    all. Provenance goes into a metadata record named "deckflex". frame: frame_id of the main IMU. Returns what was odd
    about the source, a sentence each.
    """
    tables = result_tables(result, trial, frame)
    metadata = {RECORD: {key: str(value) for key, value in result.provenance.items()}}
    if only_estimates:
        write_log(target, tables, metadata=metadata)
        return ()
    return append_tables(source, target, tables, metadata=metadata, without=OWN_TOPICS)


def write_parquet(result: Result, directory: Path, stem: str) -> tuple[Path, ...]:
    """``<stem>.deformation.parquet`` and, with a deck shape, ``<stem>.deck_shape.parquet``; returns their paths."""
    frames = {"deformation": deformation_frame(result.deformation)}
    if result.deck_shape is not None:
        frames["deck_shape"] = deck_shape_frame(result.deck_shape)
    directory.mkdir(parents=True, exist_ok=True)
    paths = {name: directory / f"{stem}.{name}.parquet" for name in frames}
    partial = {name: path.with_name(f".{path.name}.partial") for name, path in paths.items()}
    try:
        for name, frame in frames.items():
            _write(frame, partial[name], paths[name])
        for name, path in paths.items():
            partial[name].replace(path)
    finally:
        for left in partial.values():
            left.unlink(missing_ok=True)
    return tuple(paths.values())


def _write(frame: pl.DataFrame, partial: Path, path: Path) -> None:
    import polars as pl

    try:
        frame.write_parquet(partial)
    except pl.exceptions.PolarsError as error:  # an error of the file system comes as one of polars' own
        raise DataError(f"cannot be written: {error}", file=path) from error


def deformation_frame(deformation: Deformation) -> pl.DataFrame:
    """One row per sample: time (UTC), angles and standard deviations in arcminutes, m-axes."""
    import polars as pl

    std = np.sqrt(np.diagonal(deformation.covariance, axis1=1, axis2=2))
    parts = {
        "total": deformation.total,
        "static": deformation.static_part,
        "dynamic": deformation.dynamic_part,
        "std": std,
    }
    columns = {
        f"{name}_{axis}_arcmin": values[:, i] / ARCMIN for name, values in parts.items() for i, axis in enumerate("xyz")
    }
    return pl.DataFrame({"time": deformation.stamp.view("datetime64[ns]"), **columns})


def deck_shape_frame(shape: DeckShape) -> pl.DataFrame:
    """The curves over all runs, one row per place: rad/m and m, as in DeckShape."""
    import polars as pl

    curves = {
        f"{name}{suffix}_rad_per_m": values[:, i]
        for suffix, values in (("", shape.curvature), ("_std", shape.std))
        for i, name in enumerate(("vertical_curvature", "torsion", "horizontal_curvature"))
    }
    line = {f"line_{axis}_m": shape.line[:, i] for i, axis in enumerate("xyz")}
    return pl.DataFrame({"arc_length_m": shape.arc_length, **curves, **line, "exceeds_limit": shape.exceeds.any(1)})
