"""Angles of the bodies over time, all runs in one picture (as Figs. 4 and 17 of the paper)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sparsemor.core.analysis.charts.style import (
    COLUMN,
    REFERENCE_COLOUR,
    label_of,
    legend_above,
    new_figure,
    plain,
    style_of,
    tidy,
)
from sparsemor.core.analysis.charts.units import unit
from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols.layout import Quantity
from sparsemor.core.protocols.poses import PLANAR_POSE, SPINNING_POSE
from sparsemor.core.results.run_result import RunResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Curves = dict[tuple[str, str], "Curve"]
"""By body and name of the axis."""


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """values (j,) at times (j,), s."""

    times: FloatArray
    values: FloatArray


def turning(run: RunResult) -> Curves:
    """Degrees of bodies in the plane; radians and rad/s of frames that spin about one axis, solved
    for or followed.

    A result holds no rates of what it solved for: their speed is the derivative of the parabola
    through three stored angles. A stage that was followed has its own.
    """
    found: Curves = {}
    if len(run.times) < 2:
        return found
    for b in run.layout:
        if b.kind.quantity is Quantity.POSE and b.size in (PLANAR_POSE, SPINNING_POSE):
            angle = run.block(b.name)[:, -1]
            if b.size == PLANAR_POSE:
                found[b.owner, "angle (°)"] = Curve(run.times, np.degrees(angle))
            else:
                found |= _spin(b.owner, run.times, angle, rate_of(run.times, angle))
    stage = run.stage()
    for body in sorted(stage.moves) if stage is not None else ():
        assert stage is not None
        frame = stage.frames[body]
        if frame.pose.shape[1] == SPINNING_POSE and len(stage.times) > 1:
            found |= _spin(body, stage.times, frame.pose[:, -1], frame.rate[:, -1])
    return found


def angles_figure(
    reference: RunResult, runs: Mapping[str, RunResult], name: str
) -> "Figure | None":
    """One panel a body that turns by an angle, and one more for its speed if that is all it does;
    None when nothing turns.

    name: what the reference is called, if there are other runs. A cross marks where a run
    stopped early.
    """
    shown = turning(reference)
    if not shown:
        return None
    others = {run: turning(result) for run, result in runs.items()}
    end = max(float(curve.times[-1]) for curve in shown.values())
    clock = unit(end, "s")
    figure = new_figure(COLUMN, 0.55 + 1.45 * len(shown))
    panels = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
    for (key, curve), axes in zip(shown.items(), panels, strict=True):
        body, quantity = key
        tidy(axes, f"time ({clock.name})" if axes is panels[-1] else "", quantity, body)
        _draw_reference(axes, curve, clock.factor, name, alone=not runs)
        low, high = axes.get_ylim()
        for number, (run, result) in enumerate(runs.items()):
            own = others[run].get(key)
            if own is not None:
                _add(axes, own, clock.factor, number, run, result, (low, high))
        reach = 0.15 * (high - low)  # a run that left the reference must not squash the others
        axes.set_ylim(max(axes.get_ylim()[0], low - reach), min(axes.get_ylim()[1], high + reach))
        axes.set_xlim(clock.factor * curve.times[0], clock.factor * end)
        axes.ticklabel_format(axis="y", useOffset=False)
    legend_above(figure, panels[0].get_legend_handles_labels()[0])
    return figure


def _draw_reference(axes: Any, curve: Curve, factor: float, name: str, alone: bool) -> None:
    look: dict[str, Any] = {"color": REFERENCE_COLOUR, "linewidth": 3.2}
    if alone:
        look = {"color": style_of(0).colour, "linewidth": 1.1}
    name = plain(name)
    axes.plot(factor * curve.times, curve.values, label=name if alone else f"{name} (reference)",
              **look)


def _add(
    axes: Any, curve: Curve, factor: float, number: int, name: str, run: RunResult,
    limits: tuple[float, float],
) -> None:
    style = style_of(number)
    axes.plot(factor * curve.times, curve.values, color=style.colour, linestyle=style.dash,
              linewidth=1.1, label=label_of(name, run.status))
    if not run.status.ok:
        axes.plot(factor * curve.times[-1], np.clip(curve.values[-1], *limits), marker="x",
                  color=style.colour, markersize=5, clip_on=False)


def _spin(body: str, times: FloatArray, angle: FloatArray, rate: FloatArray) -> Curves:
    return {(body, "angle (rad)"): Curve(times, angle),
            (body, "angular speed (rad/s)"): Curve(times, rate)}


def rate_of(times: FloatArray, angle: FloatArray) -> FloatArray:
    """(j,) derivative of angles (j,), exact for parabolas."""
    return np.asarray(np.gradient(angle, times, edge_order=2 if len(times) > 2 else 1))
