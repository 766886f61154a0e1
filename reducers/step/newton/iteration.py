"""Simplified Newton method for a whole step, which reuses the factorized Jacobian.

The Jacobian of an earlier state is used as long as each change is a small fraction of the previous
one; then it is recomputed. Changes are measured relative to each block's own size, and blocks whose
residual is round-off are excluded. Full steps are taken even where they increase the residual for a
moment, as at the kinks of a contact force; only if that persists is a line search used. Reused
factors and affine invariant convergence tests: Deuflhard 2011, doi 10.1007/978-3-642-23899-4, Sec.
2.1.
"""

from math import inf

import numpy as np

from sparsemor.core import FloatArray, Quantity, Status, StepFormula, StepOutcome, rate_factors
from sparsemor.reducers.step.acceptance import EPS, LEAST, MARGIN, STALLED, Tolerances, rounding
from sparsemor.reducers.step.newton.equations import Equations
from sparsemor.reducers.step.newton.memory import Linearisation, NewtonMemory

NOISE = 1e-9
"""Relative change below which the test for a cycle of two iterates is not made."""
PATIENCE = 6
"""Number of full steps that may fail to halve the smallest change before the line search begins."""
NONE = np.zeros(0)
SHORTEST = 2.0**-14
"""Smallest step length of the line search, relative to a full step."""
EXTRAPOLATION_ERROR = 1e-2
"""Relative error above which an extrapolation is no better a guess than the last state."""


def solve(
    equations: Equations, step: StepFormula, memory: NewtonMemory, tolerances: Tolerances
) -> StepOutcome:
    """One step from the extrapolated state; `memory` keeps the Jacobian and scales for the next
    step."""
    search = _Search(equations, step, memory, tolerances)
    guess = memory.past.ring.predict(memory.order)[: memory.past.n]
    if equations.layout.quaternions:
        guess = step.free + step.steer(guess - step.free)
    outcome = search.run(guess)
    if outcome.status.ok:
        search.remember(outcome)
    return outcome


class _At:
    """An iterate: x (n,) with rates v, a, residual r, and after `turn` its Newton change dx.

    moved (blocks,): relative size of the change in each block; change: the largest of these; share:
    step length, relative to a full step, that led to this iterate; fresh: True if the Jacobian is
    its own.
    """

    __slots__ = ("a", "change", "dx", "fresh", "moved", "r", "share", "v", "x")

    def __init__(self, x: FloatArray, v: FloatArray, a: FloatArray, r: FloatArray) -> None:
        self.x, self.v, self.a, self.r, self.fresh = x, v, a, r, False
        self.dx, self.moved, self.change, self.share = x, NONE, inf, 1.0


class _Search:
    def __init__(
        self, equations: Equations, step: StepFormula, memory: NewtonMemory, tol: Tolerances
    ) -> None:
        self.eq, self.step, self.memory, self.tol = equations, step, memory, tol
        self.c = (step.c1, step.c2, step.c1_first)
        self.c1, self.c2 = rate_factors(equations.layout, *self.c)
        if step.before is not None:  # second differences of first-order unknowns follow these
            self.c2[equations.layout.first] = step.c2_first
        blocks = list(equations.layout)
        self.starts = np.array([equations.layout[b.name].start for b in blocks])
        self.names = [b.name for b in blocks]
        self.judged = np.array([b.kind.order > 0 for b in blocks])
        self.prescribed = equations.prescribed(step.t)
        self.mixed = np.array([b.kind.quantity is Quantity.POSE for b in blocks])
        self.floor, self.scale = np.zeros(0), np.zeros(0)
        self.iterations, self.stall, self.least, self.cycles = 0, 0, inf, False

    # ------------------------------------------------------------------ the iteration

    def run(self, x: FloatArray) -> StepOutcome:
        at = self.at(x)
        if not np.isfinite(at.r).all():  # the extrapolation led astray
            at = self.at(self.memory.newest)
        if not np.isfinite(at.r).all():
            return self.failed(at, Status.NOT_FINITE)
        try:
            return self._iterate(at)
        except RuntimeError:
            self.memory.point = None
            return self.failed(at, Status.SINGULAR, "the Jacobian of the step is singular")

    def _iterate(self, at: _At) -> StepOutcome:
        always = self.eq.price == 0
        self._ready(at, renew=always)
        while True:
            if at.change == inf:
                return self.failed(at, Status.NOT_FINITE)
            if at.change <= self.tol.remaining:
                return self.done(at, at.dx, at.change)
            if self.iterations >= self.tol.max_iterations:
                return self.unfinished(at)
            new = self._following(at, renew=always)
            if new is None:
                return self.unfinished(at)
            if not np.isfinite(new.r).all():
                return self.failed(new, Status.NOT_FINITE)
            ratio = new.moved / np.maximum(at.moved, 1e-300)  # of each block: one may converge
            # the textbook method, a check, trusts no ratio: it goes on until nothing changes
            full = not always and new.share == 1.0  # a shortened change says nothing of the next
            if full and (left := self._left(new.moved, ratio)) <= self.tol.remaining:
                return self.done(new, new.dx, left)
            stalled = new.change >= STALLED * at.change
            if (at.fresh or always) and stalled and self._rounded(new):
                return self.done(new, 0.0 * new.dx, new.change)
            if not (always or new.fresh) and self._slow(new.change, new.change / at.change):
                if new.change >= at.change and not at.fresh:
                    new = at  # an old factor led astray
                self.turn(new, renew=True)
            self._watch(new, at)
            at = new

    def _following(self, at: _At, renew: bool) -> _At | None:
        """Next iterate with its own change: after a full step, or after a line search where full
        steps do not converge; None where no step length decreases the residual."""
        # wanders, if not in circles
        lost = self.iterations > 2 * PATIENCE and at.change > EXTRAPOLATION_ERROR
        around = self.cycles and at.change > NOISE  # a full step would lead back into the cycle
        if self.stall <= PATIENCE and not (lost or around):
            new = self.beyond(at)
            if np.isfinite(new.r).all():
                self._ready(new, renew)
                return new
            return self._shorter(at) or new
        return self._shorter(at)

    def _ready(self, at: _At, renew: bool) -> None:
        """Newton change of an iterate, with the kept factorization where it has this step's
        constants c1, c2."""
        point = self.memory.point
        self.turn(at, renew or point is None or point.c != self.c)
        self.iterations += 1

    def _left(self, moved: FloatArray, ratio: FloatArray) -> float:
        """Estimated remaining error, from the ratio of the last two changes of each block."""
        steady = np.clip(ratio, LEAST, 0.5)
        return float((moved * np.where(ratio < 0.5, steady / (1.0 - steady), 1.0)).max())

    def _slow(self, change: float, ratio: float) -> bool:
        """True if a new factorization is due: iterating with the old one would cost more."""
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
        """Line search: an iterate along the change with a smaller residual, with its own change."""
        if not at.fresh:
            self.turn(at, renew=True)
        if not len(self.scale):  # one for the whole step: under two, each way may seem to descend
            self.scale = self._scales(at.x)
        merit, share = self._merit(at.r), 1.0
        self.iterations += 1
        while share >= SHORTEST:
            new = self.beyond(at, share)
            if self._merit(new.r) <= (1.0 - 0.1 * share) * merit:
                self.turn(new, renew=True)
                return new
            share *= 0.5
        return None

    def _scales(self, x: FloatArray) -> FloatArray:
        """Reference magnitude (n,) of each row: the largest terms of its block; for rigid
        coordinates the row's own terms, because forces and torques are not comparable."""
        terms = self.memory.magnitudes @ np.abs(x)
        count = np.diff(np.append(self.starts, len(x)))
        of_block = np.repeat(self._largest(terms), count)
        return np.maximum(np.where(np.repeat(self.mixed, count), terms, of_block), 1e-300)

    def _merit(self, r: FloatArray) -> float:
        value = float(np.abs(r / self.scale).max())
        return value if value == value else inf

    # ------------------------------------------------------------------ residual and change

    def at(self, x: FloatArray) -> _At:
        """The first iterate of the step, at x."""
        return self._evaluated(*self.step.at(x - self.step.free))

    def done(self, at: _At, d: FloatArray, remaining: float) -> StepOutcome:
        """The solution of the step, a change d beyond an iterate, with its estimated error."""
        return StepOutcome(at.x - d, Status.DONE, self.iterations, remaining=remaining,
                           rates=(at.v - self.c1 * d, at.a - self.c2 * d))

    def beyond(self, at: _At, share: float = 1.0) -> _At:
        """The iterate after a fraction of the change.

        Its rates are updated by the change, because c2 x + r2 would lose digits: x of size 1 is
        rounded to 1e-16, and c2 = 1/(beta h^2) may be 1e10.
        """
        d = share * at.dx
        new = self._evaluated(at.x - d, at.v - self.c1 * d, at.a - self.c2 * d)
        new.share = share
        return new

    def _evaluated(self, x: FloatArray, v: FloatArray, a: FloatArray) -> _At:
        return _At(x, v, a, self.eq.residual(x, v, a, self.step.t, self.prescribed))

    def turn(self, at: _At, renew: bool) -> None:
        """Newton change at an iterate; renew: True for its own Jacobian, False for the kept one."""
        m = self.memory
        if renew:
            m.point = Linearisation(at.x, at.v, at.a, self.step.t, self.c)
            m.factor = None
            m.factorizations += 1
        if m.factor is None:
            p = m.point
            assert p is not None
            J = self.eq.jacobian(p.x, p.v, p.a, p.t, self.c1, self.c2)
            m.factor, m.magnitudes, self.floor = self.eq.factorize(J), abs(J), np.zeros(0)
        if not len(self.floor):
            self.floor = 16.0 * EPS * self._sizes(at.x)
        at.fresh, at.dx = renew, m.factor.solve(at.r)
        at.moved = self._moved(at)
        at.change = float(at.moved.max())
        if not at.change < inf:
            at.change = inf

    def _rounded(self, at: _At) -> bool:
        """True if the change is not above the effect of rounding the terms of the residual, in each
        block that has not converged: J^-1 (eps |J| |x|), with random signs. Constraints subtract
        positions of size 1 from each other, which |J| |x| may underestimate."""
        terms = self.memory.magnitudes @ np.abs(at.x)
        count = np.diff(np.append(self.starts, len(terms)))
        terms = np.where(np.repeat(self.judged, count), terms, np.maximum(terms, 1.0))
        factor = self.memory.factor
        assert factor is not None
        noise = factor.solve(rounding(len(terms)) * terms)
        small = self._largest(at.dx) <= MARGIN * self._largest(noise)
        return bool((small | (at.moved <= self.tol.remaining)).all())

    def _sizes(self, x: FloatArray) -> FloatArray:
        """Magnitude (blocks,) of the terms of the residual: largest |J| |x| of each block."""
        return self._largest(self.memory.magnitudes @ np.abs(x))

    def _largest(self, x: FloatArray) -> FloatArray:
        return np.maximum.reduceat(np.abs(x), self.starts)

    def _moved(self, at: _At) -> FloatArray:
        """Relative change (blocks,); 0 for multipliers, which follow from the other unknowns, and
        where the residual is round-off."""
        judged = self.judged
        if self.eq.price:
            judged = judged & ~(self._largest(at.r) <= self.floor)
        return np.where(judged, self._relative(at), 0.0)

    def _relative(self, at: _At) -> FloatArray:
        size = np.maximum(self._largest(at.x), self._largest(at.x - at.dx))
        return self._largest(at.dx) / np.maximum(np.maximum(self.memory.top, size), 1e-300)

    # ------------------------------------------------------------------ how it ends

    def remember(self, outcome: StepOutcome) -> None:
        m, x = self.memory, outcome.x
        m.top = np.maximum(m.top, self._largest(x))
        guesses = m.past.ring.guesses()[:, : len(x)]
        off = np.maximum.reduceat(np.abs(guesses - x), self.starts, axis=1)
        missed = (off / np.maximum(m.top, 1e-300))[:, self.judged].max(axis=1, initial=0.0)
        m.past.push(x, x - self.step.free)
        # a motion that no order came close to is not extrapolated
        m.order = int(missed.argmin()) + 1 if missed.min() <= EXTRAPOLATION_ERROR else 1

    def failed(self, at: _At, status: Status, detail: str = "") -> StepOutcome:
        broken = ~np.isfinite(self._largest(at.r))
        block = self.names[int(np.argmax(broken))] if broken.any() else ""
        return StepOutcome(at.x, status, self.iterations, block, self._with_names(detail, block))

    def unfinished(self, at: _At) -> StepOutcome:
        moved = np.where(self.judged, self._relative(at), 0.0)
        block = self.names[int(np.argmax(moved))]
        how = ("the iteration goes back and forth between two states" if self.cycles else
               f"last relative change {at.change:.1e} after {self.iterations} iterations")
        return StepOutcome(at.x, Status.NOT_CONVERGED, self.iterations, block,
                           self._with_names(how, block))

    def _with_names(self, detail: str, block: str) -> str:
        """The detail, extended by the names of the terms that couple this block to others."""
        names = [n for n, blocks in self.eq.named if n and (not block or block in blocks)]
        if not names:
            return detail
        reason = f"{', '.join(names)} changes too much in one step"
        return f"{detail}: {reason}" if detail else reason
