"""What the spectral model leaves unexplained: a free factor for every third of an octave, judged held out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schemas.rig import FloatArray
from stages.diagnose import spectral_lines
from stages.diagnose.spectra import JointFit
from stages.diagnose.spectral_coupling import coupling
from stages.diagnose.spectral_data import SHARE, Spectra, spectra
from stages.diagnose.spectral_fit import Fit
from stages.diagnose.spectral_residual import FullRateResidual

BANDS_PER_OCTAVE = 3
FEWEST = 4.0  # ordinates in a half below which a band is not judged


@dataclass(frozen=True)
class Excess:
    """edges_hz: (k + 1,). nats: (3, k) that a factor of its own gains held out. ratio: (3, k) power over the model.

    cross: nats held out that correlations between the axes gain, where nothing named has them.
    """

    edges_hz: FloatArray
    nats: FloatArray
    ratio: FloatArray
    cross: float = 0.0

    @property
    def total(self) -> float:
        """Nats of all bands that gain, and of the axes' correlations."""
        return float(np.maximum(self.nats, 0.0).sum() - _expected(self.nats)) + max(self.cross, 0.0)


def _expected(nats: FloatArray) -> float:
    """What bands of chance sum to: each gains -1 +- 1.4 nats, so 0.3 above zero."""
    return 0.3 * nats.size


def data_of(residual: FullRateResidual, joint: JointFit) -> Spectra:
    """Spectra of a residual without the lines that the fit has found."""
    for line in joint.lines:
        residual = spectral_lines.without(residual, line)
    return spectra(residual)


def excess(data: Spectra, joint: JointFit, cross: bool) -> Excess:
    """Bands in which the fit misses; data: of the residual that the fit was made to. cross: the axes' correlations are
    looked at too."""
    frequency = data.grid.frequency
    octave = np.floor(np.log2(np.maximum(frequency, 1e-9) / frequency[0]) * BANDS_PER_OCTAVE).astype(int)
    edges = frequency[0] * 2.0 ** (np.arange(octave.max() + 2) / BANDS_PER_OCTAVE)
    nats, ratio = np.zeros((3, octave.max() + 1)), np.ones((3, octave.max() + 1))
    for axis in range(3):
        number, power = _ratios(data, joint.whole, axis)
        for band in range(octave.max() + 1):
            inside = octave == band
            n, s = number[:, inside].sum(axis=1), (number * power)[:, inside].sum(axis=1)
            if n.min() < FEWEST:
                continue
            r = s / n
            ratio[axis, band] = s.sum() / n.sum()
            nats[axis, band] = sum(n[1 - k] * (r[1 - k] * (1.0 - 1.0 / r[k]) - np.log(r[k])) for k in (0, 1))
    correlated = coupling(data, joint.halves, joint.whole).evidence_nats if cross else 0.0
    return Excess(edges, nats, ratio, correlated)


def _ratios(data: Spectra, fitted: Fit, axis: int) -> tuple[FloatArray, FloatArray]:
    """Effective ordinates (2, k) and mean power over the model (2, k) of either half."""
    number, power = np.zeros((2, len(data.grid.omega))), np.zeros((2, len(data.grid.omega)))
    for half in range(2):
        S = fitted.model.spectrum(fitted.x, axis, data.share[half])
        weight = SHARE * data.count[half]
        number[half] = weight.sum(axis=0)
        power[half] = (weight * data.power[half, ..., axis, axis].real / S).sum(axis=0)
    return number, power / np.maximum(number, 1e-300)
