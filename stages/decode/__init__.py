"""Decode: a log of any rig into a :class:`schemas.trial.Trial`, and what a log is good for.

``decode(path, rig_profile)`` reads a log, ``load_rig(path)`` a rig profile, ``health(path, rig_profile)`` looks over a
log without judging it.
"""

from stages.decode.decoding import Decoded, decode
from stages.decode.health import Capability, ChannelHealth, LogHealth, health
from stages.decode.profile import RigProfile, default_rig, load_rig

__all__ = [
    "Capability",
    "ChannelHealth",
    "Decoded",
    "LogHealth",
    "RigProfile",
    "decode",
    "default_rig",
    "health",
    "load_rig",
]
