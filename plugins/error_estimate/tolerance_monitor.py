"""Actions of a reduced run whose estimated error exceeds a tolerance: the comparison with the
tolerance, and the same run at full order.

The relative error of a block is its estimate over the largest change of the block, in the run so
far or in training, whichever is larger: at the start of a run the change is almost nothing.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from sparsemor.core import Dictionary, ErrorLimit, State, StepSolver
from sparsemor.core.arrays import FloatArray
from sparsemor.core.notes import Note
from sparsemor.core.protocols.layout import Layout
from sparsemor.core.results.probes import ProbeReader
from sparsemor.core.scene.default_plugins import FULL_ORDER
from sparsemor.core.simulation.offline import Offline
from sparsemor.core.simulation.prepared_run import PreparedRun
from sparsemor.core.simulation.step_control import controlled
from sparsemor.core.simulation.time_stepping import problem_of
from sparsemor.core.status import SolveFailed


@dataclass(frozen=True, slots=True)
class Exceeded:
    """Reason why a run leaves its reduced model at t, s: the block, and its estimated relative
    error, or the status of a step that failed."""

    t: float
    block: str
    reason: str

    @classmethod
    def read(cls, stored: Mapping[str, str | float]) -> "Exceeded":
        """The reason that a result keeps (`RunHeader.fall_back`)."""
        return cls(float(stored["time"]), str(stored["block"]), str(stored["reason"]))

    @classmethod
    def failed(cls, failure: SolveFailed) -> "Exceeded":
        where = f" in {failure.block}" if failure.block else ""
        return cls(failure.time, failure.block, f"a step of the reduced model ended as "
                   f"{failure.status.value}{where} at {failure.time:.4g} s")

    def note(self) -> Note:
        return Note(f"from {self.t:.4g} s on the run was solved at full order: {self.reason}",
                    "fell_back")


class ErrorMonitor:
    """Comparison of the estimated errors of a run with their tolerance, relative to the largest
    change of each block (2-norm over its full-order unknowns). changes: `ErrorRecord.changes`,
    block -> largest change, which it brings up to date; every: steps from one estimate to the next.
    """

    def __init__(
        self, limit: ErrorLimit, run: PreparedRun, start: State, changes: dict[str, float]
    ) -> None:
        self.limit, self._layout, self._start = limit, run.solver.layout, start.x
        self.changes = changes
        assert run.estimator is not None
        blocks, self.every = run.estimator.blocks, run.estimator.every
        bases = {n: run.solver.dictionaries.get(n) for n in blocks}
        self._lengths = {n: np.eye(run.solver.layout.block(n).size) if d is None else lengths(
            d.atoms) for n, d in bases.items()}

    def exceeded(self, state: State, errors: Mapping[str, float]) -> Exceeded | None:
        """The block with the largest relative error, if that is above the tolerance. state: of the
        step solver; errors: block -> norm of its estimated error over its full-order unknowns."""
        worst, block = 0.0, ""
        for name, R in self._lengths.items():  # |R c| = |atoms c|
            at = self._layout[name]
            change = state.x[at] - self._start[at]
            used = np.flatnonzero(change)  # few of many atoms
            moved = float(np.linalg.norm(R[:, used] @ change[used]))
            self.changes[name] = size = max(self.changes[name], moved)
            ratio = errors[name] / size if size > 0.0 else 0.0
            if not ratio <= worst:  # true for what is not a number, too
                worst, block = ratio, name
        if worst <= self.limit.tolerance:
            return None
        return Exceeded(state.t, block, f"the estimated error of {block} reaches {worst:.2g} of "
                        f"its largest change at {state.t:.4g} s (tolerance "
                        f"{self.limit.tolerance:g})")


def lengths(atoms: FloatArray) -> FloatArray:
    """Matrix R (m, k) with |R c| = |atoms c|: the triangle of few atoms (n, k), and the atoms
    themselves if these are many, whose factorization takes minutes."""
    n, k = atoms.shape
    return atoms if 2 * k > n else np.asarray(np.linalg.qr(atoms, mode="r"))


def at_full_order(run: PreparedRun, why: Exceeded) -> PreparedRun:
    """The same run with the full-order step solver, for the steps after `why.t`. Raises
    SolveFailed where an operator cannot be factorized."""
    model, scene = run.model, run.scene
    assert model is not None
    # probes, and what checks keep of the reduced model (`kept`), are replaced below
    full = scene.using({"reducer": FULL_ORDER, "probes": {}})
    offline = Offline.from_snapshots(model, {})
    solver: StepSolver = full.reducer.prepare(problem_of(full, model, offline))
    solver = controlled(full, model, offline, solver)
    return replace(
        run, solver=solver, kept={}, trained_to=None, notes=(*run.notes, why.note()),
        probes=tuple(ProbeReader.at_place(p, solver.layout, {}) for p in model.probes),
        header=replace(run.header, layout=solver.layout, dictionaries={}, rows={}, fall_back={
            "time": why.t, "block": why.block, "reason": why.reason}))


def expanded(
    state: State, layout: Layout, dictionaries: Mapping[str, Dictionary], full: Layout
) -> State:
    """State of a reduced model, with the layout `layout`, in the unknowns `full` of the full-order
    one: x = offset + atoms c."""
    x, v, a = (np.zeros(full.size) for _ in range(3))
    for b in layout:
        here, there, d = layout[b.name], full[b.name], dictionaries.get(b.name)
        parts: tuple[FloatArray, ...] = (state.x[here], state.v[here], state.a[here])
        if d is not None:
            parts = d.offset + d.atoms @ parts[0], d.atoms @ parts[1], d.atoms @ parts[2]
        x[there], v[there], a[there] = parts
    return State(state.t, x, v, a, np.zeros((full.size, 0)))
