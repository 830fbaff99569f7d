"""The ship in 3D: deck outline, instruments, the sled's path coloured by curvature, the deck line as it bends."""

from __future__ import annotations

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from schemas.products import DeckShape
from schemas.rig import FloatArray
from stages.publish.recording.scene import BLUE, GREY, ORANGE, RED, Colour, Scene, stride
from stages.publish.recording.stream import times_of

SCHEMATIC_LEVER = np.array([0.0, 30.0, 0.0])  # m, drawn where the lever arm is not known
SHOWN_SHARE = 0.12  # of the line's length, at the largest bend shown
LINE_POINTS = 13
LABEL_ASIDE = 0.12  # of the distance between the units
MOVING_RATE = 2.0  # Hz
DECK: Colour = (110, 125, 140)
HULL: Colour = (62, 70, 80)


def lever_arm(scene: Scene) -> tuple[FloatArray, bool]:
    """(3,) m from main to sub and whether it is known: estimated, else stated by the rig, else schematic."""
    found = scene.deformation.parameters.get("lever_arm")
    for value in (found.value if found is not None else None, scene.trial.rig.lever_arm):
        if value is not None and np.isfinite(value).all() and np.linalg.norm(value) > 1.0:
            return np.asarray(value, dtype=float), True
    return SCHEMATIC_LEVER, False


def bending_factor(theta: FloatArray, lever: FloatArray) -> float:
    """Exaggeration, a round number, that makes the largest bend of the line SHOWN_SHARE of its length."""
    bend = np.linalg.norm(0.5 * np.cross(theta, lever), axis=-1)
    largest = float(np.nanmax(bend)) if len(bend) and np.isfinite(bend).any() else 0.0
    return round_down(SHOWN_SHARE * float(np.linalg.norm(lever)) / largest) if largest > 0 else 1.0


def round_down(value: float) -> float:
    """The next smaller of 1, 2, 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(m * power for m in (1.0, 2.0, 5.0) if m * power <= value * (1 + 1e-9)))


def bent_line(theta: FloatArray, lever: FloatArray, factor: float) -> FloatArray:
    """Points (n, k, 3) of a line clamped at m whose slope at s is factor theta: ``u r + u^2/2 (factor theta) x r``."""
    u = np.linspace(0.0, 1.0, LINE_POINTS)
    end = 0.5 * factor * np.cross(theta, lever)
    return u[None, :, None] * lever + (u**2)[None, :, None] * end[:, None, :]


def outline(points: FloatArray) -> FloatArray:
    """A deck's outline (k, 3) m around points (n, 3) in hull axes: pointed bow, square stern."""
    low, high = points.min(axis=0), points.max(axis=0)
    length = max(1.5 * (high[1] - low[1]), 40.0)
    half = max(0.6 * (high[0] - low[0]), 0.09 * length)
    x, y, z = 0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), low[2] - 1.0
    shape = [(-0.8, -0.5), (-1.0, -0.3), (-1.0, 0.15), (-0.6, 0.36), (0.0, 0.5)]
    port = [(x + a * half, y + b * length, z) for a, b in shape]
    starboard = [(2 * x - px, py, pz) for px, py, pz in reversed(port[:-1])]
    return np.array([*port, *starboard, port[0]])


def aboard(scene: Scene) -> FloatArray:
    """(n, 3) m, everything the deck must hold: both units and the sled's path."""
    shape = scene.result.deck_shape
    path = [shape.line] if shape is not None and len(shape.line) else []
    return np.vstack([np.zeros((1, 3)), lever_arm(scene)[0][None], *path])


def log(rec: rr.RecordingStream, scene: Scene) -> None:
    """Static ship, moving line."""
    lever, known = lever_arm(scene)
    if scene.result.deck_shape is not None and len(scene.result.deck_shape.line):
        _log_path(rec, scene.result.deck_shape)
    rec.log("ship", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    _log_hull(rec, outline(aboard(scene)))
    _log_units(rec, scene, lever, known)
    _log_moving_line(rec, scene, lever)


def _log_hull(rec: rr.RecordingStream, deck: FloatArray) -> None:
    """The deck's outline, and dimmer below it the hull that narrows towards the keel."""
    rec.log("ship/deck", rr.LineStrips3D([deck], colors=[DECK], radii=rr.Radius.ui_points(1.8)), static=True)
    length = float(np.ptp(deck[:, 1]))
    middle = deck.mean(axis=0)
    water = middle + (deck - middle) * [0.72, 0.94, 1.0] - [0.0, 0.0, 0.07 * length]
    ribs = list(np.stack([deck, water], axis=1))
    dim = rr.LineStrips3D([water, *ribs], colors=[HULL] * (len(ribs) + 1), radii=rr.Radius.ui_points(0.8))
    rec.log("ship/hull", dim, static=True)


def _log_units(rec: rr.RecordingStream, scene: Scene, lever: FloatArray, known: bool) -> None:
    has_phins = scene.trial.phins_main is not None and scene.trial.phins_sub is not None
    also = " + PHINS" if has_phins else ""
    names = [f"main IMU{also}", f"sub-IMU{also}" + ("" if known else " (place not known)")]
    size = 0.02 * float(np.linalg.norm(lever)) + 0.4
    boxes = rr.Boxes3D(
        centers=[np.zeros(3), lever],
        half_sizes=[[size] * 3] * 2,
        colors=[BLUE, ORANGE],
        fill_mode=rr.components.FillMode.Solid,
    )
    rec.log("ship/imu", boxes, static=True)
    aside = np.array([0.0, 0.0, LABEL_ASIDE * float(np.linalg.norm(lever))])  # off the line that bends between them
    labels = rr.Points3D([-aside, lever + aside], labels=names, colors=[BLUE, ORANGE], radii=0.01, show_labels=True)
    rec.log("ship/imu_names", labels, static=True)
    straight = rr.LineStrips3D([[np.zeros(3), lever]], colors=[GREY], radii=rr.Radius.ui_points(0.7))
    rec.log("ship/straight", straight, static=True)


def _log_moving_line(rec: rr.RecordingStream, scene: Scene, lever: FloatArray) -> None:
    d = scene.deformation
    every = stride(d.stamp, MOVING_RATE)
    stamp, theta = d.stamp[::every], np.nan_to_num(d.dynamic_part[::every])
    strips = bent_line(theta, lever, bending_factor(d.dynamic_part, lever)).astype(np.float32)
    style = rr.LineStrips3D.from_fields(colors=[ORANGE], radii=rr.Radius.ui_points(3.0))
    rec.log("ship/bent_line", style, static=True)
    times = times_of(stamp, scene.trial.epoch)
    rr.send_columns("ship/bent_line", times, rr.LineStrips3D.columns(strips=strips), recording=rec)


def _log_path(rec: rr.RecordingStream, shape: DeckShape) -> None:
    """The path over all runs: straight and coloured by vertical curvature, and bent by a stated factor."""
    base = straight_path(shape)
    factor = path_factor(shape)
    bent = base + factor * (shape.line - base)
    colours = curvature_colours(np.abs(shape.curvature[:, 0]))
    segments = np.stack([base[:-1], base[1:]], axis=1)
    rec.log(
        "ship/path/curvature",
        rr.LineStrips3D(list(segments), colors=colours[1:], radii=rr.Radius.ui_points(4.0)),
        static=True,
    )
    line = rr.LineStrips3D([bent], colors=[RED], radii=rr.Radius.ui_points(1.5))
    rec.log("ship/path/bent", line, static=True)
    far = 0 if np.linalg.norm(bent[0]) > np.linalg.norm(bent[-1]) else -1  # away from the main IMU and its name
    label = rr.Points3D([bent[far]], labels=[f"path as bent, x{factor:g}"], colors=[RED], radii=0.01, show_labels=True)
    rec.log("ship/path/label", label, static=True)


def straight_path(shape: DeckShape) -> FloatArray:
    """(k, 3) m: the line's start carried on along its first heading in the deck plane, by arc length."""
    ahead = shape.line[-1] - shape.line[0]
    ahead = np.array([ahead[0], ahead[1], 0.0])
    ahead /= max(float(np.linalg.norm(ahead)), 1e-9)
    base: FloatArray = shape.line[0] + (shape.arc_length - shape.arc_length[0])[:, None] * ahead
    return base


def path_factor(shape: DeckShape) -> float:
    """Exaggeration that makes the largest departure from straight SHOWN_SHARE of the path."""
    away = float(np.nanmax(np.linalg.norm(shape.line - straight_path(shape), axis=1)))
    length = float(shape.arc_length[-1] - shape.arc_length[0])
    return max(1.0, round_down(SHOWN_SHARE * length / away)) if away > 0 else 1.0


def curvature_colours(size: FloatArray) -> FloatArray:
    """(k, 3) uint8 from quiet blue through yellow to red at the largest."""
    top = float(np.nanmax(size)) or 1.0
    share = np.nan_to_num(size / top)
    stops = np.array([(60, 100, 190), (90, 190, 170), (240, 210, 80), (220, 50, 40)], dtype=float)
    mixed = [np.interp(share, np.linspace(0, 1, len(stops)), stops[:, i]) for i in range(3)]
    return np.stack(mixed, axis=1).astype(np.uint8)


def view(scene: Scene, distance: float = 1.0) -> rrb.Spatial3DView:
    """The 3D view; its name states how much the bending is exaggerated. distance: of the eye, larger in a tall view."""
    lever, _ = lever_arm(scene)
    factor = bending_factor(scene.deformation.dynamic_part, lever)
    name = f"Ship [m], flexure x{factor:g}"
    if scene.result.deck_shape is not None:
        name += ", path coloured by vertical curvature"
    hull = outline(aboard(scene))
    low, high = hull.min(axis=0), hull.max(axis=0)
    middle, reach = 0.5 * (low + high), float(high[1] - low[1])
    eye = rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=middle + distance * reach * np.array([0.47, -0.12, 0.29]),
        look_target=middle,
        eye_up=[0.0, 0.0, 1.0],
    )
    return rrb.Spatial3DView(
        origin="ship",
        name=name,
        background=rrb.Background(color=[22, 22, 26]),
        eye_controls=eye,
        line_grid=rrb.LineGrid3D(visible=False),
    )
