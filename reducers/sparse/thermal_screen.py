"""Screening of the atom selection in thermal blocks: does an exchange of atoms reduce the residual?
Heat is linear, so the test is exact."""

from collections.abc import Mapping

import numpy as np

from sparsemor.core import (
    BoolArray,
    FloatArray,
    GramError,
    Group,
    Layout,
    Quadratic,
    Reason,
    Screen,
    ScreensSupport,
    StepFormula,
    evaluate_amplitudes,
    total_load,
)
from sparsemor.reducers.sparse.sampled_block import SampledHeat
from sparsemor.reducers.sparse.screen_rows import Together, diagonal, joined
from sparsemor.reducers.step.left_inverse import squares

EXACT = GramError(1e-6, 0.0)
"""Error bounds of the test: the rows are exact up to the tolerance of the step."""
ROUNDING = 8.0 * float(np.finfo(np.float64).eps)
ONE = np.ones(1)


class HeatRows:
    """Compressed sampled rows of one thermal block, divided by the largest column norm: rows (m, j)
    multiply [c, r1, amplitudes of loads, 1].

    J (first, k): rows in which the operator on c is nonzero, with unit columns.
    """

    def __init__(self, s: SampledHeat) -> None:
        T, J = s.few
        size = float(np.linalg.norm(J, axis=0).max())
        self.name, self.budget, self.first = s.block.name, s.block.budget, s.first
        self.parts = tuple(a / size for a in (J, T.capacity, -T.loads, -T.constant[:, None]))
        self.rows, self.k = np.hstack(self.parts), J.shape[1]
        self.tables = tuple(t.over(size) for t in T.tables)
        self.amplitudes = T.amplitudes
        near = self.parts[0][: self.first]
        self.seen: BoolArray = squares(near) > 0.0
        self.lengths = np.where(self.seen, np.sqrt(squares(near)), 1.0)
        self.J = near / self.lengths
        self.gram, self.one = np.asfortranarray(self.J.T @ self.J), np.ones(self.k)

    def group(self, start: int) -> Group:
        return Group(self.name, start, start + self.k, self.budget)

    def at(self, c: FloatArray, r1: FloatArray, t: float) -> Quadratic:
        """Quadratic model of the squared residual about the coefficients c (k,) at time t, s."""
        known = evaluate_amplitudes(self.amplitudes, t)
        r = self.rows.dot(np.concatenate((c, r1, known, ONE)))
        if self.tables:
            r = r - total_load(self.tables, t)
        slope = self.J.T.dot(r[: self.first])
        return Quadratic(self.gram, slope, self.lengths * c, self.one, EXACT, None,
                         lambda: (float(r.dot(r)), 0.0))

    def tabled(self, t: float) -> FloatArray:
        """Tabulated heat loads (first,) at t, s, such as moving heat sources, in the rows of J."""
        return total_load(self.tables, t)[: self.first] if self.tables else np.zeros(self.first)


class Standing:
    """A sufficient condition for unchanged supports as a function of the inputs u (j,), on which
    the gradient and the coefficients depend linearly by `slope` and `c` (k, j)."""

    def __init__(self, why: Reason, slope: FloatArray, c: FloatArray) -> None:
        self.why, self.rows = why, why.slope @ slope + why.c @ c
        # products of products: each is as exact as its largest terms
        terms = np.abs(why.slope) @ np.abs(slope) + np.abs(why.c) @ np.abs(c)
        self.terms = ROUNDING * np.stack([terms[p].max(axis=0) for p in why.parts])

    def holds(self, u: FloatArray) -> bool:
        absolute = self.terms.dot(np.abs(u)).tolist()
        return self.why.holds(self.rows.dot(u), EXACT.sizes, absolute)


class HeatScreen:
    """Screening of all thermal blocks with atom selection: first of all blocks at once, then one by
    one."""

    def __init__(
        self, heat: Mapping[str, SampledHeat], layout: Layout, solver: ScreensSupport
    ) -> None:
        self.where = {n: layout[n] for n in heat}
        self.blocks = {n: HeatRows(s) for n, s in heat.items()}
        blocks, groups = list(self.blocks.values()), list[Group]()
        for b in blocks:
            groups.append(b.group(groups[-1].stop if groups else 0))
        self.screens: dict[str, Screen] = {
            b.name: solver.screen((b.group(0),), b.seen, len(b.rows)) for b in blocks}
        # side by side no block may lack the rows that its own exchange needs
        enough = all(len(s.block.B) >= 2 * s.block.budget for s in heat.values())
        rows = sum(len(s.block.B) for s in heat.values()) if enough else 0
        self.screen = solver.screen(groups, np.concatenate([b.seen for b in blocks]), rows)
        J, past, load = (diagonal([b.parts[i][: b.first] for b in blocks]) for i in range(3))
        near = np.hstack([J, past, load, np.vstack([b.parts[3][: b.first] for b in blocks])])
        if any(b.tables for b in blocks):
            near = np.hstack([near, -np.eye(len(near))])
        Jt = diagonal([b.J for b in blocks]).T
        lengths = np.concatenate([b.lengths for b in blocks])
        self.slope, self.c = Jt @ near, np.zeros((len(Jt), near.shape[1]))
        self.c[:, : len(Jt)] = np.diag(lengths)
        self.near, self.Jt, self.lengths = near, np.ascontiguousarray(Jt), lengths
        self.gram = np.asfortranarray(Jt @ Jt.T)
        self.one, self.together = np.ones(len(self.gram)), Together(groups)
        self.columns = joined(list(self.where.values()))
        self.functions = tuple(f for b in blocks for f in b.amplitudes)
        self.tabled = any(b.tables for b in blocks)
        self.support: BoolArray | None = None
        self.standing: Standing | None = None

    def stay(
        self, step: StepFormula, x: FloatArray, supports: Mapping[str, BoolArray]
    ) -> bool:
        """True if no support can change at the solution x (n,) of a step."""
        c, support = x[self.columns], self.together.of(supports)
        parts = [c, step.r1[self.columns], evaluate_amplitudes(self.functions, step.t), ONE]
        if self.tabled:
            parts += [b.tabled(step.t) for b in self.blocks.values()]
        u = np.concatenate(parts)
        same = support is self.support
        if same and self.standing is not None and self.standing.holds(u):
            return True
        at = Quadratic(self.gram, self.Jt.dot(self.near.dot(u)), self.lengths * c, self.one, EXACT,
                       None, _no_norm)
        stays = self.screen.stays(at, support)
        if stays and not (same and self.standing):
            why = self.screen.reason(at, support)
            self.support = support
            self.standing = None if why is None else Standing(why, self.slope, self.c)
        return stays

    def supports(
        self, name: str, step: StepFormula, x: FloatArray, support: BoolArray
    ) -> BoolArray | None:
        """Support that the sparse solver would return for one block from the solution x of a
        step."""
        where = self.where[name]
        at = self.blocks[name].at(x[where], step.r1[where], step.t)
        return self.screens[name].settle(at, support)


def _no_norm() -> tuple[float, float]:
    """Norms of the joint problem of all blocks, which no test uses: nan."""
    return np.nan, np.nan
