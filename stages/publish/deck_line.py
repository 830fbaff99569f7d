"""The line of the deck, measured and as designed, over the chord from one end of the path to the other."""

from __future__ import annotations

import numpy as np
from scipy.integrate import cumulative_trapezoid

from schemas.products import DeckShape
from schemas.rig import FloatArray


def measured_line(shape: DeckShape) -> FloatArray:
    """(k, 2) m: how far the bent line lies to starboard of its chord and above it, at the arc lengths."""
    return _over_chord(shape.line - shape.line[0], shape)


def design_line(shape: DeckShape) -> FloatArray | None:
    """(k, 2) m: the same of the line the deck was designed with; None where no design is stated.

    ``p'' = k x t`` for slopes that are small, t the direction of the chord. Curvature says nothing of where a line
    starts and how it points, so both lines are laid on the same two ends.
    """
    if shape.design is None:
        return None
    bent = np.cross(shape.design, _direction(shape))
    slope = cumulative_trapezoid(bent, shape.arc_length, axis=0, initial=0)
    return _over_chord(cumulative_trapezoid(slope, shape.arc_length, axis=0, initial=0), shape)


def _direction(shape: DeckShape) -> FloatArray:
    chord = shape.line[-1] - shape.line[0]
    return np.asarray(chord / max(float(np.linalg.norm(chord)), 1e-9))


def _over_chord(line: FloatArray, shape: DeckShape) -> FloatArray:
    """The part of points (k, 3), the first at zero, that is across the path: to starboard, and up."""
    ahead = _direction(shape)
    s = shape.arc_length - shape.arc_length[0]
    apart = line - (s / max(float(s[-1]), 1e-9))[:, None] * line[-1]
    flat = np.hypot(ahead[0], ahead[1])
    beside = np.array([ahead[1], -ahead[0], 0.0]) / max(float(flat), 1e-9) * (-1.0 if ahead[1] < 0 else 1.0)
    return np.stack([apart @ beside, apart[:, 2]], axis=1)
