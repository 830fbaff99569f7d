"""Least squares on the autocorrelation of angle-increment differences."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from schemas.products import Alignment, FlexureModel
from schemas.trial import Trial
from stages.identify.autocorrelation import fit, identify_axes


@dataclass(frozen=True)
class Autocorrelation:
    """Least-squares fit of (mu, b^2, sigma) to the autocorrelation of angle-increment differences.

    as_printed: increments as in IDAM 13-16, with omega x theta left in.
    """

    name: ClassVar[str] = "acf"
    source: ClassVar[str] = "Wu, Chen, Qin, Ocean Eng. 2012; IDAM eqs. 15-24, corrected"
    options: ClassVar[Mapping[str, str]] = {
        "as_printed": "increments compensated for the static angle alone (13)-(16), which fails"
    }
    as_printed: bool = False

    def identify(self, trial: Trial, alignment: Alignment) -> FlexureModel:
        """Flexure model of a trial; DataError when the units hardly overlap or the record is too short."""
        return identify_axes(self.name, trial, alignment, fit, self.as_printed)
