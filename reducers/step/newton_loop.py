"""Iteration of a step: Newton's method with a kept Jacobian, for every reducer.

The unknown is the departure d (n,) from the free motion of the step (core/protocols/integrator.py):
x = free + d, x' = free_rate + c1 d, x'' = c2 d. An iteration is one residual and one solve,

    d <- d - J^-1 F(d),

with the Jacobian J of an earlier iterate or an earlier step (chord method; Deuflhard 2011, doi
10.1007/978-3-642-23899-4, Sec. 2.1). J is renewed where it contracts too slowly, or when the
iterations that it has cost in excess of its best step reach its price. The iteration ends when the
error estimated from two changes of this step is below the tolerance (convergence_test.py), relative
to the largest values of each block so far. In space the Jacobian turns with each body,

    d <- d - L J^-1 L^T F(d),   L: identity but for quaternions, which it turns from there to here,

because inertias and lever arms are constant in body axes. Of a slender body the moment of inertia
about its axis is a hundredth of that across: without L, J fails after a turn by one degree. Full
steps are taken even where they increase the residual for a moment, as at the kinks of a contact
force; only if that persists is a line search used.

A *change* is J^-1 F(d), in each block relative to the largest value that the block has had; *fresh*
is a Jacobian of the iterate itself; a block is *judged* if its change must converge: joint forces
are not, they follow from the other unknowns.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import repeat
from math import inf
from types import MappingProxyType
from typing import Any, NamedTuple, Self

import numpy as np

from sparsemor.core import (
    BoolArray,
    FloatArray,
    IntArray,
    Layout,
    Quantity,
    Status,
    StepFormula,
)
from sparsemor.core.protocols.poses import turns
from sparsemor.reducers.step.convergence_test import (
    ACCELERATION_ERROR,
    EPS,
    LEAST,
    MARGIN,
    NEGLIGIBLE,
    STALLED,
    TRUSTED,
    Tolerances,
    estimated_error,
    rounding,
)
from sparsemor.reducers.step.jacobian_factors import Factor

CYCLE = 1e-9
"""Relative change below which the test for a cycle of two iterates is not made."""
PATIENCE = 6
"""Number of full steps that may fail to halve the smallest change before the line search begins."""
SHORTEST = 2.0**-14
"""Smallest step length of the line search, relative to a full step."""
WANDERING = 1e-2
"""Relative change above which an iteration that takes long counts as lost."""
SLOW = 0.5
"""Ratio of consecutive changes from which the Jacobian is renewed at once."""
DOUBTFUL = 1e-12
"""First relative change with a new Jacobian up to which it is compared with round-off."""
UNKNOWN = 10**6


class Linearisation(NamedTuple):
    """State at which a Jacobian was evaluated, x (n,) with rates v, a at t (s), and the factors of
    its step: c1, c2, c1 of first-order unknowns and c2 of these."""

    x: FloatArray
    v: FloatArray
    a: FloatArray
    t: float
    c: tuple[float, float, float, float]


class StepEquations(ABC):
    """Equations F(d) = 0 of one step of a model of n unknowns.

    price: cost of a new Jacobian in iterations with the old one; 1: a new one in each step; 0: in
    each iteration. exact: False if `jacobian` neglects terms, so that an iteration which it does
    not contract is given up. least: lower bound of the ratio of two changes (convergence_test.py).
    solved: unknowns for which J is not the identity. named: terms that couple blocks: name in the
    scene, and the coupled blocks. elements: number of elements that a residual visits. Of iterative
    linear solvers in the last step, iterations: block -> their number; failed: block, status and
    message of one that did not converge.
    """

    layout: Layout
    price: int
    exact: bool = True
    least: float = LEAST
    solved: IntArray | slice = slice(None)
    named: Sequence[tuple[str, frozenset[str]]]
    elements: int = 0
    iterations: Mapping[str, int] = MappingProxyType({})
    failed: tuple[str, Status, str] | None = None

    @abstractmethod
    def working(self, memory: Any = None) -> Self:
        """These equations with working arrays, and local copies of terms in `memory`, of one run or
        thread."""

    @abstractmethod
    def begin(self, step: StepFormula, d: FloatArray) -> None:
        """Takes over the constants of a step; d: the first guess of its departure."""

    def solution(self, d: FloatArray) -> FloatArray | None:
        """Departure (n,) that solves the step, from the guess d (n,), where that takes one solve
        with a constant matrix; None where it takes an iteration."""
        return None

    @abstractmethod
    def residual(self, d: FloatArray, slope: bool = False) -> FloatArray:
        """Residual (n,) at the departure d (n,). slope: True if the Jacobian there comes next, so
        that what both need may be kept."""

    @abstractmethod
    def jacobian(self, at: Linearisation) -> Any:
        """Jacobian of the unknowns `solved`, dense or csc."""

    @abstractmethod
    def factorize(self, J: Any) -> Factor:
        """Factorization of a Jacobian. Raises RuntimeError where it is singular."""

    def magnitudes(self, J: Any, x: FloatArray) -> FloatArray:
        """Magnitudes (n,) of the terms of the equations at the unknowns x (n,), |J| |x|."""
        sizes, at = np.abs(x), self.solved
        sizes[at] = abs(J) @ sizes[at]
        return sizes

    def rounding(self, J: Any, at: Linearisation) -> FloatArray:
        """Errors (n,) of the residual due to rounding of its terms, with random signs. Constraints
        subtract positions of size 1 from each other, which |J| |x| may underestimate; temperatures
        are sums of free motion and departure, which in steps far beyond their time scales cancel.
        """
        x, first, fixed = np.abs(at.x), self.layout.first, self.layout.algebraic
        x[first] += np.abs(at.v[first]) / (at.c[2] or 1.0)
        sizes = self.magnitudes(J, x)
        sizes[fixed] = np.maximum(sizes[fixed], 1.0)
        return rounding(len(sizes)) * sizes

    def contraction(self, point: Linearisation) -> float:
        """Proved upper bound, in the Euclidean norm, of the ratio of two changes of this step with
        the Jacobian at a point; 0 if one change solves it, inf where no bound is known."""
        return inf


@dataclass(eq=False)
class KeptJacobian:
    """What an iteration keeps from step to step.

    point: state at which the kept Jacobian was evaluated; J, factor, noise: it, its factorization,
    and the changes (blocks,) that are due to rounding, which are computed there again after a
    restart, so that a resumed run repeats every digit; floor: largest relative change that may be
    negligible against these. least: smallest number of iterations of a
    step with it; debt: iterations beyond that. top, rate (blocks,): largest value of each block so
    far, and of its highest rates. factorizations: number of Jacobians.
    """

    top: FloatArray
    rate: FloatArray
    point: Linearisation | None = None
    least: int = UNKNOWN
    debt: int = 0
    factorizations: int = 0
    J: Any = None
    factor: Factor | None = None
    floor: float = inf
    noise: FloatArray = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def empty(cls, blocks: int) -> "KeptJacobian":
        return cls(np.zeros(blocks), np.zeros(blocks))

    def __getstate__(self) -> dict[str, object]:
        return {"top": self.top, "rate": self.rate, "least": self.least, "debt": self.debt,
                "factorizations": self.factorizations, "point": self.point and tuple(self.point)}

    def __setstate__(self, state: dict[str, object]) -> None:
        point = state["point"]
        vars(self).update(
            state, point=Linearisation(*point) if isinstance(point, tuple) else None,
            J=None, factor=None, noise=np.zeros(0), floor=inf)

    def copy(self) -> "KeptJacobian":
        """Independent copy; the factorization is immutable and shared."""
        return replace(self, top=self.top.copy(), rate=self.rate.copy())

    def forget(self) -> None:
        """The next iteration has a new Jacobian."""
        self.point, self.factor, self.J = None, None, None


class Ended(NamedTuple):
    """How an iteration ended; remaining: estimated relative error; block, detail: of a failure."""

    d: FloatArray
    status: Status
    iterations: int
    remaining: float = 0.0
    block: str = ""
    detail: str = ""


class _Iterate:
    """Departure d (n,) with its residual r, and after `_newton_change` its Newton change dx (n,):
    the next iterate is d - dx.

    absolute (blocks,): largest magnitude of the change in each block; relative (blocks,): that
    relative to the size of each block; change: the largest of these; share: step length, relative
    to a full step, that led here; fresh: True if the Jacobian is its own.
    """

    __slots__ = ("absolute", "change", "d", "dx", "fresh", "relative", "r", "share")

    def __init__(self, d: FloatArray, r: FloatArray, share: float = 1.0) -> None:
        self.d, self.r, self.share, self.fresh, self.change = d, r, share, False, inf

    dx: FloatArray
    absolute: FloatArray
    relative: list[float]


class Loop:
    """The iteration for models with one layout. Immutable: a step changes `KeptJacobian` only.

    Of the blocks: names, starts (first unknown) and counts (number of unknowns); largest_norm:
    Euclidean norm that a block with entries of 1 may have; masks judged (not
    multipliers), second (second order) and mixed (rigid coordinates: lengths and rotations).
    attitudes (q, 4): numbers of the unknowns of each quaternion.
    """

    def __init__(self, layout: Layout, tolerances: Tolerances) -> None:
        self.tol, blocks = tolerances, list(layout)
        self.names = [b.name for b in blocks]
        self.starts: IntArray = np.array([layout[n].start for n in self.names], dtype=np.int64)
        self.counts = np.diff(np.append(self.starts, layout.size))
        self.largest_norm = float(np.sqrt(self.counts.max(initial=0)))
        self.judged: BoolArray = np.array([b.kind.order > 0 for b in blocks], dtype=np.bool_)
        self.second: BoolArray = np.array([b.kind.order == 2 for b in blocks], dtype=np.bool_)
        self.mixed: BoolArray = np.array(
            [b.kind.quantity is Quantity.POSE for b in blocks], dtype=np.bool_)
        self.attitudes: IntArray = np.array(
            layout.quaternions, dtype=np.int64)[:, None] + np.arange(4)

    def largest(self, x: FloatArray) -> FloatArray:
        """Largest magnitude (blocks,) in each block of x (n,)."""
        return np.maximum.reduceat(np.abs(x), self.starts)

    def solve(
        self, eq: StepEquations, step: StepFormula, d: FloatArray, kept: KeptJacobian,
        newest: FloatArray,
    ) -> Ended:
        """Solves a step from the guess d (n,) of its departure from the free motion, or from the
        last state `newest` where the equations cannot be evaluated there. kept: Jacobian from
        earlier steps, changed in place; eq.price: cost of a new one in iterations, 1 for a new one
        in each step, 0 for one in each iteration."""
        if not len(self.names):  # names of blocks: there are no unknowns
            return Ended(d, Status.DONE, 1)
        if (solved := eq.solution(d)) is not None:
            return Ended(solved, Status.DONE, 1)
        iteration = _StepIteration(self, eq, step, kept)
        try:
            ended = iteration.run(d, newest)
        except RuntimeError:
            kept.forget()
            return iteration.failed(d, Status.SINGULAR, "the Jacobian of the step is singular")
        if ended.status.ok and eq.price:
            # the Jacobian is renewed when its excess iterations have cost as much as a new one
            kept.least = min(kept.least, ended.iterations)
            kept.debt += ended.iterations - kept.least
            if kept.debt >= eq.price or eq.price == 1:
                kept.forget()
        return ended

    def factorize(self, eq: StepEquations, kept: KeptJacobian) -> None:
        """The Jacobian at the kept point and its factorization."""
        assert kept.point is not None
        kept.J = eq.jacobian(kept.point)
        kept.factor, kept.noise, kept.floor = eq.factorize(kept.J), np.zeros(0), inf

    def kept_noise(self, eq: StepEquations, kept: KeptJacobian) -> FloatArray:
        """Changes (blocks,) that are due to rounding, at the kept point; computed when they are
        first needed."""
        if not len(kept.noise):
            assert kept.point is not None
            kept.noise = self.noise(eq, kept, kept.point)
        return kept.noise

    def noise(self, eq: StepEquations, kept: KeptJacobian, at: Linearisation) -> FloatArray:
        """Effect (blocks,) of rounding the terms of the equations."""
        return self.largest(self.solution(eq, kept, eq.rounding(kept.J, at)))

    def solution(
        self, eq: StepEquations, kept: KeptJacobian, r: FloatArray, L: FloatArray | None = None
    ) -> FloatArray:
        """L J^-1 L^T r (n,); J is the identity but for the unknowns `solved`, and L that but for
        the q quaternions, which L (q, 4, 4) turns from the attitude at which J was evaluated to
        the present one; None where nothing has turned."""
        factor, at, quaternions = kept.factor, eq.solved, self.attitudes
        assert factor is not None
        if L is not None:
            r = r.copy()
            r[quaternions] = (r[quaternions][:, None] @ L)[:, 0]
        if isinstance(at, slice):
            dx = factor.solve(r)
        else:
            dx = r.copy()
            dx[at] = factor.solve(r[at])
        if L is not None:
            dx[quaternions] = (L @ dx[quaternions][:, :, None])[:, :, 0]
        return dx

    def remember(self, x: FloatArray, d: FloatArray, step: StepFormula, kept: KeptJacobian) -> None:
        """Takes the magnitudes of an accepted step into account."""
        np.maximum(kept.top, self.largest(x), out=kept.top)
        np.maximum(kept.rate, self.largest(d) * step.c2, out=kept.rate)


class _StepIteration:
    """The iteration of one step.

    c: factors of its `Linearisation`; size (blocks,): magnitude to which changes are relative; L
    (q, 4, 4): turn of each quaternion since the kept Jacobian, None for a new one. bound: proved
    contraction with the Jacobian at `point`; scale (n,): magnitude of each row in the line search.
    smallest: smallest change so far; stall: iterations since it was last halved; cycles: True if
    the iteration goes back and forth.
    """

    def __init__(
        self, loop: Loop, eq: StepEquations, step: StepFormula, kept: KeptJacobian
    ) -> None:
        self.loop, self.eq, self.step, self.kept = loop, eq, step, kept
        self.c = step.c1, step.c2, step.c1_first, step.c2_first
        self.scale: FloatArray | None = None
        self.point: Linearisation | None = None
        self.L: FloatArray | None = None
        self.bound = inf
        self.iterations, self.stall, self.smallest, self.cycles = 0, 0, inf, False
        self.size = self._reference_sizes(kept.top, kept.rate)

    def run(self, d: FloatArray, newest: FloatArray) -> Ended:
        """Iterates until the estimated error is below the tolerance or at round-off, and decides
        after each change between the kept Jacobian, a new one, and failure."""
        at = _Iterate(d, self.eq.residual(d, self._needs_jacobian()))
        if not np.isfinite(at.r).all():  # the extrapolation led astray: from the last state
            d = newest - self.step.free
            at = _Iterate(d, self.eq.residual(d, self._needs_jacobian()))
        if not np.isfinite(at.r).all():
            return self.failed(d, Status.NOT_FINITE, at=at)
        tol, textbook, point = self.loop.tol, self.eq.price == 0, self.kept.point
        if point is not None and len(quaternions := self.loop.attitudes):
            self.L = turns((self.step.free + at.d)[quaternions], point.x[quaternions])
        self._counted_change(at)
        # with a new Jacobian, whose effects of rounding cost as much as an iteration, only where
        # the change is so small that they may save one
        if at.change <= (DOUBTFUL if at.fresh else self.kept.floor):
            self._drop_rounding(at)
        while True:
            if at.change == inf:
                return self.failed(at.d, Status.NOT_FINITE, at=at)
            if (error := min(at.change, self._proved_error(at))) <= tol.remaining:
                return self._done(at.d - at.dx, error)
            if self.iterations >= tol.max_iterations:
                return self._unfinished(at)
            new = self._next(at)
            if new is None:
                return self._unfinished(at)
            if not np.isfinite(new.r).all():
                return self.failed(new.d, Status.NOT_FINITE, at=new)
            # the textbook method (price 0), a check, trusts no ratio: it goes on until nothing
            # changes
            if not textbook and new.share == 1.0:  # a shortened change says nothing of the next
                error = max(errors := self._estimated_errors(new, at))
                if error > tol.remaining:
                    error = min(error, self._proved_error(new))
                if error > tol.remaining:
                    error = float(np.where(errors <= self._negligible(), 0.0, errors).max())
                if error <= tol.remaining:
                    return self._done(new.d - new.dx, error)
            self._drop_rounding(new, at)
            # changes with an old Jacobian that decrease by less than a half may be a slow mode
            stalled = new.change >= (STALLED if new.fresh or textbook else SLOW) * at.change
            # an old Jacobian must have stalled at round-off twice
            if stalled and self._at_round_off(new) and (
                    at.fresh or textbook or self._at_round_off(at)):
                return self._done(new.d - new.dx, new.change)
            if not (textbook or new.fresh) and self._renewal_pays(
                    new.change, new.change / at.change):
                if at.fresh and not self.eq.exact and new.change >= SLOW * at.change:
                    return self._unfinished(new)
                if new.change >= at.change and not at.fresh:
                    new = at  # an old Jacobian led astray
                self._newton_change(new, renew=True)
            self._note_progress(new, at)
            at = new

    def _next(self, at: _Iterate) -> _Iterate | None:
        """Next iterate with its own change: after a full step, or after a line search where full
        steps do not converge; None where no step length decreases the residual, or a Jacobian that
        neglects terms (not `exact`) does not converge. stall: iterations since the smallest change
        was last halved, of which PATIENCE are allowed; cycles: True if the iteration goes back and
        forth. WANDERING, CYCLE: relative changes above which it is lost, or in a cycle."""
        if self.stall > PATIENCE and not self.eq.exact:
            return None
        wanders = self.iterations > 2 * PATIENCE and at.change > WANDERING
        circles = self.cycles and at.change > CYCLE  # a full step would lead back into the cycle
        if self.stall <= PATIENCE and not (wanders or circles):
            d = at.d - at.dx
            new = _Iterate(d, self.eq.residual(d, self._needs_jacobian()))
            if np.isfinite(new.r).all():
                self._counted_change(new)
                return new
            return self._line_search(at) or new
        return self._line_search(at)

    def _estimated_errors(self, new: _Iterate, at: _Iterate) -> list[float]:
        """Estimated errors (blocks,) after the changes of `at`, then `new`, relative to `size`."""
        return list(map(estimated_error, new.relative, at.relative, repeat(self.eq.least)))

    def _negligible(self) -> FloatArray:
        """Changes (blocks,), relative to the size of each block, that are much less than
        round-off; the largest of them is kept, because sizes never decrease."""
        found: FloatArray = NEGLIGIBLE * self.loop.kept_noise(self.eq, self.kept) / self.size
        self.kept.floor = float(found.max())
        return found

    def _proved_error(self, at: _Iterate) -> float:
        """Bound |change| q / (1 - q) of the error after a change, relative to the size of each
        block (`size`; fixed-point theorem of Banach); inf where no contraction q (`bound`) is
        proved or q >= TRUSTED. |change|: Euclidean norm, bounded by the largest entry."""
        if self.kept.point is not self.point and self.kept.point is not None:  # a new Jacobian
            self.point, self.bound = self.kept.point, self.eq.contraction(self.kept.point)
        q = self.bound
        if not 0.0 < q < TRUSTED:
            return 0.0 if q == 0.0 else inf
        # at.change has the largest entries of blocks; their Euclidean norms may be as large as
        return q / (1.0 - q) * at.change * self.loop.largest_norm

    def _counted_change(self, at: _Iterate) -> None:
        """Newton change of an iterate, with the kept Jacobian where it has this step's factors."""
        self._newton_change(at, self._needs_jacobian())
        self.iterations += 1

    def _needs_jacobian(self) -> bool:
        """True if the next iterate needs its own Jacobian."""
        point = self.kept.point
        return self.eq.price == 0 or point is None or point.c != self.c

    def _newton_change(self, at: _Iterate, renew: bool) -> None:
        """Newton change dx = J^-1 r of an iterate and its size in each block, absolute and relative
        to `size` (blocks,), stored in `at`, with the largest relative one as `change`, inf if it is
        no number. renew: True for its own Jacobian, False for the kept one. kept.top, rate
        (blocks,): largest value of each block so far, and of its highest rates."""
        kept = self.kept
        if renew:
            kept.point = Linearisation(*self.step.at(at.d), self.step.t, self.c)
            kept.factor, self.L = None, None
            kept.least, kept.debt, kept.factorizations = UNKNOWN, 0, kept.factorizations + 1
        if kept.factor is None:
            self.loop.factorize(self.eq, kept)
        at.fresh, at.dx = renew, self.loop.solution(self.eq, kept, at.r, self.L)
        at.absolute = self.loop.largest(at.dx)
        if not self.eq.price:  # the textbook method goes far: relative to its present iterate
            x = self.step.free + at.d
            far = np.maximum(self.loop.largest(x), self.loop.largest(x - at.dx))
            self.size = self._reference_sizes(np.maximum(kept.top, far), kept.rate)
        at.relative = (at.absolute / self.size).tolist()
        at.change = max(at.relative)
        # of a block that was zero so far: relative to what this change makes of it
        if 1.0 < at.change < inf and not self.kept.top.all():
            d = at.d - at.dx
            first = self._reference_sizes(self.loop.largest(self.step.free + d),
                                          self.step.c2 * self.loop.largest(d))
            self.size = np.where(self.kept.top > 0.0, self.size, np.maximum(self.size, first))
            at.relative = (at.absolute / self.size).tolist()
            at.change = max(at.relative)
        if not at.change < inf:  # nan, too
            at.change = inf

    def _drop_rounding(self, *iterates: _Iterate) -> None:
        """Sets the changes of blocks to zero where they are much less than round-off; not with the
        textbook method, which knows none."""
        if not self.eq.price:
            return
        negligible = self._negligible()
        for at in iterates:
            if at.change < inf:  # a change that is not a number counts
                at.relative = np.where(at.relative <= negligible, 0.0, at.relative).tolist()
                at.change = max(at.relative)

    def _reference_sizes(self, top: FloatArray, rate: FloatArray) -> FloatArray:
        """Magnitudes (blocks,) to which changes are relative: the largest value so far, less where
        an error of the tolerance times that would dominate the accelerations (convergence_test.py);
        infinite for multipliers, which follow from the other unknowns. The textbook method knows
        no round-off, and is judged by the unknowns alone."""
        tol = self.loop.tol.remaining
        # a'' = c2 d: displacements whose accelerations are the largest so far
        accelerated = rate / max(self.step.c2, 1e-300)
        enough = np.maximum(ACCELERATION_ERROR * accelerated, 4 * EPS / tol * top)
        size = np.where(self.loop.second, np.minimum(top, enough), top) if self.eq.price else top
        return np.where(self.loop.judged, np.maximum(size, 1e-300), inf)

    def _renewal_pays(self, change: float, ratio: float) -> bool:
        """True if a new Jacobian costs less than iterating with the old one: after `price` further
        iterations, each smaller by `ratio`, the change would still be above the tolerance."""
        return ratio >= SLOW or change * ratio**self.eq.price > self.loop.tol.remaining

    def _at_round_off(self, at: _Iterate) -> bool:
        """True if the change is not above the effect of rounding, in each block that has not
        converged."""
        if self.eq.price:
            noise = self.loop.kept_noise(self.eq, self.kept)
        else:
            noise = self.loop.noise(self.eq, self.kept, Linearisation(
                *self.step.at(at.d), self.step.t, self.c))
        small = at.absolute <= MARGIN * noise
        return bool((small | (np.array(at.relative) <= self.loop.tol.remaining)).all())

    # ------------------------------------------------------------------ kinks

    def _note_progress(self, at: _Iterate, before: _Iterate) -> None:
        """Counts the iterations since the smallest change was last halved, and finds cycles: a
        change that leads back to the iterate before (`before`), as between two sides of a kink."""
        if at.change < 0.5 * self.smallest:
            self.smallest, self.stall = at.change, 0
            return
        self.stall += 1
        if at.change > CYCLE:
            back = self.loop.largest(at.d - at.dx - before.d) <= 1e-2 * at.absolute
            if back[self.loop.judged].all():
                self.cycles, self.stall = True, PATIENCE + 1

    def _line_search(self, at: _Iterate) -> _Iterate | None:
        """Line search: an iterate along the change with a smaller residual, with its own change;
        None where there is none down to the step length SHORTEST. `_merit`: largest entry of a
        residual relative to the scale of its row."""
        if not at.fresh:
            self._newton_change(at, renew=True)
        if self.scale is None:  # one for the whole step: under two, each way may seem to descend
            self.scale = self._scales(self.step.free + at.d)
        merit, share = self._merit(at.r), 1.0
        self.iterations += 1
        while share >= SHORTEST:
            d = at.d - share * at.dx
            new = _Iterate(d, self.eq.residual(d), share)
            if self._merit(new.r) <= (1.0 - 0.1 * share) * merit:  # sufficient decrease (Armijo)
                self._newton_change(new, renew=True)
                return new
            share *= 0.5
        return None

    def _scales(self, x: FloatArray) -> FloatArray:
        """Reference magnitude (n,) of each row: the largest terms of its block; for rigid
        coordinates the row's own terms, because forces and torques are not comparable."""
        terms, loop = self.eq.magnitudes(self.kept.J, x), self.loop
        of_block = loop.largest(terms).repeat(loop.counts)
        return np.maximum(np.where(loop.mixed.repeat(loop.counts), terms, of_block), 1e-300)

    def _merit(self, r: FloatArray) -> float:
        """Largest entry of a residual relative to the scale of its row; inf if it is not a
        number."""
        assert self.scale is not None
        value = float(np.abs(r / self.scale).max())
        return value if value == value else inf

    # ------------------------------------------------------------------ how it ends

    def _done(self, d: FloatArray, remaining: float) -> Ended:
        """End with the solution d, whose estimated relative error is `remaining`."""
        return Ended(d, Status.DONE, self.iterations, max(remaining, EPS))

    def failed(
        self, d: FloatArray, status: Status, detail: str = "", at: _Iterate | None = None
    ) -> Ended:
        """Failed end of the iteration with this status and message; at: the iterate that shows in
        which block values are not finite or changes, relative to `size`, are too large."""
        if status is Status.NOT_FINITE and self.eq.failed is not None:
            block, status, detail = self.eq.failed  # of an iterative linear solver
            return Ended(d, status, self.iterations, inf, block, detail)
        block = ""
        if at is not None:
            broken = ~np.isfinite(self.loop.largest(at.r))
            if not broken.any():
                broken = ~(at.absolute / self.size < inf)
            block = self.loop.names[int(np.argmax(broken))]
        return Ended(d, status, self.iterations, inf, block, self._with_names(detail, block))

    def _unfinished(self, at: _Iterate) -> Ended:
        """Failed end at the last iterate, with the block that changes most."""
        block = self.loop.names[int(np.argmax(at.absolute / self.size))]
        how = ("the iteration goes back and forth between two states" if self.cycles else
               f"last relative change {at.change:.1e} after {self.iterations} iterations")
        return Ended(at.d, Status.NOT_CONVERGED, self.iterations, at.change, block,
                     self._with_names(how, block))

    def _with_names(self, detail: str, block: str) -> str:
        """The detail, extended by the names of the terms that couple this block to others."""
        names = [n for n, blocks in self.eq.named if n and (not block or block in blocks)]
        if not names:
            return detail
        reason = f"{', '.join(names)} changes too much in one step"
        return f"{detail}: {reason}" if detail else reason
