"""Views as every tab uses them: whole trial in sight, time axes linked, legends out of the way."""

from __future__ import annotations

from collections.abc import Sequence
from uuid import UUID, uuid5

import rerun as rr
import rerun.blueprint as rrb

from stages.publish.axis import legible
from stages.publish.recording.scene import Scene
from stages.publish.recording.stream import TRIAL

SHARED_TIME = UUID("5c0dca6a-e63f-9cf7-f657-2602590474cc")  # the view whose time axis linked views follow
IDS = UUID("0c1d7d3c-5c0b-5d0e-9a3e-6d65636b666c")  # namespace of the ids given to views


class LinkedTabs(rrb.Tabs):  # type: ignore[misc]
    """Tabs whose linked time views open on a given range: Rerun keeps that range under an id of its own."""

    def __init__(self, *tabs: rrb.Container, axis: rrb.TimeAxis) -> None:
        super().__init__(*tabs, active_tab=0)
        self.axis = axis

    def _log_to_stream(self, stream: rr.RecordingStream) -> None:
        super()._log_to_stream(stream)
        stream.log(f"view/{SHARED_TIME}/TimeAxis", self.axis)


def fix_ids(part: rrb.Container | rrb.View, path: str = "root") -> None:
    """Give every view and container an id that follows from its place, so that equal results give equal layouts."""
    part.id = uuid5(IDS, path)
    for index, child in enumerate(getattr(part, "contents", ()) if isinstance(part, rrb.Container) else ()):
        fix_ids(child, f"{path}/{index}")


def blueprint(tabs: Sequence[rrb.Container], axis: rrb.TimeAxis, timeline: str = TRIAL) -> rrb.Blueprint:
    """Tabs, the first one open; paused at the start, the whole trial in sight, panels out of the way."""
    root = LinkedTabs(*tabs, axis=axis)
    fix_ids(root)
    return rrb.Blueprint(
        root,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=timeline, play_state="paused"),
        auto_views=False,
        auto_layout=False,
    )


def time_axis(scene: Scene) -> rrb.TimeAxis:
    """The whole trial and a little more; all time views share it."""
    return axis_over(scene.span)


def axis_over(span: tuple[float, float]) -> rrb.TimeAxis:
    """A span of time (s since the epoch) and a little more."""
    start, end = span
    margin = 0.01 * (end - start)
    start, end = start - margin, end + margin
    view = rr.TimeRange(
        start=rr.TimeRangeBoundary.absolute(seconds=start), end=rr.TimeRangeBoundary.absolute(seconds=end)
    )
    return rrb.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal, view_range=view)


def time_view(
    scene: Scene,
    name: str,
    entities: Sequence[str],
    y_range: tuple[float, float] | None = None,
) -> rrb.TimeSeriesView:
    """Lines over the time of a scene; the name says quantity and unit."""
    return lines_view(time_axis(scene), name, entities, y_range)


def lines_view(
    axis: rrb.TimeAxis,
    name: str,
    entities: Sequence[str],
    y_range: tuple[float, float] | None = None,
) -> rrb.TimeSeriesView:
    """Lines over time; without a legend, which would hide their ends: a key above says what they are."""
    return rrb.TimeSeriesView(
        origin="/",
        contents=list(entities),
        name=name,
        axis_x=axis,
        axis_y=rrb.ScalarAxis(range=legible(*y_range)) if y_range else None,
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop, visible=False),
    )


def lanes(scene: Scene, name: str, origin: str, only: Sequence[str] = ("$origin/**",)) -> rrb.StateTimelineView:
    """State lanes under an entity: all of them, or only some."""
    return rrb.StateTimelineView(origin=origin, contents=list(only), name=name, time_view=time_axis(scene))
