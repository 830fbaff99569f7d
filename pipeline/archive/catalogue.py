"""The catalogue: one Parquet data set of all that an archive holds, kept up to date by reading what is new."""

from __future__ import annotations

import io
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import polars as pl

from pipeline.archive.manifest import CATALOGUE, Manifest, load_manifest, read_entry
from pipeline.archive.rows import SCHEMA, frame_of
from pipeline.archive.source import MARKED
from pipeline.archive.stores import Store, StoreError
from schemas.errors import DataError

READERS = 16  # entries fetched beside each other: in a bucket each takes tens of milliseconds, most of it waiting
PORTION = 2000  # entries read before they become rows


@dataclass(frozen=True)
class Catalogue:
    """frame: every row, columns as in ``rows.SCHEMA`` and ``current``: whether a log has this content now.

    notes: what went wrong that leaves the rest standing.
    """

    frame: pl.DataFrame
    notes: tuple[str, ...] = ()


def load_catalogue(store: Store) -> Catalogue:
    """The catalogue of an archive, brought up to date and written back. Raises DataError where there is no archive."""
    if not store.exists(MARKED.lstrip("/")):
        raise DataError("is no archive: deckflex batch ... -o makes one", file=store.root)
    manifest = load_manifest(store)
    kept = _kept(store, manifest)
    known = set(zip(kept["key"], kept["state"]))
    missing = [entry for entry in manifest.states.items() if entry not in known]
    added, notes = _read(store, missing)
    frame = _sorted(pl.concat([kept, added]))
    if len(added) or len(frame) != len(kept) or not store.exists(CATALOGUE):
        notes += _written(store, frame)
    current = set(manifest.contents.values())
    return Catalogue(frame.with_columns(pl.col("sha256").is_in(list(current)).alias("current")), tuple(notes))


def _kept(store: Store, manifest: Manifest) -> pl.DataFrame:
    """Rows of the last catalogue that still hold; none where it is of another make."""
    if not store.exists(CATALOGUE):
        return pl.DataFrame(schema=SCHEMA)
    try:
        frame = pl.read_parquet(io.BytesIO(store.read(CATALOGUE)))
    except (pl.exceptions.PolarsError, OSError):
        return pl.DataFrame(schema=SCHEMA)
    if dict(frame.schema) != SCHEMA:
        return pl.DataFrame(schema=SCHEMA)
    states = pl.DataFrame({"key": list(manifest.states), "state": list(manifest.states.values())},
                          schema={"key": pl.String, "state": pl.String})  # fmt: skip
    return frame.join(states, on=["key", "state"], how="semi")


def _read(store: Store, missing: Sequence[tuple[str, str]]) -> tuple[pl.DataFrame, list[str]]:
    """Entries as rows; one that cannot be read is told of."""
    notes: list[str] = []

    def entry(which: tuple[str, str]) -> dict[str, Any] | None:
        try:
            return read_entry(store, *which)
        except DataError as error:
            notes.append(str(error))
            return None

    frames = [pl.DataFrame(schema=SCHEMA)]
    with ThreadPoolExecutor(READERS) as pool:
        for start in range(0, len(missing), PORTION):
            found = [one for one in pool.map(entry, missing[start : start + PORTION]) if one is not None]
            frames.append(_framed(found, notes))
    return pl.concat(frames), notes


def _framed(entries: Sequence[dict[str, Any]], notes: list[str]) -> pl.DataFrame:
    """Rows of entries; should one be of another make, it alone is left out."""
    try:
        return frame_of(entries)
    except (KeyError, TypeError, IndexError, ValueError, pl.exceptions.PolarsError):
        if len(entries) == 1:
            notes.append(f"{entries[0].get('key')}: the entry is of another make; remove it, and batch makes it anew")
            return pl.DataFrame(schema=SCHEMA)
        return pl.concat([_framed([entry], notes) for entry in entries])


def _sorted(frame: pl.DataFrame) -> pl.DataFrame:
    return frame.sort(["start_utc", "log", "key", "axis"], nulls_last=True)


def _written(store: Store, frame: pl.DataFrame) -> list[str]:
    """Write the data set; an archive that can only be read is read all the same."""
    buffer = io.BytesIO()
    frame.write_parquet(buffer, compression="zstd")
    try:
        store.write(CATALOGUE, buffer.getvalue())
    except StoreError as error:
        return [f"the catalogue is not kept: {error}"]
    return []


def selected(frame: pl.DataFrame, condition: str | None) -> pl.DataFrame:
    """The rows that an SQL condition holds for. Raises ValueError for one that is wrong."""
    return frame if condition is None else queried(frame, f"select * from catalogue where {condition}")


def queried(frame: pl.DataFrame, query: str) -> pl.DataFrame:
    """The answer to an SQL query of the table ``catalogue``. Raises ValueError for one that is wrong."""
    try:
        return pl.SQLContext(catalogue=frame, eager=True).execute(query)
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException) as error:
        raise ValueError(" ".join(str(error).partition("Resolved plan")[0].split())) from error


def latest(frame: pl.DataFrame) -> tuple[pl.DataFrame, int]:
    """The rows of the options that were used last, of logs as they are now, and how many results are left out."""
    done = frame.filter(pl.col("state") == "done")
    if done.is_empty():
        return frame.filter(pl.col("current")), 0
    config = done.sort("finished_utc")["config"][-1]
    shown = frame.filter((pl.col("config") == config) & pl.col("current"))
    return shown, frame["key"].n_unique() - shown["key"].n_unique()
