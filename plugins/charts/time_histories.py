"""Charts over time: rotations and displacements of bodies, forces of contacts and joints, and
probes."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols.layout import Block, Quantity
from sparsemor.core.protocols.poses import KNOWN, PLANAR_POSE, SPINNING_POSE, angle_between
from sparsemor.core.results.run_result import RunResult
from sparsemor.plugins.charts.fields import NO_RUNS
from sparsemor.plugins.charts.style import (
    REFERENCE_COLOUR,
    LinePanel,
    dash_of,
    draw_line,
    handles_of,
    label_of,
    legend_above,
    lines_figure,
    plain,
    style_of,
    time_panels,
    unit,
)

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

Curves = dict[tuple[str, str], "Curve"]
"""(body, label of the vertical axis) -> curve."""
Poses = Mapping[str, tuple[FloatArray, FloatArray]]
"""Body -> times (j,), s, and pose (j, 3), (j, 4) or (j, 7), m and rad."""
FORCES = {"normal": "normal force", "friction": "friction"}
_AXES = ("x moved", "y moved", "z moved", "turned")
_STILL = 1e-12
"""Displacement (m) or rotation (rad) below which a panel is omitted."""


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """Curve over time: values (j,) at times (j,), s."""

    times: FloatArray
    values: FloatArray


def angles_figure(
    reference: RunResult, runs: Mapping[str, RunResult], name: str
) -> "Figure | None":
    """Rotation angles of all runs over time (as Figs. 4 and 17 of the paper); None if no body
    rotates.

    One panel per body, and one for the angular velocity of bodies that rotate about a fixed axis in
    space. name: label of the reference, if there are other runs. A
    cross marks the end of a run that stopped early.
    """
    shown = turning(reference)
    if not shown:
        return None
    others = {run: turning(result) for run, result in runs.items()}
    end = max(float(curve.times[-1]) for curve in shown.values())
    figure, panels, clock = time_panels([(label, body) for body, label in shown], end, 1.45)
    name = plain(name)
    for (key, curve), axes in zip(shown.items(), panels, strict=True):
        times = clock.factor * curve.times
        if runs:
            axes.plot(times, curve.values, color=REFERENCE_COLOUR, linewidth=3.2,
                      label=f"{name} (reference)")
        else:
            draw_line(axes, times, curve.values, 0, name)
        low, high = axes.get_ylim()
        for number, (run, result) in enumerate(runs.items()):
            own = others[run].get(key)
            if own is None:
                continue
            draw_line(axes, clock.factor * own.times, own.values, number,
                      label_of(run, result.status))
            if not result.status.ok:
                axes.plot(clock.factor * own.times[-1], np.clip(own.values[-1], low, high),
                          marker="x", color=style_of(number).colour, markersize=5, clip_on=False)
        reach = 0.15 * (high - low)  # a run that left the reference must not squash the others
        axes.set_ylim(max(axes.get_ylim()[0], low - reach), min(axes.get_ylim()[1], high + reach))
        axes.set_xlim(times[0], clock.factor * end)
    legend_above(figure, panels[0].get_legend_handles_labels()[0])
    return figure


def turning(run: RunResult) -> Curves:
    """Rotation curves of a run: degrees for planar bodies, and from the start for free bodies in
    space; rad and rad/s for bodies that rotate about a fixed axis in space, computed in the run or
    prescribed by the rigid pre-simulation.

    A result contains no rates of the unknowns: the angular velocity is the derivative of the
    parabola through three stored angles. The rates of a rigid pre-simulation are stored.
    """
    found: Curves = {}
    if len(run.times) < 2:
        return found
    for b in run.layout:
        if _is_pose_of_body(run, b):
            # pose: positions, then the angle or, in more than `SPINNING_POSE`, a quaternion
            pose = run.block(b.name)
            angle = pose[:, -1]
            if b.size == PLANAR_POSE:
                found[b.owner, "angle (°)"] = Curve(run.times, np.degrees(angle))
            elif b.size > SPINNING_POSE:
                found[b.owner, "turned (°)"] = Curve(
                    run.times, np.degrees(angle_between(pose[:1], pose)))
            else:
                found |= _spin(b.owner, run.times, angle, rate_of(run.times, angle))
    stage = run.stage()
    for body in sorted(stage.moves) if stage is not None else ():
        assert stage is not None
        frame = stage.frames[body]
        if frame.pose.shape[1] == SPINNING_POSE and len(stage.times) > 1:
            found |= _spin(body, stage.times, frame.pose[:, -1], frame.rate[:, -1])
    return found


def _spin(body: str, times: FloatArray, angle: FloatArray, rate: FloatArray) -> Curves:
    return {(body, "angle (rad)"): Curve(times, angle),
            (body, "angular speed (rad/s)"): Curve(times, rate)}


def rate_of(times: FloatArray, angle: FloatArray) -> FloatArray:
    """(j,) time derivative of angles (j,) by second-order differences, exact for parabolas."""
    return np.asarray(np.gradient(angle, times, edge_order=2 if len(times) > 2 else 1))


def moving_bodies(run: RunResult) -> Poses:
    """Histories of the rigid coordinates of moving bodies: those of the rigid pre-simulation, or
    without one the unknowns of the run (bodies in space; in the plane only in scenes with
    contact)."""
    stage = run.stage()
    if stage is not None:
        return {body: (stage.times, stage.frames[body].pose) for body in sorted(stage.moves)}
    least = PLANAR_POSE if run.scene.get("contacts") else PLANAR_POSE + 1
    return {b.owner: (run.times, run.block(b.name)) for b in run.layout
            if _is_pose_of_body(run, b) and b.size >= least}


def _is_pose_of_body(run: RunResult, block: Block) -> bool:
    """True for the rigid coordinates of a body, False for those of a massless frame of a joint."""
    return (block.kind.quantity is Quantity.POSE and block.size in KNOWN
            and block.owner in run.scene.get("bodies", (block.owner,)))


def positions_figure(moving: Poses) -> "Figure | None":
    """Displacement of each body frame's origin along the axes, and rotation, over time (as Fig. 11
    of the paper); None if nothing moves.

    One panel per direction, because their magnitudes differ: a slider moves millimetres along and
    micrometres normal to its path.
    """
    panels = [LinePanel(what, "rad" if what == "turned" else "m", "", {
        body: (moving[body][0], values) for body, values in shown.items()})
        for what in _AXES if (shown := _moved(moving, what))]
    return lines_figure(panels, list(moving), 1.3)


def _moved(moving: Poses, what: str) -> dict[str, FloatArray]:
    """Body -> (j,) displacement (m) or rotation (rad) since the start; empty if nothing moves.
    moving: body -> (times, poses); what: `x moved`, `y moved`, `z moved` or `turned`.
    Columns of a pose are positions, then the angle or, in more than `SPINNING_POSE`, a
    quaternion."""
    found = {}
    for body, (_, pose) in moving.items():
        if what == "turned":
            found[body] = (angle_between(pose[:1], pose) if pose.shape[1] > SPINNING_POSE
                           else pose[:, -1] - pose[0, -1])
        elif what != "z moved" or pose.shape[1] != PLANAR_POSE:
            column = pose[:, _AXES.index(what)]
            found[body] = column - column[0]
    moves = any(np.abs(values).max(initial=0.0) > _STILL for values in found.values())
    return found if moves else {}


def contact_forces_figure(contacts: Mapping[str, Mapping[str, FloatArray]]) -> "Figure | None":
    """Normal and friction force over time (as Fig. 10 of the paper), one panel per contact; None if
    there is no contact or no step.

    contacts: as `RunResult.contacts` returns them. The initial time, at which contact may not be
    established, is omitted.
    """
    panels = [LinePanel("force", "N", name, {
        label: (h["time"][1:], h[what][1:]) for what, label in FORCES.items() if what in h})
        for name, h in contacts.items()]
    figure = lines_figure(panels, list(FORCES.values()), 1.75)
    for axes in () if figure is None else figure.axes:
        low, high = axes.get_ylim()
        axes.set_ylim(min(0.0, low), max(1.08 * high, 0.0) or 1.0)
    return figure


def joint_forces_figure(run: RunResult) -> "Figure | None":
    """Forces and moments of joints over time, the multipliers with their names and units: one panel
    per joint and unit; None if no joint has any."""
    if len(run.times) < 2:
        return None
    panels = [LinePanel("moment" if si == "N m" else "force", si, joint, {
        name: (run.times, v) for (name, u), v in values.items() if u == si})
        for joint, values in run.joint_forces().items()
        for si in dict.fromkeys(u for _, u in values)]
    return lines_figure(panels, [name for p in panels for name in p.lines], 1.4)


def probe_temperature_figure(
    run: RunResult, others: Mapping[str, RunResult] = NO_RUNS, name: str = "reference"
) -> "Figure | None":
    """Temperatures of the probes over time (as Fig. 18 of the paper), one panel per body; None if
    no probe records a temperature. others: label -> run whose values are drawn as thin lines over
    the wide, pale ones of the first run, which is labelled `name`."""
    return _probes(run, others, name, _temperatures, "temperature", "K")


def probe_displacement_figure(
    run: RunResult, others: Mapping[str, RunResult] = NO_RUNS, name: str = "reference"
) -> "Figure | None":
    """Displacement magnitude |u| of the probes of elastic bodies over time (as Fig. 20 of the
    paper), one panel per body; None if no probe records a displacement. others, name: as in
    `probe_temperature_figure`."""
    return _probes(run, others, name, _displacements, "displacement |u|", "m")


def _temperatures(run: RunResult) -> dict[str, FloatArray]:
    """Probe -> (j,) temperature, K."""
    columns = {name: run.probe_header(name).temperature for name in run.probes}
    return {name: run.probe(name)[:, column] for name, column in columns.items()
            if column is not None}


def _displacements(run: RunResult) -> dict[str, FloatArray]:
    """Probe -> (j,) displacement magnitude, m."""
    columns = {name: run.probe_header(name).displacement for name in run.probes}
    return {name: np.asarray(np.linalg.norm(run.probe(name)[:, column], axis=1))
            for name, column in columns.items() if column is not None}


def _probes(
    run: RunResult, others: Mapping[str, RunResult], label: str,
    read: Callable[[RunResult], dict[str, FloatArray]], what: str, si: str,
) -> "Figure | None":
    """Chart of the probes, one panel per body, each with its own scale, because magnitudes differ
    between bodies. others: further runs, drawn over the first one, which is called `label`; read:
    probe -> values (j,) of a run; what, si: quantity and its SI unit."""
    shown = read(run)
    if not shown or len(run.times) < 2:
        return None
    bodies: dict[str, list[str]] = {}
    for name in shown:
        bodies.setdefault(run.probe_header(name).body, []).append(name)
    # kelvin stay kelvin: nobody reads kilokelvin
    scales = {body: unit(_largest(shown[n] for n in names) if si == "m" else 0.0, si)
              for body, names in bodies.items()}
    lines = len(shown) + (1 + len(others) if others else 0)
    figure, panels, clock = time_panels(
        [(f"{what} ({scale.name})", body if len(bodies) > 1 else "")
         for body, scale in scales.items()],
        float(run.times[-1]), 1.75, 0.4 + 0.17 * -(-lines // 3))
    order, times = list(shown), clock.factor * run.times
    reduced = {title: (clock.factor * r.times, read(r)) for title, r in others.items()}
    for (body, names), axes in zip(bodies.items(), panels, strict=True):
        for name in names:
            values = scales[body].factor * shown[name]
            if others:
                axes.plot(times, values, color=style_of(order.index(name)).colour, linewidth=4.0,
                          alpha=0.3, label=name, solid_capstyle="butt")
            else:
                draw_line(axes, times, values, order.index(name), name)
        low, high = axes.get_ylim()
        for number, (own_times, own) in enumerate(reduced.values()):
            for name in (n for n in names if n in own):
                axes.plot(own_times, scales[body].factor * own[name], linewidth=0.9,
                          color=style_of(order.index(name)).colour, linestyle=dash_of(number))
        if others:  # a run that left the reference must not squash the others
            axes.set_ylim(low, high)
        axes.set_xlim(times[0], times[-1])
    legend_above(figure, [*handles_of(panels, shown), *_runs_in_legend(label, others)])
    return figure


def _runs_in_legend(name: str, others: Mapping[str, RunResult]) -> "list[Artist]":
    """Legend entries of the first run and of the others, in grey; none without others."""
    from matplotlib.lines import Line2D

    if not others:
        return []
    wide = Line2D([], [], color=REFERENCE_COLOUR, linewidth=4.0, label=f"wide: {plain(name)}")
    return [wide, *(Line2D([], [], color="black", linewidth=0.9, linestyle=dash_of(number),
                           label=label_of(title, run.status))
                    for number, (title, run) in enumerate(others.items()))]


def _largest(values: Iterable[FloatArray]) -> float:
    return max((float(np.abs(v).max()) for v in values), default=0.0)
