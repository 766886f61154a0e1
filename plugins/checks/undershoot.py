"""Temperature undershoot: stored temperatures below every initial, prescribed and surrounding
one."""

from collections.abc import Mapping

import numpy as np

from sparsemor.core import (
    Check,
    Connector,
    Findings,
    FloatArray,
    IntArray,
    Model,
    Note,
    Part,
    PreparedRun,
    RunResult,
    Term,
    information,
)
from sparsemor.core.protocols.separable import HeatBody, amplitudes_along
from sparsemor.plugins.checks import place

SHARE, LARGE = 1e-3, 0.1
"""Smallest undershoot that is reported, relative to the range of temperatures; undershoot from
which it is a warning and not information, relative to the lowest admissible temperature (K)."""
FIRST, STEPS = 16, 48
"""Number of stored steps that are checked: the first ones, where heat that enters fast is resolved
least, and others, evenly spread over the run."""
ROUND = 1e-9
"""Undershoot relative to the highest temperature that is taken as round-off."""


class Undershoot(Check):
    """Temperatures below every initial, prescribed and surrounding one."""

    order = place("undershoot")

    def after_run(self, run: PreparedRun, result: RunResult) -> Findings:
        return Findings(() if run.model is None or not run.own_loads else undershoot(
            run.model, result))


def undershoot(model: Model, result: RunResult) -> tuple[Note, ...]:
    """Note for each body whose temperature falls below every initial, prescribed and surrounding
    one (floor); none if any load may cool a body further, such as a negative heat flux, or rates of
    strain (_strained)."""
    if not model.separated.heat or not len(result.times):
        return ()
    floor = _floor(model, result.times)
    if _strained(model) or any(
            _cooled(model.parts, b, result.times) for b in model.separated.heat):
        return ()
    steps = _looked_at(len(result.times))
    lowest: dict[str, tuple[float, float]] = {}
    top = floor
    for b in model.separated.heat:
        T = result.block(b.thermal, steps)
        if not T.size or not np.isfinite(T).all():
            continue
        top = max(top, float(T.max()))
        at = int(T.min(axis=1).argmin())
        lowest[b.name] = float(T[at].min()), float(result.times[steps[at]])
    return tuple(
        _note(name, T, t, floor, top) for name, (T, t) in lowest.items()
        if floor - T > max(SHARE * (top - T), ROUND * abs(top)))


def _note(body: str, T: float, t: float, floor: float, top: float) -> Note:
    """Note on a body whose temperature T, K, falls below `floor`; a small undershoot is
    information."""
    share = 100 * (floor - T) / (top - T)
    avoid = (f"bodies.{body}.capacity: lumped (linear elements only), a finer mesh where heat "
             "enters, or a longer time.step")
    if floor <= 0.0 or floor - T < LARGE * floor:
        return information(
            f"body {body}: heat enters faster than its elements resolve, so that temperatures fall "
            f"up to {floor - T:.3g} K below the lowest initial, prescribed or surrounding one "
            f"({share:.2g} % of their range, {T:.4g} K at {t:.4g} s); this is avoided by {avoid}; "
            "in a reduced run it may be the basis", "undershoot")
    return Note(
        f"body {body}: its temperature falls to {T:.4g} K at {t:.4g} s, {floor - T:.3g} K below "
        f"every initial, prescribed and surrounding one (at least {floor:.4g} K), {share:.2g} % of "
        "the range of temperatures. A consistent capacity matrix causes this where heat enters "
        f"faster than the elements resolve: use {avoid}; in a reduced run it may be the basis: "
        "take more atoms of its temperatures", "undershoot")


def _looked_at(count: int) -> IntArray:
    """Numbers of the stored steps that are examined: the first ones, and others evenly spread."""
    spread = np.linspace(0, count - 1, min(STEPS, count)).round().astype(np.int64)
    return np.unique(np.concatenate([np.arange(min(FIRST, count)), spread]))


def _floor(model: Model, times: FloatArray) -> float:
    """Lowest initial, prescribed or surrounding temperature of the model, K."""
    found = [float(model.x0[model.layout[b.thermal]].min(initial=np.inf))
             for b in model.separated.heat]
    for part in model.connectors.values():
        if part.surroundings is not None:
            found.append(float(amplitudes_along((part.surroundings,), times).min()))
    for shape in model.shapes().values():
        if shape.given:  # shapes over the nodes times functions of time
            held = shape.given_shapes[shape.given_shapes.any(axis=1)]
            found.append(float((shape.given_at(times) @ held.T).min()))
    return min(found)


def _strained(model: Model) -> bool:
    """True if rates of other unknowns, such as strains, may take heat from a body."""
    hot = model.layout.first
    return any(term.linear and bool(((term.rows >= hot.start) & (term.rows < hot.stop)).any())
               and not bool(((term.columns >= hot.start) & (term.columns < hot.stop)).all())
               for term in model.separated.between)


def _cooled(parts: Mapping[str, Part], b: HeatBody, times: FloatArray) -> bool:
    """True if some load or term may take heat from a body whatever its temperature."""
    if any(_may_cool(parts, b, term) for term in b.local):
        return True
    if any(t.columns.data.min(initial=0.0) < 0.0 or t.table.values.min(initial=0.0) < 0.0
           for t in b.tables):
        return True
    amounts = amplitudes_along(b.amplitudes, times)  # (times, j): factors of the j load vectors
    for i, column in enumerate(b.columns):
        part = parts.get(column.name)
        # such loads take heat down to a temperature that `_floor` counts
        tied = isinstance(part, Connector) and part.surroundings is not None
        if not (tied or column.prescribed) and np.outer(
                (b.loads[:, i].min(), b.loads[:, i].max()), amounts[:, i]).min() < 0.0:
            return True
    return False


def _may_cool(parts: Mapping[str, Part], b: HeatBody, term: Term) -> bool:
    """True unless a local term belongs to the body itself, such as its conductivity, or to a load
    that ties it to an ambient temperature."""
    part = parts.get(term.source)
    if isinstance(part, Connector):
        return part.surroundings is None
    return part is None or part.name != b.name
