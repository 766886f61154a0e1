"""Equations of a step on the active atoms of each block, from the residual of all sampled rows.

With the sampled rows R of a block and the left inverse B^+ of its operator on the active atoms they
are B^+ R = 0, next to the equations of rigid coordinates and joint forces. Atoms that are not
active have the coefficient zero; their rates, of steps before, are part of R.
"""

from collections import OrderedDict
from collections.abc import Mapping
from copy import copy
from math import inf
from typing import Any, NamedTuple, Self

import numpy as np

from sparsemor.core import (
    BoolArray,
    FloatArray,
    IntArray,
    Status,
    StepFormula,
    StepOutcome,
)
from sparsemor.reducers.linalg.active_columns import NEGLIGIBLE, WIDE
from sparsemor.reducers.step.convergence_test import Tolerances
from sparsemor.reducers.step.jacobian_factors import Factor, factorized
from sparsemor.reducers.step.newton_loop import Linearisation, StepEquations
from sparsemor.reducers.step.reduced_equations import Reduced
from sparsemor.reducers.step.reduced_mechanics import LoopMechanics, StepUnknowns
from sparsemor.reducers.step.step_memory import Memory

KEPT = 16
"""Number of sets of atoms for which the equations are kept."""


class ActiveRows(NamedTuple):
    """An elastic block on its support: its active atoms (s,), and left (s, j), the left inverse of
    the first j of its rows; None for rows that are times the left inverse already. chosen (s,):
    numbers of the rows that are these already, None for all rows."""

    active: IntArray
    left: FloatArray | None = None
    chosen: IntArray | None = None


class SampledResidual:
    """Residual of the sampled rows of all blocks, as a function of the unknowns that are not zero.

    A block of many atoms, of which few are active, is evaluated for those that are active or have
    been: the others have neither coefficients nor rates. chosen: elastic block -> numbers of the
    rows that are evaluated there.
    """

    def __init__(self, rows: Reduced) -> None:
        layout = rows.layout
        self.rows, self.every = rows, np.ones(layout.size, dtype=np.bool_)
        self.chosen: Mapping[str, IntArray] = {}
        self.wide = [layout[b.name] for b in layout if b.kind.reducible and b.size >= WIDE]
        self._kept: OrderedDict[bytes, Reduced] = OrderedDict()
        self._last: tuple[StepOutcome, FloatArray] | None = None

    def working(self) -> "SampledResidual":
        """The same with working arrays of its own."""
        return SampledResidual(self.rows.working())

    def on_nonzero(
        self, needed: BoolArray, *states: FloatArray
    ) -> tuple[Reduced, IntArray | slice]:
        """The residual as a function of the unknowns that are needed (n,) or nonzero in one of the
        states (n,), and the numbers of these. wide: ranges of the blocks with so many atoms that it
        pays to leave some out; unknowns of other blocks are always in (every (n,): True). chosen:
        elastic block -> numbers of the rows that are evaluated."""
        if not self.wide:
            return self.rows, slice(None)
        use = self.every.copy()
        for at in self.wide:
            use[at] = needed[at]
            for z in states:
                size = np.abs(z[at])
                use[at] |= size > NEGLIGIBLE * size.max()
            use[at.start] = True  # a block is never empty
        numbers = np.flatnonzero(use)
        key = b"".join((use.tobytes(), *(rows.tobytes() for rows in self.chosen.values())))
        if key not in self._kept:
            if len(self._kept) >= KEPT:
                self._kept.popitem(last=False)
            self._kept[key] = self.rows.of_atoms(numbers, self.chosen)
        return self._kept[key], numbers

    def at_solution(self, step: StepFormula, solved: StepOutcome) -> FloatArray:
        """All rows at the solution of a step, evaluated once for all blocks."""
        if self._last is None or self._last[0] is not solved:
            x, rates = solved.x, solved.rates
            v, a = step.at(x - step.free)[1:] if rates is None else rates
            self._last = solved, self.residual(x, v, a, step.t)
        return self._last[1]

    def residual(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float
    ) -> FloatArray:
        """All rows at a state."""
        rows, use = self.on_nonzero(~self.every, x, v, a)
        return rows.residual_at(x[use], v[use], a[use], t, rows.prescribed(t))


class SupportedEquations(StepEquations):
    """Mechanical equations on a support, for known temperatures. all_rows: rows of all blocks;
    heat: of temperatures, at the solution of a step; rows: of mechanics.

    support, with blocks: of each elastic block the numbers of its active unknowns (s,), its rows,
    and its left inverse (s, rows), None for rows that are times it already. Of orthonormal atoms
    these are some of the rows, and in wide blocks the only ones that an iteration evaluates, the
    others once, at the solution. inactive: unknowns that
    are zero; needed (n,): unknowns of mechanics that are not. sizes: norms of the rotation matrices
    of bodies with prescribed motion (`PrescribedBody.contraction`). Of a step, restricted: residual
    as a function of the unknowns that are nonzero, numbered `in_use` among all."""

    named = ()
    solved: IntArray

    def __init__(self, residual: Reduced) -> None:
        self.all_rows = SampledResidual(residual)
        self.heat = SampledResidual(residual.heat_alone())
        self.rows = SampledResidual(residual.after_heat())
        self.layout, self.support = residual.layout, None

    support: "SupportedMechanics | None"

    def working(self, memory: Any = None) -> Self:
        own = copy(self)
        own.all_rows, own.heat = self.all_rows.working(), self.heat.working()
        own.rows, own.support = self.rows.working(), None
        return own

    def take(self, support: "SupportedMechanics") -> None:
        """Continues on another support: sets the numbers `inactive` of unknowns that are zero, the
        mask `needed` (n,) of those of mechanics that are not, of each elastic block its active
        unknowns, rows and left inverse (`blocks`), of each body with prescribed motion norms (g, 2)
        of its rotation matrices (`sizes`), and the unknowns `solved` for which the Jacobian is not
        the identity."""
        if self.support is support:
            return
        layout, rows = self.layout, self.rows.rows
        free = support.active.copy()
        free[layout.first] = False  # temperatures
        self.support, self.inactive = support, np.flatnonzero(~support.active)
        self.needed = free.copy()
        self.blocks: list[tuple[IntArray, slice | IntArray, FloatArray | None]] = []
        self.sizes: list[FloatArray] = []
        wide = {at.start for at in self.rows.wide}
        self.rows.chosen = {n: b.chosen for n, b in support.blocks.items()
                            if b.chosen is not None and layout[n].start in wide}
        numbered = rows.rows.resized({n: len(r) for n, r in self.rows.chosen.items()})
        driven = {d.at.start: d for d in rows.prescribed_bodies} if rows.linear else {}
        for name, block in support.blocks.items():
            at, left, own = layout[name], block.left, numbered[name]
            equations: slice | IntArray = own
            if left is not None:  # it reads the first rows alone
                equations = slice(own.start, own.start + left.shape[1])
            elif block.chosen is not None and name not in self.rows.chosen:
                equations = own.start + block.chosen
            self.blocks.append((at.start + block.active, equations, left))
            if (d := driven.get(at.start)) is None:
                continue
            if left is None and block.chosen is None:
                # beyond the leading atoms the Jacobian is the identity
                free[at.start + d.leading : at.stop] = False
                self.sizes.append(d.sizes)
            else:  # the Jacobian is exact: no rest outside of a leading part
                if left is None:
                    G = d.generators[:, block.active[:, None], block.active]
                else:
                    G = left @ d.generators[:, : left.shape[1], block.active]
                self.sizes.append(np.stack([np.linalg.norm(G, axis=(1, 2)), np.zeros(len(G))], 1))
        self.solved = np.flatnonzero(free)
        # cost of a new Jacobian in iterations with the old one, as of `Reduced`
        self.price = 8 + len(self.solved) // 40

    def begin(self, step: StepFormula, d: FloatArray) -> None:
        """Begins a step: inactive coefficients go to zero; where few columns are nonzero, the
        equations of these alone are used (`restricted`, of the unknowns numbered `in_use`)."""
        d[self.inactive] = -step.free[self.inactive]  # x = free + d
        self.step = step
        self.restricted, self.in_use = self._begun(self.rows, d)

    def _begun(self, rows: SampledResidual, d: FloatArray) -> tuple[Reduced, IntArray | slice]:
        """The equations of the unknowns that are nonzero, begun at the departure d (n,), in `rows`;
        and the numbers of these unknowns. needed (n,): True for the active unknowns of mechanics;
        inactive: numbers of the coefficients that are zero."""
        step = self.step
        restricted, use = rows.on_nonzero(self.needed, *step.at(d)[:2], d)
        if isinstance(use, slice):
            restricted.inactive = self.inactive
            restricted.begin(step, d)
            return restricted, use
        inactive = np.zeros(len(d), dtype=np.bool_)
        inactive[self.inactive] = True
        restricted.inactive = np.flatnonzero(inactive[use])
        before = None if step.before is None else step.before[use]
        restricted.begin(StepFormula(
            step.t, step.c1, step.c2, step.c1_first, restricted.layout, step.free[use],
            step.free_rate[use], step.h, before), d[use])
        return restricted, use

    def residual(self, d: FloatArray, slope: bool = False) -> FloatArray:
        """Residual (n,): border rows, d + B^+ R of active coefficients, and the value of inactive
        ones."""
        own = d if isinstance(self.in_use, slice) else d[self.in_use]
        R, r = self.restricted.residual(own), np.zeros(len(d))
        r[self.rows.rows.border] = R[self.restricted.border_rows]
        r[self.inactive] = self.step.free[self.inactive] + d[self.inactive]
        for at, rows, left in self.blocks:
            r[at] = d[at] + (R[rows] if left is None else left.dot(R[rows]))
        return r

    def at_solution(
        self, step: StepFormula, solved: StepOutcome, operators: Mapping[str, FloatArray]
    ) -> dict[str, FloatArray]:
        """Rows of each elastic block at the solution of the step that was solved last; operators:
        of the first rows on their atoms, (j, k), which the equations of the step leave out. d (n,):
        departure; needed (n,): True for unknowns that are not zero; restricted, in_use: the
        equations that the step was solved with, and the numbers of their unknowns."""
        d = solved.x - step.free if solved.rates is None else step.departure(
            solved.x, *solved.rates)
        restricted, use, found = self.restricted, self.in_use, {}
        if self.rows.chosen:  # all rows, not those of the support alone
            every = copy(self.rows)
            every.chosen = {}
            restricted, use = self._begun(every, d)
        R = restricted.residual(d if isinstance(use, slice) else d[use])
        for name, B in operators.items():
            found[name] = r = R[self.rows.rows.rows[name]].copy()
            active = np.flatnonzero(self.needed[at := self.layout[name]])
            if name in self.rows.chosen:  # B is the unit matrix
                r[active] += d[at][active]
            else:
                r[: len(B)] += B[:, active].dot(d[at][active])
        return found

    def jacobian(self, at: Linearisation) -> FloatArray:
        """Jacobian of the unknowns `solved` by each other."""
        rows, use = self.rows.on_nonzero(self.needed, at.x, at.v, at.a)
        J = rows.slope_at(Linearisation(at.x[use], at.v[use], at.a[use], at.t, at.c))
        columns = self.solved if isinstance(use, slice) else np.searchsorted(use, self.solved)
        J, n = J[:, columns], self.layout.size
        whole = np.zeros((n, len(self.solved)))  # of all rows; B^+ D = 1 is part of J
        whole[self.rows.rows.border] = J[rows.border_rows]
        for atoms, span, left in self.blocks:
            whole[atoms] = J[span] if left is None else left @ J[span]
        return whole[self.solved]

    def factorize(self, J: FloatArray) -> Factor:
        return factorized(J)

    def contraction(self, point: Linearisation) -> float:
        if not self.restricted.linear:
            return inf
        return max(b.contraction(point, sizes)
                   for b, sizes in zip(self.restricted.prescribed_bodies, self.sizes, strict=True))


class SupportedMechanics(LoopMechanics):
    """Mechanics of a step on a support. blocks: elastic block -> its active rows; active (n,):
    unknowns that are not elastic or active."""

    def __init__(
        self, equations: SupportedEquations, tolerances: Tolerances,
        blocks: Mapping[str, ActiveRows],
    ) -> None:
        super().__init__(equations, tolerances)
        self.sampled, self.blocks = equations, blocks
        self.active = np.ones(equations.layout.size, dtype=np.bool_)
        for name, block in blocks.items():
            at = equations.layout[name]
            self.active[at] = False
            self.active[at.start + block.active] = True

    def on(self, blocks: Mapping[str, ActiveRows]) -> "SupportedMechanics":
        """The same on other supports of some blocks."""
        return SupportedMechanics(self.sampled, self.tol, {**self.blocks, **blocks})

    def working(self, memory: Memory) -> SupportedEquations:
        """The equations with the working arrays of a run, whose rows may have changed."""
        found: SupportedEquations = memory.work.of(self.sampled)
        return found

    def alone(self) -> Mapping[str, FloatArray]:
        """Elastic block -> (s, 2 s): response of its active coefficients to changes of their r1 and
        r2 with all other unknowns fixed, -B^+ [damping, mass], for rates c1 c + r1 and
        accelerations c2 c + r2. Of each block in `blocks`: its active atoms, and the left inverse
        of its first rows, or the numbers of the rows that replace it."""
        found, rows = {}, self.sampled.rows.rows
        for b in rows.bodies:
            if b.operators is not None:
                use, left, chosen = self.blocks[b.step.elastic_name]
                rates = np.hstack([b.operators.damping[:, use], b.operators.mass[:, use]])
                found[b.step.elastic_name] = (
                    -left @ rates[: left.shape[1]] if left is not None else
                    -rates if chosen is None else -rates[chosen])
        return found

    def solve(
        self, step: StepFormula, now: StepUnknowns, memory: Memory
    ) -> tuple[Status, int, str, str]:
        self.working(memory).take(self)
        # linearised_on: active unknowns of the kept Jacobian
        if memory.linearised_on is None or not np.array_equal(memory.linearised_on, self.active):
            memory.kept.forget()
            memory.linearised_on = self.active
        return super().solve(step, now, memory)
