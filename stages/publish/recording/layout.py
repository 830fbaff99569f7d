"""Views as every tab uses them: whole trial in sight, time axes linked, legends out of the way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import rerun as rr
import rerun.blueprint as rrb

from stages.publish.recording.scene import Scene


def time_axis(scene: Scene) -> rrb.TimeAxis:
    """The whole trial; all time views share it."""
    start, end = scene.span
    view = rr.TimeRange(
        start=rr.TimeRangeBoundary.absolute(seconds=start), end=rr.TimeRangeBoundary.absolute(seconds=end)
    )
    return rrb.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal, view_range=view)


def time_view(
    scene: Scene,
    name: str,
    entities: Sequence[str],
    overrides: Mapping[str, object] | None = None,
    y_range: tuple[float, float] | None = None,
) -> rrb.TimeSeriesView:
    """Lines over time; the name says quantity and unit."""
    return rrb.TimeSeriesView(
        origin="/",
        contents=list(entities),
        name=name,
        overrides=overrides,  # type: ignore[arg-type]
        axis_x=time_axis(scene),
        axis_y=rrb.ScalarAxis(range=y_range) if y_range else None,
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop),
    )


def only_line(axis: int, count: int = 3) -> rr.SeriesLines:
    """Override that shows one line of an entity with several."""
    return rr.SeriesLines(visible_series=[i == axis for i in range(count)])


def only_band(axis: int, count: int = 3) -> rr.Measurements:
    """Override that shows one band of an entity with several."""
    return rr.Measurements.from_fields(visible_series=[i == axis for i in range(count)])


def lanes(scene: Scene, name: str, origin: str) -> rrb.StateTimelineView:
    """State lanes under an entity."""
    return rrb.StateTimelineView(origin=origin, name=name, time_view=time_axis(scene))
