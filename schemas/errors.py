"""The error that a person sees."""

from __future__ import annotations

from pathlib import Path


class DataError(Exception):
    """Bad input, told in one line: file, channel, time, what is wrong.

    Every stage raises this (and only this) for data it cannot work with. The command line prints the line and
    exits with status 1. Facts that are unknown where the error arises are filled in by whoever knows them
    (:meth:`located`).
    """

    def __init__(
        self,
        problem: str,
        *,
        file: Path | str | None = None,
        channel: str | None = None,
        time_s: float | None = None,
    ) -> None:
        self.problem = " ".join(problem.split())
        self.file = str(file) if file is not None else None
        self.channel = channel
        self.time_s = time_s
        super().__init__(self.problem)

    def located(self, *, file: Path | str | None = None, channel: str | None = None) -> DataError:
        """The same error with the file and channel filled in where they were not known before."""
        return DataError(
            self.problem,
            file=self.file if self.file is not None else file,
            channel=self.channel if self.channel is not None else channel,
            time_s=self.time_s,
        )

    def __str__(self) -> str:
        place = [part for part in (self.file, self.channel) if part]
        if self.time_s is not None:
            place.append(f"t = {self.time_s:.3f} s")
        return ": ".join([", ".join(place), self.problem]) if place else self.problem
