"""The simulated world: a twin (what an engineer believes about ship and sensors) and the trial it makes."""

from twin.config import Twin
from twin.loading import built_in, dump_twin, load_twin, make_twin, parse_twin, with_run
from twin.rig import believed_rig
from twin.simulation import Simulation, simulate

__all__ = [
    "Simulation",
    "Twin",
    "believed_rig",
    "built_in",
    "dump_twin",
    "load_twin",
    "make_twin",
    "parse_twin",
    "simulate",
    "with_run",
]
