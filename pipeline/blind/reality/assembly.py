"""Reality with its causes, looked at by all instruments: a trial and its truth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.blind.reality import sensing
from pipeline.blind.reality.causes import Cause, Seen
from pipeline.blind.reality.flexure import (
    MARGIN,
    SETTLING,
    Bending,
    Restoring,
    grid,
    moved_lever,
    random_path,
    settled,
)
from pipeline.blind.reality.motion import ShipPath
from pipeline.blind.reality.nature import Nature, Unit
from pipeline.blind.reality.sensing import Samples, World
from schemas.trial import ImuSeries, Trial, Truth

FloatArray = NDArray[np.float64]

STREAMS = ("deck", "causes", "main", "sub", "phins_main", "phins_sub", "gnss", "warmth")


def assemble(nature: Nature, causes: Sequence[Cause], rng: np.random.Generator) -> tuple[Trial, Truth]:
    """All channels of a log; each instrument has noise of its own, whatever the causes."""
    streams = dict(zip(STREAMS, rng.spawn(len(STREAMS))))
    world = make_world(nature, causes, streams)
    main, sub, deck = sensing.ideal(world)
    stamp = sensing.instants(world.stamped(), nature.epoch)
    with_phins = "phins" in nature.channels
    warm = "temperature" in nature.channels
    trial = Trial(
        main=ImuSeries(stamp, *sensing.spoiled(main, world.nature.main, nature.rate, streams["main"])),
        sub=_sub(world, sub, stamp, streams),
        epoch=int(stamp[0]),
        phins_main=_phins(world, "main", main, stamp, streams["phins_main"]) if with_phins else None,
        phins_sub=_phins(world, "sub", deck, stamp, streams["phins_sub"]) if with_phins else None,
        gnss=sensing.fixes(world, streams["gnss"]) if "gnss" in nature.channels else None,
        temperature_main=sensing.thermometer(nature.warmth, 0, nature, streams["warmth"]) if warm else None,
        temperature_sub=sensing.thermometer(nature.warmth, 1, nature, streams["warmth"]) if warm else None,
        source="trial",
    )
    return trial, truth_of(world, stamp)


def make_world(nature: Nature, causes: Sequence[Cause], streams: dict[str, np.random.Generator]) -> World:
    """Ship, deck and lever arm with everything random about them drawn."""
    for cause in causes:
        nature = cause.nature(nature)
    stray = sensing.longest(causes, nature.duration, nature.delay)
    if stray > 0.5 * MARGIN:
        raise ValueError(f"a clock that strays by {stray:.1f} s leaves the simulated time")
    ship = ShipPath.over(nature.voyage, -(SETTLING + MARGIN), nature.duration + 2.0 * MARGIN)
    first, path = shaken_deck(nature, causes, streams)
    bends = [bend for cause in causes if (bend := cause.bend(ship, nature, streams["causes"])) is not None]
    bending = Bending(first, path, tuple(bends))
    return World(nature, tuple(causes), ship, bending, moved_lever(bending, nature.deck))


def shaken_deck(
    nature: Nature, causes: Sequence[Cause], streams: dict[str, np.random.Generator]
) -> tuple[float, FloatArray]:
    """First instant and random path (k, 3) rad of the deck at the steps of the integration, settling left out."""
    t = grid(nature.duration)
    strength = np.ones(len(t))
    for cause in causes:
        strength = strength * cause.strength(t, nature)
    path = random_path(nature.deck, t, _laws(causes, nature), strength, streams["deck"])
    for cause in causes:
        path = cause.reshape(t, path, nature, streams["causes"])
    return settled(t, path)


def truth_of(world: World, stamp: NDArray[np.int64]) -> Truth:
    """Deformation at every stamp, by the right clock."""
    t = world.stamped()
    relative = world.relative(t)
    theta = world.bending.at(t)
    phi = world.static(t) + np.zeros_like(theta)
    attitude = (world.ship.at(t).R_n_m @ relative).xyzw
    return Truth(stamp, relative.vectors, phi, theta, stamp, attitude)


def _laws(causes: Sequence[Cause], nature: Nature) -> list[Restoring]:
    laws = []
    for axis in range(3):
        given = [law for cause in causes if (law := cause.restoring(axis, nature)) is not None]
        laws.append(given[-1] if given else Restoring())
    return laws


def _sub(world: World, ideal: Samples, stamp: NDArray[np.int64], streams: dict[str, np.random.Generator]) -> ImuSeries:
    t, rng = world.stamped(), streams["causes"]
    rate, force = ideal.rate, ideal.force
    for cause in world.causes:
        rate = cause.rate(Seen(t, rate, ideal.force, world.nature), rng)
        force = cause.force(force)
    series = ImuSeries(
        stamp, *sensing.spoiled(Samples(rate, force), world.nature.sub, world.nature.rate, streams["sub"])
    )
    for cause in world.causes:
        series = cause.finish(series, world.nature, rng)
    return series


def _phins(world: World, unit: str, ideal: Samples, stamp: NDArray[np.int64], rng: np.random.Generator) -> ImuSeries:
    """Attitude, and rate and force in the unit's own axes, free of bias."""
    phins = world.nature.phins
    attitude = sensing.phins_attitude(world, unit, rng)
    back = sensing.seat(phins, unit).inverse
    own = Unit(np.zeros(3), np.zeros((3, 3)), phins.arw, np.zeros(3), phins.vrw)
    turned = Samples(back.apply(ideal.rate), back.apply(ideal.force))
    return ImuSeries(stamp, *sensing.spoiled(turned, own, world.nature.rate, rng), attitude)
