"""Does an exchange of atoms pay in this step? Asked before the sparse solver is run.

Heat is linear: its screen is exact. Mechanics: at the solution on the carried support the border
rows hold, and they are so stiff against the sampled rows that the joint least squares is, to
`softness`, that of the sampled rows with rigid coordinates and multipliers eliminated:

    residual(c + d) = r + (B - P Z F) d,   Z = S H^-1 T,

P directions, F functionals of the displacements, S, H, T the border's derivatives. P, F, B are
constant; Z changes slowly. It is taken anew where a decision is closer than what its age may have
changed, which is measured whenever it is taken anew.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.core.layout import Layout
from sparsemor.core.protocols import Group, StepFormula
from sparsemor.core.screening import Screen, Screening, Tolerance
from sparsemor.core.separable import evaluate_amplitudes
from sparsemor.core.tables import Table, total
from sparsemor.reducers.bordered import Mechanics
from sparsemor.reducers.sampled import SampledElastic, SampledHeat
from sparsemor.reducers.screen_rows import (
    diagonal,
    folded,
    group,
    joined,
    norm,
    squares,
    with_rest,
)
from sparsemor.reducers.selection import BORDER
from sparsemor.reducers.stepper import Stepper

EXACT = 1e-6
"""Tolerance of decisions that are exact but for rounding and the stop rule of the step."""
SAFETY = 10.0
"""Tolerance over the estimated error of eliminating the border and of leaving kappa G out of B."""
CARE = 3.0
"""Tolerance over the rate at which old derivatives were seen to change decisions."""
OLD = 50
"""Steps after which derivatives are taken anew in any case: a rate that was measured at rest says
nothing of what follows."""
ONE = np.ones(1)


class Together:
    """Supports of some groups as one (k,), made anew only when one of them is another object."""

    def __init__(self, groups: Sequence[Group]) -> None:
        self.groups = tuple(groups)
        self._parts: list[BoolArray] = []
        self._whole = np.zeros(0, dtype=np.bool_)

    def of(self, supports: Mapping[str, BoolArray]) -> BoolArray:
        parts = [supports[g.name] for g in self.groups]
        if len(parts) != len(self._parts) or any(
                a is not b for a, b in zip(parts, self._parts, strict=True)):
            self._parts, self._whole = parts, np.concatenate(parts)
        return self._whole


class HeatScreen:
    """All selecting thermal blocks: first asked at once whether they stay, then one by one.

    In turned rows (compact.py) the residual of a block is rows @ (c, r1, amplitudes, 1); J reaches
    the first `first` of them, of the others only the norm counts. tables: heat that moves.
    """

    def __init__(
        self, heat: Mapping[str, SampledHeat], layout: Layout, solver: Screening
    ) -> None:
        self.at = {n: layout[n] for n in heat}
        self.rows: dict[str, FloatArray] = {}
        self.screens: dict[str, Screen] = {}
        self.amplitudes = {n: s.few[0].amplitudes for n, s in heat.items()}
        self.first = {n: s.first for n, s in heat.items()}
        self.tables: dict[str, tuple[Table, ...]] = {}
        groups: list[Group] = []
        stacks: tuple[list[FloatArray], ...] = ([], [], [], [])
        for n, s in heat.items():
            T, J = s.few
            size = float(np.linalg.norm(J, axis=0).max())
            J, past, load, constant = (
                a / size for a in (J, T.capacity, T.loads, T.constant[:, None]))
            self.rows[n] = np.hstack([J, past, -load, -constant])
            if T.tables:
                self.tables[n] = tuple(t.over(size) for t in T.tables)
            alone = with_rest(J, s.first)
            self.screens[n] = solver.screen(
                alone, np.linalg.norm(alone, axis=0), (group(n, 0, s.block.budget, J),), len(J))
            start = groups[-1].stop if groups else 0
            groups.append(group(n, start, s.block.budget, J))
            for parts, a in zip(stacks, (J, past, load, constant), strict=True):
                parts.append(a[: s.first])
        J, past, load = (diagonal(parts) for parts in stacks[:3])
        self.all = np.hstack([J, past, -load, -np.vstack(stacks[3])])
        self.together = Together(groups)
        self.places = joined(list(self.at.values()))
        self.functions = tuple(f for a in self.amplitudes.values() for f in a)
        # side by side no block may lack the rows that its own exchange needs
        enough = all(len(s.block.B) >= 2 * s.block.budget for s in heat.values())
        rows = sum(len(s.block.B) for s in heat.values()) if enough else 0
        self.screen = solver.screen(J, np.linalg.norm(J, axis=0), groups, rows)

    def stay(
        self, step: StepFormula, x: FloatArray, supports: Mapping[str, BoolArray]
    ) -> bool:
        """Is it sure that no block would change at the solution x (n,) of a step?"""
        c, known = x[self.places], evaluate_amplitudes(self.functions, step.t)
        r = self.all.dot(np.concatenate((c, step.r1[self.places], known, ONE)))
        if self.tables:
            r = r - self._tabled(step.t)
        return self.screen.stays(r, c, self.together.of(supports), EXACT)

    def supports(
        self, name: str, step: StepFormula, x: FloatArray, support: BoolArray
    ) -> BoolArray | None:
        """Where the solver would end for one block from the solution x of a step."""
        at = self.at[name]
        known = evaluate_amplitudes(self.amplitudes[name], step.t)
        r = self.rows[name].dot(np.concatenate((x[at], step.r1[at], known, ONE)))
        if name in self.tables:
            r = r - total(self.tables[name], step.t)
        r = folded(r, self.first[name])
        return self.screens[name].settle(r, x[at], support, 0.0, Tolerance(EXACT, EXACT))

    def _tabled(self, t: float) -> FloatArray:
        """The rows of `all` of heat that moves."""
        return np.concatenate([
            total(self.tables[n], t)[:first] if n in self.tables else np.zeros(first)
            for n, first in self.first.items()])


class Seen:
    """One selecting body: u = (G c and G r1 combined, r1, xT, amplitudes, 1, sigma, c) to rows.

    near (first, j): the operators on u in the turned rows that columns reach, over the block's
    size; far: in the others, where sigma and c do not act. u and views of it are scratch.
    """

    def __init__(self, number: int, s: SampledElastic) -> None:
        T, B = s.few
        size = float(np.linalg.norm(B, axis=0).max())
        self.number, self.first, self.amplitudes = number, s.first, T.amplitudes
        self.tables = tuple(t.over(size) for t in T.tables)
        self.k, g, damped = B.shape[1], len(T.generators), bool(T.damping.any())
        parts = [*T.generators, *([T.damping] if damped else []), -T.coupling, -T.loads,
                 T.constant[:, None], T.directions, B]
        rows = np.hstack(parts) / size
        self.near, self.problem_rows = np.ascontiguousarray(rows[: s.first]), len(rows)
        self.far = np.ascontiguousarray(rows[s.first :, : -T.directions.shape[1] - self.k])
        self.B, self.P, self.F = B[: s.first] / size, T.directions[: s.first] / size, T.functional
        whole = float(np.linalg.norm(B))
        self.turning = np.array([float(np.linalg.norm(G)) / whole for G in T.generators])
        self.group = group(s.block.name, 0, s.block.budget, B)
        self.u, self.pair = np.zeros(rows.shape[1]), np.zeros((2, self.k))
        self.past = self.u[: self.far.shape[1]]
        self.combined = self.u[: g * self.k].reshape(g, self.k)
        widths = [p.shape[1] for p in parts[g:]]
        edges = (g * self.k + np.cumsum([0, *widths])).tolist()
        where = [slice(i, j) for i, j in zip(edges, edges[1:], strict=False)]
        self.damping = where.pop(0) if damped else None
        self.temperature, self.known, one, self.sigma, self.c = where
        self.u[one] = 1.0

    def residual(
        self, step: StepFormula, x: FloatArray, mechanics: Mechanics, moved: FloatArray
    ) -> FloatArray:
        """(first + 1,) at the solution x of the step that `mechanics` has just solved."""
        b, w, u = mechanics.bodies[self.number], mechanics.work[self.number], self.u
        pair, G = self.pair, self.combined
        pair[0], pair[1] = x[b.elastic], step.r1[b.elastic]
        np.dot(w.coefficients[:-1].reshape(2, -1).T, pair, out=G)
        G[0] += step.r2[b.elastic]
        if self.damping is not None:
            u[self.damping] = pair[1]
        if self.amplitudes:
            u[self.known] = evaluate_amplitudes(self.amplitudes, step.t)
        u[self.temperature] = x[b.thermal]
        u[self.sigma] = w.sigma[-1] - moved[mechanics.at[self.number]].dot(w.sigma[:-1])
        u[self.c] = pair[0]
        out = np.empty(self.first + 1)
        near, far = self.near.dot(u), self.far.dot(self.past)
        if self.tables:
            moving = total(self.tables, step.t)
            near, far = near - moving[: self.first], far - moving[self.first :]
        out[:-1], out[-1] = near, norm(far)
        return out


class ElasticScreen:
    """All selecting bodies in one problem, the border eliminated with its last derivatives."""

    def __init__(
        self, mechanics: Mechanics, elastic: Mapping[str, SampledElastic], solver: Screening
    ) -> None:
        self.solver = solver
        self.bodies = [Seen(i, elastic[b.elastic_name]) for i, b in enumerate(mechanics.bodies)
                       if b.elastic_name in elastic]
        groups: list[Group] = []
        for s in self.bodies:
            start = groups[-1].stop if groups else 0
            groups.append(Group(s.group.name, start, start + s.k, s.group.budget))
        self.groups, self.together = tuple(groups), Together(groups)
        self.problem_rows = sum(s.problem_rows for s in self.bodies)
        self.B = diagonal([with_rest(s.B, s.first) for s in self.bodies])
        self.P = diagonal([with_rest(s.P, s.first) for s in self.bodies])
        self.F = diagonal([s.F for s in self.bodies])
        self.lengths, self.stiff = squares(self.B), np.zeros(0)
        self.screen: Screen | None = None
        self.given = np.zeros((0, 0)), np.zeros(0)
        self.age, self.floor, self.rate = 0, 0.0, Tolerance(np.inf, np.inf)

    def state(self) -> dict[str, Any] | None:
        """What later decisions depend on, for a checkpoint; None before the first decision."""
        if self.screen is None:
            return None
        return {n: getattr(self, n) for n in ("given", "stiff", "age", "floor", "rate")}

    def restore(self, state: Mapping[str, Any]) -> None:
        """As if this screen had come so far itself: the same bits."""
        for name, value in state.items():
            setattr(self, name, value)
        self.screen = self.solver.screen(*self.given, self.groups, self.problem_rows)

    def supports(
        self, step: StepFormula, x: FloatArray, mechanics: Mechanics,
        before: Mapping[str, BoolArray],
    ) -> dict[str, BoolArray] | None:
        """The supports where the solver would end from the solution x of a step, {} if those
        before; None if it cannot be told."""
        loop = mechanics.last
        assert loop is not None
        moved = mechanics.map.dot(loop.dy)
        r = np.concatenate([s.residual(step, x, mechanics, moved) for s in self.bodies])
        c = np.concatenate([s.pair[0] for s in self.bodies])
        support, old, found = self.together.of(before), self.screen, None
        self.age += 1
        if old is not None and self.age < OLD and self.rate.sizes < np.inf:
            tolerance = Tolerance(*(self.floor + CARE * rate * self.age for rate in self.rate))
            found = old.settle(r, c, support, norm(self.stiff * loop.y), tolerance)
        if found is None:
            age, screen = self.age, self._renewed(mechanics)
            if old is not None:
                # a rate may grow at once, but has to prove that it shrinks
                self.rate = Tolerance(*(
                    max(new / age, 0.7 * rate if rate < np.inf else 0.0) for new, rate in zip(
                        screen.unlike(old, r, c, support), self.rate, strict=True)))
            found = screen.settle(r, c, support, norm(self.stiff * loop.y),
                                  Tolerance(self.floor, self.floor))
        if found is None or found is support:
            return None if found is None else {}
        return {g.name: found[g.start : g.stop] for g in self.groups}

    def _renewed(self, mechanics: Mechanics) -> Screen:
        """A screen with the derivatives of the border as the step has just left them."""
        works, bodies, H = mechanics.work, mechanics.bodies, np.zeros((mechanics.size,) * 2)
        for b, w in zip(bodies, works, strict=True):
            H += b.to_border.T @ w.border[:, :-1] @ b.to_border
        S = np.concatenate([works[s.number].sigma[:-1].T @ bodies[s.number].to_border
                            for s in self.bodies])
        TF = np.hstack([bodies[s.number].to_border.T @ works[s.number].tau
                        for s in self.bodies]) @ self.F
        scale = BORDER / np.sqrt(squares(TF.T) + squares(H.T))
        PS = self.P @ S
        PSH = np.linalg.solve(H.T, PS.T).T
        norms = np.sqrt(self.lengths + squares(scale[:, None] * TF))
        self.stiff = np.sqrt(squares(PS) + squares(scale[:, None] * H))
        softness = float(np.linalg.norm(PSH / scale)) ** 2
        turning = max(float(np.abs(works[s.number].coefficients[: len(s.turning)]) @ s.turning)
                      for s in self.bodies)
        self.given = self.B - PSH @ TF, norms
        self.screen = self.solver.screen(*self.given, self.groups, self.problem_rows)
        self.age, self.floor = 0, EXACT + SAFETY * (softness + turning)
        return self.screen


@dataclass(frozen=True, slots=True, eq=False)
class Screens:
    """Of one set of rows."""

    heat: HeatScreen | None
    elastic: ElasticScreen | None

    @classmethod
    def of(
        cls, base: Stepper, heat: Mapping[str, SampledHeat],
        elastic: Mapping[str, SampledElastic], solver: Any,
    ) -> "Screens | None":
        """None for a solver that does not screen."""
        if not isinstance(solver, Screening):
            return None
        hot = HeatScreen(heat, base.layout, solver) if heat else None
        if not elastic:
            return cls(hot, None)
        assert base.mechanics is not None
        return cls(hot, ElasticScreen(base.mechanics, elastic, solver))
