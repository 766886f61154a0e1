"""Does an exchange of atoms pay in a thermal block? Heat is linear, so the answer is exact."""

from collections.abc import Mapping, Sequence

import numpy as np

from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.core.layout import Layout
from sparsemor.core.protocols import Group, StepFormula
from sparsemor.core.screening import Screen, Screening, Tolerance
from sparsemor.core.separable import evaluate_amplitudes
from sparsemor.core.tables import Table, total
from sparsemor.reducers.sampled import SampledHeat
from sparsemor.reducers.screen_rows import diagonal, folded, group, joined, with_rest

EXACT = 1e-6
"""Tolerance of decisions that are exact but for rounding and the stop rule of the step."""
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
