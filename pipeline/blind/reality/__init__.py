"""An independent reality: logs with hidden effects, sharing no forward model with the twin or the library of effects.

What it shares with the rest of the project is the data model (trials, twins), the Earth's radii and gravity, and units.
Sea, motion, flexure, lever arm, instruments and all effects are models of its own; see ``docs/blind.md``.

:func:`draw` gives one log without going through a file.
"""

from pipeline.blind.reality.drawing import Drawn, draw, draw_case

__all__ = ["Drawn", "draw", "draw_case"]
