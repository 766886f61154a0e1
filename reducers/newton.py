"""Newton's method for a whole step at once, with a factor of the Jacobian that is kept.

The factor of an earlier state serves as long as each change is a small share of the one before;
then it is made anew. Changes are judged by each block's own size, and a block whose residual is
rounding is not judged at all. Full steps are taken even where they make things worse for a moment,
as they do at the kinks of a contact; only where that does not end is the residual made to fall, by
shorter steps. Kept factors and affine invariant tests: Deuflhard 2011,
doi 10.1007/978-3-642-23899-4, Sec. 2.1.
"""

from collections.abc import Sequence
from math import inf
from typing import Any, Protocol

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.equations import rate_factors
from sparsemor.core.layout import Layout
from sparsemor.core.protocols import StepFormula, StepOutcome
from sparsemor.core.status import Status
from sparsemor.reducers.bordered import Tolerances
from sparsemor.reducers.newton_memory import NewtonMemory, Place

STALLED = 0.25
"""Changes that shrink by less than this under a new factor: rounding, or a kink."""
NOISE = 1e-9
"""Relative change below which a stalled iteration is rounding."""
PATIENCE = 6
"""Full steps that may fail to halve the smallest change before the residual is made to fall."""
NONE = np.zeros(0)
SHORTEST = 2.0**-7
"""Least share of a full step that is tried."""
FORETOLD = 1e-2
"""Relative error of an extrapolation that is still better than the last state itself."""
EPS = float(np.finfo(np.float64).eps)


class Equations(Protocol):
    """One model's equations: n rows for the n unknowns of `layout`.

    price: of a new factor, in iterations with the old one; 0: a new one in each iteration.
    """

    @property
    def layout(self) -> Layout: ...
    @property
    def price(self) -> int: ...
    @property
    def named(self) -> Sequence[tuple[str, frozenset[str]]]:
        """What couples the blocks: its name in the scene, and the blocks."""
        ...

    def given(self, t: float) -> FloatArray:
        """(n,) the part of the residual that depends on the time (s) alone."""
        ...

    def residual(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, given: FloatArray
    ) -> FloatArray: ...
    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Any:
        """(n, n), dense or csc; c1, c2 (n,) a unknown."""
        ...

    def factorize(self, J: Any) -> Any:
        """Something with `solve(r)`. Raises RuntimeError when J is singular."""
        ...


def solve(
    equations: Equations, step: StepFormula, memory: NewtonMemory, tolerances: Tolerances
) -> StepOutcome:
    """One step from the extrapolated state; `memory` keeps what the next one needs of it."""
    search = _Search(equations, step, memory, tolerances)
    outcome = search.run(memory.ring.predict(memory.order))
    if outcome.status.ok:
        search.remember(outcome.x)
    return outcome


class _At:
    """An iterate: x (n,), its residual r, and after `turn` its change dx; moved (blocks,): how
    large that is in each block, change: the largest."""

    __slots__ = ("change", "dx", "fresh", "moved", "r", "x")

    def __init__(self, x: FloatArray, r: FloatArray) -> None:
        self.x, self.r, self.fresh = x, r, False
        self.dx, self.moved, self.change = x, NONE, inf


class _Search:
    def __init__(
        self, equations: Equations, step: StepFormula, memory: NewtonMemory, tol: Tolerances
    ) -> None:
        self.eq, self.step, self.memory, self.tol = equations, step, memory, tol
        self.c = (step.c1, step.c2, step.c1_first)
        self.c1, self.c2 = rate_factors(equations.layout, *self.c)
        blocks = list(equations.layout)
        self.starts = np.array([equations.layout[b.name].start for b in blocks])
        self.names = [b.name for b in blocks]
        self.judged = np.array([b.field != "multiplier" for b in blocks])
        self.given = equations.given(step.t)
        self.mixed = np.array([b.field == "rigid" for b in blocks])
        self.floor, self.scale = np.zeros(0), np.zeros(0)
        self.iterations, self.stall, self.least, self.cycles = 0, 0, inf, False

    # ------------------------------------------------------------------ the iteration

    def run(self, x: FloatArray) -> StepOutcome:
        at = self.at(x)
        if not np.isfinite(at.r).all():  # the extrapolation led astray
            at = self.at(self.memory.ring.rows[self.memory.ring.newest])
        if not np.isfinite(at.r).all():
            return self.failed(at, Status.NOT_FINITE)
        try:
            return self._iterate(at)
        except RuntimeError:
            self.memory.place = None
            return self.failed(at, Status.SINGULAR, "the Jacobian of the step is singular")

    def _iterate(self, at: _At) -> StepOutcome:
        always = self.eq.price == 0
        self._ready(at, anew=always)
        while True:
            if at.change == inf:
                return self.failed(at, Status.NOT_FINITE)
            if at.change <= self.tol.remaining:
                return StepOutcome(at.x - at.dx, Status.DONE, self.iterations)
            if self.iterations >= self.tol.max_iterations:
                return self.unfinished(at)
            new = self._following(at, anew=always)
            if new is None:
                return self.unfinished(at)
            if not np.isfinite(new.r).all():
                return self.failed(new, Status.NOT_FINITE)
            ratio = new.moved / np.maximum(at.moved, 1e-300)  # of each block: one may converge
            # the textbook method, a check, trusts no ratio: it goes on until nothing changes
            if not always and self._left(new.moved, ratio) <= self.tol.remaining:
                return StepOutcome(new.x - new.dx, Status.DONE, self.iterations)
            stalled = new.change >= STALLED * at.change
            if (at.fresh or always) and stalled and new.change <= NOISE:
                return StepOutcome(new.x, Status.DONE, self.iterations)
            if not (always or new.fresh) and self._slow(new.change, new.change / at.change):
                if new.change >= at.change and not at.fresh:
                    new = at  # an old factor led astray
                self.turn(new, anew=True)
            self._watch(new, at)
            at = new

    def _following(self, at: _At, anew: bool) -> _At | None:
        """The next iterate with its own change: a full step on, or less where full steps lead
        nowhere; None where no share of the change makes the residual fall."""
        lost = self.iterations > 2 * PATIENCE and at.change > FORETOLD  # wanders, if not in circles
        if self.stall <= PATIENCE and not lost:
            new = self.at(at.x - at.dx)
            if np.isfinite(new.r).all():
                self._ready(new, anew)
                return new
            return self._shorter(at) or new
        return self._shorter(at)

    def _ready(self, at: _At, anew: bool) -> None:
        """The next change, with the kept factor where there is one for this step's constants."""
        place = self.memory.place
        self.turn(at, anew or place is None or place.c != self.c)
        self.iterations += 1

    def _left(self, moved: FloatArray, ratio: FloatArray) -> float:
        """The change that is left to come, by the ratio of the last two."""
        steady = np.minimum(ratio, 0.5)
        return float((moved * np.where(ratio < 0.5, steady / (1.0 - steady), 1.0)).max())

    def _slow(self, change: float, ratio: float) -> bool:
        """Whether a new factor is due: the old one would take longer than its price."""
        return ratio >= 0.5 or change * ratio**self.eq.price > self.tol.remaining

    def _watch(self, at: _At, before: _At) -> None:
        """Counts the iterations since the smallest change was last halved."""
        if at.change < 0.5 * self.least:
            self.least, self.stall = at.change, 0
            return
        self.stall += 1
        back = self._largest(at.x - at.dx - before.x) <= 1e-2 * self._largest(at.dx)
        if at.change > NOISE and back[self.judged].all():
            self.cycles, self.stall = True, PATIENCE + 1

    def _shorter(self, at: _At) -> _At | None:
        """An iterate on the way along the change whose residual is less, with its own change."""
        if not at.fresh:
            self.turn(at, anew=True)
        if not len(self.scale):  # one for the whole step: under two, each way may seem to descend
            self.scale = self._scales(at.x)
        merit, share = self._merit(at.r), 1.0
        self.iterations += 1
        while share >= SHORTEST:
            new = self.at(at.x - share * at.dx)
            if self._merit(new.r) <= (1.0 - 0.1 * share) * merit:
                self.turn(new, anew=True)
                return new
            share *= 0.5
        return None

    def _scales(self, x: FloatArray) -> FloatArray:
        """(n,) what each row is measured by: the largest terms of its block, of rigid coordinates
        its own ones, because forces and torques are not to be compared."""
        terms = self.memory.size @ np.abs(x)
        count = np.diff(np.append(self.starts, len(x)))
        of_block = np.repeat(self._largest(terms), count)
        return np.maximum(np.where(np.repeat(self.mixed, count), terms, of_block), 1e-300)

    def _merit(self, r: FloatArray) -> float:
        value = float(np.abs(r / self.scale).max())
        return value if value == value else inf

    # ------------------------------------------------------------------ residual and change

    def at(self, x: FloatArray) -> _At:
        s = self.step
        return _At(x, self.eq.residual(
            x, self.c1 * x + s.r1, self.c2 * x + s.r2, s.t, self.given))

    def turn(self, at: _At, anew: bool) -> None:
        """The change at an iterate; anew: with the Jacobian there, else with the kept one."""
        m = self.memory
        if anew:
            s = self.step
            m.place = Place(
                at.x, self.c1 * at.x + s.r1, self.c2 * at.x + s.r2, s.t, self.c)
            m.factor = None
            m.factorizations += 1
        if m.factor is None:
            p = m.place
            assert p is not None
            J = self.eq.jacobian(p.x, p.v, p.a, p.t, self.c1, self.c2)
            m.factor, m.size, self.floor = self.eq.factorize(J), abs(J), np.zeros(0)
        if not len(self.floor):
            self.floor = 16.0 * EPS * self._sizes(at.x)
        at.fresh, at.dx = anew, m.factor.solve(at.r)
        at.moved = self._moved(at)
        at.change = float(at.moved.max())
        if not at.change < inf:
            at.change = inf

    def _sizes(self, x: FloatArray) -> FloatArray:
        """(blocks,) what the residual's terms are as large as: |J| |x|, largest of each block."""
        return self._largest(self.memory.size @ np.abs(x))

    def _largest(self, x: FloatArray) -> FloatArray:
        return np.maximum.reduceat(np.abs(x), self.starts)

    def _moved(self, at: _At) -> FloatArray:
        """(blocks,) change of each relative to its size; 0 for multipliers, which follow, and where
        the residual is rounding."""
        judged = self.judged
        if self.eq.price:
            judged = judged & ~(self._largest(at.r) <= self.floor)
        return np.where(judged, self._relative(at), 0.0)

    def _relative(self, at: _At) -> FloatArray:
        size = np.maximum(self._largest(at.x), self._largest(at.x - at.dx))
        return self._largest(at.dx) / np.maximum(np.maximum(self.memory.top, size), 1e-300)

    # ------------------------------------------------------------------ how it ends

    def remember(self, x: FloatArray) -> None:
        m = self.memory
        m.top = np.maximum(m.top, self._largest(x))
        off = np.maximum.reduceat(np.abs(m.ring.guesses() - x), self.starts, axis=1)
        missed = (off / np.maximum(m.top, 1e-300))[:, self.judged].max(axis=1, initial=0.0)
        m.ring.push(x)
        # nothing is foretold of a motion that no order came close to
        m.order = int(missed.argmin()) + 1 if missed.min() <= FORETOLD else 1

    def failed(self, at: _At, status: Status, detail: str = "") -> StepOutcome:
        broken = ~np.isfinite(self._largest(at.r))
        block = self.names[int(np.argmax(broken))] if broken.any() else ""
        return StepOutcome(at.x, status, self.iterations, block, self._told(detail, block))

    def unfinished(self, at: _At) -> StepOutcome:
        moved = np.where(self.judged, self._relative(at), 0.0)
        block = self.names[int(np.argmax(moved))]
        how = ("the iteration goes back and forth between two states" if self.cycles else
               f"last relative change {at.change:.1e} after {self.iterations} iterations")
        return StepOutcome(at.x, Status.NOT_CONVERGED, self.iterations, block,
                           self._told(how, block))

    def _told(self, detail: str, block: str) -> str:
        """With the names of what acts between this block and others."""
        names = [n for n, blocks in self.eq.named if n and (not block or block in blocks)]
        if not names:
            return detail
        acting = f"{', '.join(names)} changes too much in one step"
        return f"{detail}: {acting}" if detail else acting
