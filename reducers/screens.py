"""Does an exchange of atoms pay in this step? Asked before the sparse solver is run.

Heat is linear: its screen is exact. Mechanics: at the solution on the carried support the border
rows hold, and they are so stiff against the sampled rows that the joint least squares is, to
`softness`, that of the sampled rows with rigid coordinates and multipliers eliminated:

    residual(c + d) = r + (B - P Z F) d,   Z = S H^-1 T,

P directions, F functionals of the displacements, S, H, T the border's derivatives. P, F, B are
constant; Z changes slowly. It is taken anew where a decision is closer than what its age may have
changed, which is measured whenever it is taken anew.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.core.protocols import Group, StepFormula
from sparsemor.core.screening import Screen, Screening, Tolerance
from sparsemor.core.separable import evaluate_amplitudes
from sparsemor.core.tables import total
from sparsemor.reducers.bordered import Mechanics
from sparsemor.reducers.heat_screen import EXACT, HeatScreen, Together
from sparsemor.reducers.sampled import SampledElastic, SampledHeat
from sparsemor.reducers.screen_rows import diagonal, group, norm, squares, with_rest
from sparsemor.reducers.selection import BORDER
from sparsemor.reducers.stepper import Stepper

SAFETY = 10.0
"""Tolerance over the estimated error of eliminating the border and of leaving kappa G out of B."""
CARE = 3.0
"""Tolerance over the rate at which old derivatives were seen to change decisions, where that rate
does not grow."""
GROWTH = 4.0
"""By how much more the rate may have grown since: from rest, or as it was last seen to grow."""
OLD = 50
"""Steps after which derivatives are taken anew in any case: a rate that was measured at rest says
nothing of what follows."""
UNKNOWN, TINY = Tolerance(np.inf, np.inf), 1e-300


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
        self.still = not len(T.generators)
        matrices, damped = [T.mass] if self.still else T.generators, bool(T.damping.any())
        self.k, g = B.shape[1], len(matrices)
        parts = [*matrices, *([T.damping] if damped else []), -T.coupling, -T.loads,
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
        if self.still:
            G[0] = 0.0
        else:
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
        self.age, self.floor, self.rate, self.care = 0, 0.0, UNKNOWN, CARE

    def state(self) -> dict[str, Any] | None:
        """What later decisions depend on, for a checkpoint; None before the first decision."""
        if self.screen is None:
            return None
        return {n: getattr(self, n) for n in ("given", "stiff", "age", "floor", "rate", "care")}

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
            beyond = self.care * self.age
            tolerance = Tolerance(*(self.floor + beyond * rate for rate in self.rate))
            found = old.settle(r, c, support, norm(self.stiff * loop.y), tolerance)
        if found is None:
            age, screen = self.age, self._renewed(mechanics)
            if old is not None:
                self._learn(screen.unlike(old, r, c, support), age)
            found = screen.settle(r, c, support, norm(self.stiff * loop.y),
                                  Tolerance(self.floor, self.floor))
        if found is None or found is support:
            return None if found is None else {}
        return {g.name: found[g.start : g.stop] for g in self.groups}

    def _learn(self, unlike: Tolerance, age: int) -> None:
        """The rate at which decisions changed in `age` steps, and how much it may grow from here.
        It may grow at once, but has to prove that it shrinks."""
        before, seen = self.rate, Tolerance(*(new / age for new in unlike))
        if before.sizes < np.inf:
            grown = seen.sizes / max(before.sizes, TINY)
            self.care = CARE * min(max(grown, 1.0), GROWTH)
            seen = Tolerance(*(max(n, 0.7 * b) for n, b in zip(seen, before, strict=True)))
        else:
            self.care = CARE * GROWTH
        self.rate = seen

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
