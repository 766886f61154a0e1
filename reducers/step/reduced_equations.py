"""Equations of a step of a reduced model, as arrays stacked over its bodies.

With the rows of a block times the inverse of its own operator D = K + c1 C + c2 M they are, for the
departure d from the free motion of the step (core/protocols/integrator.py),

    d + base + sum_g (kappa_g G_g u + mu_g G_g u') + E sigma - C_T T + terms = 0     displacements
    d + base + terms = 0                                                            temperatures

base: free motion, loads and constant terms; kappa, mu, sigma: factors of the body's frame, which
depend on its rigid coordinates, joint forces, and s = P^T (u, u', u'') and the quadratic forms
u.Q_g (u, u', u''). G_g are the inertia matrices under the test basis, Q_g under the trial basis.
The rows of rigid coordinates and joint forces (the *border*) are those of the frames; terms that
couple bodies or are not linear are added one by one.

A Jacobian ("slope") is that of all rows by the unknowns, with the rates of the step formula,
dx' = c1 dx and dx'' = c2 dx. It is the identity but for frames, terms and temperature coupling.
"""

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from math import inf
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csr_array, issparse

from sparsemor.core import (
    Amplitude,
    FloatArray,
    Frame,
    FrameHistory,
    InputError,
    IntArray,
    Layout,
    ReducedTerm,
    StepFormula,
)
from sparsemor.core.protocols.body_frame import FrameWork
from sparsemor.core.protocols.integrator import second_difference
from sparsemor.core.protocols.separable import evaluate_amplitudes
from sparsemor.core.protocols.step_solver import LinearSystem
from sparsemor.reducers.linalg.modal_coordinates import compact, times
from sparsemor.reducers.step.border_matrix import BorderMatrix
from sparsemor.reducers.step.frame_step import BodyStep
from sparsemor.reducers.step.jacobian_factors import Factor, factorized
from sparsemor.reducers.step.local_copies import CopyMemory, Coupled, OfAtoms
from sparsemor.reducers.step.monolithic_step import Checked, WholeEquations
from sparsemor.reducers.step.newton_loop import Linearisation
from sparsemor.reducers.step.prescribed_body import PrescribedBody
from sparsemor.reducers.step.projected_operators import ProjectedElastic, ProjectedHeat
from sparsemor.reducers.step.time_tables import TimeTable, plus_loads

TOGETHER = 64
"""Largest number of displacements of bodies whose arrays are filled up to one size; larger bodies
are stacked with those of half to twice their size."""
_NONE = np.zeros(0)
WHOLE = 250
"""Largest number of coefficients whose constant operators form one matrix."""
SPARSE = 50_000
"""Entries of the map from rigid unknowns to bodies from which it is stored as a sparse matrix."""


@dataclass(frozen=True, slots=True, eq=False)
class HeatRows:
    """Projected rows of one thermal block, times the left inverse of its operator; at: its
    unknowns."""

    at: slice
    operators: ProjectedHeat


@dataclass(frozen=True, slots=True, eq=False)
class BodyRows:
    """A body in a step, with its projected elastic rows times the left inverse of D; operators:
    None where it has no elastic block. factors: kappa, mu and sigma of its frame as functions of
    time, in a model without rigid unknowns and joint forces."""

    step: BodyStep
    operators: ProjectedElastic | None
    factors: TimeTable | None = None


class ConstantOperator(NamedTuple):
    """Constant operator A of the unknowns `columns` in `rows`; of: 0 of the unknowns themselves, 1
    of their rates, 2 of their second rates. A: matrix, or vector where it is diagonal."""

    rows: slice
    columns: slice
    of: int
    A: FloatArray


class BorderBlocks(NamedTuple):
    """Derivatives for one body: `corner` (m, m) of its m rigid and constraint rows (`rows`) by its
    m rigid unknowns and joint forces, numbered `at`, `column` (l, m) of its elastic rows
    by these, `row` (m, k) of the former by its displacements; turning (g,) = kappa + c1 mu: factors
    of its inertia matrices in the derivative of elastic rows by displacements."""

    body: BodyRows
    rows: IntArray
    at: IntArray
    corner: FloatArray
    column: FloatArray
    row: FloatArray
    turning: FloatArray


class Stack:
    """Bodies of similar size as arrays, first index the body; all are filled up with zeros to the
    largest one, frames at the front, displacements by unknown number n and rows by number `height`
    (none).

    Of B bodies: b border unknowns (rigid coordinates, then joint forces), p directions, g matrices
    of the inertia, k displacements and l rows of a body (sizes, heights: those of each). first:
    position of its border unknowns among all stacked ones, in which they have the range `span`;
    origin (3, B, b): their constant part, without rates. at (B, k), rows (B, l): numbers of
    displacements and of their rows; G (B, k, g l), Q (B, k, g k), P (B, k, p), E (B, p, l).
    """

    def __init__(
        self, bodies: Sequence[BodyRows], rows: Sequence[slice], n: int, height: int, first: int
    ) -> None:
        """rows: range of each body's elastic rows in the model; n, height: number of unknowns and
        of rows of the model, which are also the numbers with which `at` and `rows` are filled up;
        first: position of the stack's border unknowns among those of all stacks. A frame with fewer
        than b border unknowns uses the last of b, a body with fewer displacements or directions the
        first. Made are shapes and ranges, and transposed operators: G of `generators`, Q of
        `quadratic`, P of `functional`, E of `directions`."""
        self.bodies, frames, B = bodies, [body.step.frame for body in bodies], len(bodies)
        sizes = [0 if body.operators is None else body.operators.mass.shape[1] for body in bodies]
        k, b = max(sizes), max(f.border for f in frames)
        p, g = max(f.p for f in frames), max(f.generators for f in frames)
        self.k, self.b, self.p, self.g, self.sizes = k, b, p, g, sizes
        self.heights = [at.stop - at.start for at in rows]
        self.height = max(self.heights)
        self.span = slice(first, first + B * b)
        self.at, self.rows = np.full((B, k), n), np.full((B, self.height), height)
        G, Q = np.zeros((B, k, g, self.height)), np.zeros((B, k, g, k))
        self.P, self.E = np.zeros((B, k, p)), np.zeros((B, p, self.height))
        self.origin = np.zeros((3, B, b))
        # body i with frame f, s displacements and m rows
        for i, (body, f, s, m) in enumerate(zip(bodies, frames, sizes, self.heights, strict=True)):
            self.origin[0, i, b - f.border :] = body.step.origin
            if (t := body.operators) is None:
                continue
            self.at[i, :s] = np.arange(body.step.elastic.start, body.step.elastic.stop)
            self.rows[i, :m] = np.arange(rows[i].start, rows[i].stop)
            for j, A in enumerate(t.generators):
                G[i, :s, j, :m] = A.T
            for j, A in enumerate(t.quadratic):
                Q[i, :s, j, :s] = A.T
            self.P[i, :s, : f.p], self.E[i, : f.p, :m] = t.functional.T, t.directions.T
        self.G, self.Q = G.reshape(B, k, g * self.height), Q.reshape(B, k, g * k)
        self.reset()

    def reset(self) -> None:
        """New working arrays of the frames (`FrameWork`), views of the arrays of all bodies made
        here, which have the same names (`H` is its `border`) and the body as their first index."""
        B, b, p, g = len(self.bodies), self.b, self.p, self.g
        self.sigma, self.tau = np.zeros((B, b + 1, p)), np.zeros((B, b, p))
        self.H, self.coefficients = np.zeros((B, b, b + 1)), np.zeros((B, 2 * g + 1))
        self.kappa_y, self.mu_y = np.zeros((B, b, g)), np.zeros((B, b, g))
        self.quad = np.zeros((B, b, 3, g))
        self.undeformed = np.zeros((B, 3, p)), np.zeros((B, 3 * g))
        # of each body frame, working arrays, prescribed motion, first border unknown, and numbers
        # of inertia matrices and directions
        self.frames: list[tuple[Frame, FrameWork, FrameHistory | None, int, int, int]] = []
        for i, body in enumerate(self.bodies):
            f = body.step.frame
            # its border unknowns are the last ones of b, from o on
            o, w = b - f.border, FrameWork(f.p, f.border, f.generators)
            w.sigma, w.tau, w.border = (
                self.sigma[i, o:, : f.p], self.tau[i, o:, : f.p], self.H[i, o:, o:])
            if f.generators == g:  # kappa and mu side by side; else `evaluate` copies them
                w.coefficients = self.coefficients[i]
            w.kappa_y, w.mu_y = self.kappa_y[i, o:, : f.generators], self.mu_y[
                i, o:, : f.generators]
            w.quad = self.quad[i, o:, :, : f.generators]
            w.coefficients[-1] = 1.0
            self.frames.append((f, w, body.step.guide, o, f.generators, f.p))

    def maps(self, size: int) -> Iterator[FloatArray]:
        """Map (b, size) of the model's rigid unknowns and joint forces to the border unknowns of
        each body."""
        for body in self.bodies:
            T = np.zeros((self.b, size))
            T[self.b - len(body.step.to_border) :] = body.step.to_border
            yield T

    def evaluate(
        self, X: FloatArray, Y: FloatArray, t: float, rates: tuple[float, float] | None
    ) -> None:
        """Evaluates the frames for unknowns with rates X (3, n + 1) and border unknowns Y (3, B b)
        of all stacks at t, s; with derivatives for dv = c1 dx, da = c2 dx if `rates` (c1, c2) are
        given. o: first of the b border unknowns that a frame uses; sizes: numbers of displacements;
        w.fresh: True if `evaluate` is to fill in derivatives; `exact` adds those that are quadratic
        in displacements."""
        B, b, g = len(self.bodies), self.b, self.g
        c1, c2 = rates or (0.0, 0.0)
        Y = Y[:, self.span].reshape(3, B, b) + self.origin
        s, forms = self.multiply(X) if self.k else self.undeformed
        for i, (f, w, guide, o, own, p) in enumerate(self.frames):
            y, v, a = Y[:, i, o:]  # views, to which prescribed motion is added
            if guide is not None:
                for row, part in zip((y, v, a), guide.at(t), strict=True):
                    row[: len(part)] += part
            w.fresh = rates is not None
            f.evaluate(
                y, v, a, c1, c2, s[i] if p == self.p else s[i, :, :p],
                forms[i] if own == g else forms[i].reshape(3, g)[:, :own].ravel(), t, w)
            if own < g:  # its coefficients are no view: kappa and mu, each filled up to g
                self.coefficients[i, :own] = w.coefficients[:own]
                self.coefficients[i, g : g + own] = w.coefficients[own:-1]
            if rates is not None and self.sizes[i]:
                f.exact(v, a, c1, c2, w)

    def multiply(self, X: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Functionals s (B, 3, p) of the displacements and their rates, and their quadratic forms
        (B, 3 g). Kept: u.Q_g (`products`), G_g u and G_g u' (`rotation_products`)."""
        B, g, k = len(self.bodies), self.g, self.k
        # (B, 3, k): displacements, rates, second rates
        U = X.take(self.at, axis=1).transpose(1, 0, 2)
        self.products = (U @ self.Q).reshape(B, 3, g, k)
        forms = (self.products.reshape(B, 3 * g, k) @ U[:, 0, :, None])[:, :, 0]
        self.rotation_products, self.u = (U[:, :2] @ self.G).reshape(B, 2 * g, self.height), U[:, 0]
        return U @ self.P, forms

    def forces(self) -> FloatArray:
        """Terms (B, l) of the frames in the rows of the displacements, after `evaluate`."""
        return np.asarray((self.coefficients[:, None, :-1] @ self.rotation_products
                           + self.sigma[:, -1:] @ self.E)[:, 0])

    def blocks(
        self, i: int, T: FloatArray, rows: IntArray, at: IntArray, c1: float, c2: float
    ) -> BorderBlocks:
        """Derivatives for body i after `evaluate`; T (b, m): map of its m rigid unknowns and joint
        forces, numbered `at`, to its border unknowns, whose equations are numbered `rows`. c1, c2:
        dv = c1 dx, da = c2 dx. products[i] (3, g, k) = Q_g (u, u', u''), rotation_products[i] (2 g,
        l) = G_g u, then G_g u'."""
        (_, w, _, o, *_), body, g, s = self.frames[i], self.bodies[i], self.g, self.sizes[i]
        corner = T.T @ w.border[:, :-1] @ T
        if not s:
            none = np.zeros((0, len(at)))
            return BorderBlocks(body, rows, at, corner, none, none.T, np.zeros(0))
        k = self.k
        # elastic rows by border unknowns: E sigma + sum_g kappa_g G_g u + mu_g G_g u'
        rates = np.hstack((self.kappa_y[i, o:], self.mu_y[i, o:])) @ self.rotation_products[i]
        column = (self.sigma[i, o:-1] @ self.E[i] + rates)[:, : self.heights[i]].T @ T
        # derivatives of u.Q u, u.Q u', u.Q u'' by u: Q u, ... plus 1, c1, c2 times Q^T u
        back = (self.Q[i].reshape(k * g, k) @ self.u[i]).reshape(k, g).T
        forms = self.products[i] + np.array([1.0, c1, c2])[:, None, None] * back
        row = self.tau[i, o:] @ self.P[i].T + (
            self.quad[i, o:].reshape(self.b - o, 3 * g) @ forms.reshape(3 * g, k))
        return BorderBlocks(body, rows, at, corner, column, T.T @ row[:, :s],
                            self.coefficients[i, :g] + c1 * self.coefficients[i, g : 2 * g])


class Reduced(WholeEquations):
    """Equations of a whole step of a reduced model, or of rigid bodies.

    coupled: terms that are not linear in the unknowns of one body, or act between bodies; targets:
    prescribed constraint values; border: positions of rigid unknowns and joint forces; h: step
    size, s. Working arrays belong to one run or one thread (`working`).

    price: cost of a new Jacobian in iterations with the old one, by the number of unknowns. solved:
    unknowns for which J is not the identity: all; or all but temperatures, which are then known
    when a step begins (`heat_first`), and all but stiff modes on prescribed frames, where nothing
    is added to them (`linear`).

    rows: layout of the rows, where these are not times the left inverse of each block's operator
    but as many as are sampled; then `residual` leaves out the operators D d of the blocks.
    inactive: unknowns that are zero in a step, which d contains as minus the free motion. tables:
    of `prescribed_bodies`, if they are known. frames_at: x at which frames were last evaluated with
    derivatives. rates: R of the last step, for its factors c. corner: structure of the Jacobian of
    rigid bodies alone, whose derivatives come with the residual; None for other models.
    """

    inactive: IntArray = np.zeros(0, dtype=np.int64)
    c: tuple[float, ...] = ()
    frames_at: FloatArray = np.zeros(0)

    def __init__(
        self, layout: Layout, heat: Sequence[HeatRows], bodies: Sequence[BodyRows],
        coupled: Sequence[Coupled], targets: Sequence[tuple[int, Amplitude]], border: IntArray,
        h: float, named: Sequence[tuple[str, frozenset[str]]] = (), heat_first: bool = False,
        rows: Layout | None = None, tables: Sequence[TimeTable | None] = (),
    ) -> None:
        """heat, bodies: projected rows of the blocks; coupled: terms that are not linear in one
        body, or act between bodies; targets: (position in `border`, prescribed value) of
        constraints; border: positions of rigid unknowns, then joint forces; h: step size, s; named:
        name of a coupling term, and its blocks; heat_first: temperatures are known when a step
        begins; rows: layout of the rows, None if each unknown has its own; tables: rows in time of
        prescribed bodies (`PrescribedBody`), if they are known."""
        self.layout, self.heat, self.bodies, self.coupled = layout, heat, bodies, coupled
        self.targets, self.border, self.h, self.named = targets, border, h, named
        self.heat_first, n, first = heat_first, layout.size, layout.first
        self.corner: BorderMatrix | None = None
        self.atoms = slice(layout.frames.stop, layout.algebraic.start)
        solved = [layout[b.name] for b in layout.differential if b.kind.reducible]
        self.identity: IntArray | slice = self.atoms  # else bristles are between them
        if sum(at.stop - at.start for at in solved) < self.atoms.stop - self.atoms.start:
            self.identity = np.r_[np.zeros(0, np.int64), *solved]
        # known: terms of temperatures alone, evaluated once in a step; iterated: in each iteration
        self.terms_in_heat = any(_inside(c.columns, first) for c in coupled)
        self.known = [c for c in coupled if heat_first and _all_inside(c.columns, first)]
        self.iterated = [c for c in coupled if c not in self.known]
        self.rows, self.sampled = rows or layout, rows is not None
        self._at = {layout[b.name].start: self.rows[b.name] for b in layout}
        self.border_rows = border if rows is None else positions(rows)
        self.target_rows = self.border_rows[[i for i, _ in targets]]
        self.target_values = [f for _, f in targets]
        own = [b for b in bodies if b.operators is not None and b.factors is not None]
        self.prescribed_bodies = [
            PrescribedBody(b.step, b.operators, b.factors, self.row(b.step.elastic), table)
            for b, table in zip(own, tables or [None] * len(own), strict=True)
            if b.operators is not None and b.factors is not None]
        self.stacks = self._stacks(bodies if len(border) else ())
        # linear: a step is base + d + rotation of prescribed frames, without frames and terms
        self.linear = heat_first and bool(self.prescribed_bodies) and not (
            self.iterated or self.known)
        self.solved = self._solved()
        self._maps(border)
        # rigid bodies alone
        if len(border) == n > 0 and bodies and not coupled and all(
                b.operators is None for b in bodies):
            self.corner = BorderMatrix([T for stack in self.stacks for T in stack.maps(n)])
        # cost of a Jacobian in iterations, measured: 6 for 65 unknowns, 14 for 260, 31 for 1300; of
        # rigid bodies, whose derivatives come with the residual, less than an iteration
        self.price = 8 + n // 40 if self.corner is None else 1
        self.constants, self.thermal = self._constants()
        self.of_motion = _merged(self.constants, self.atoms) if rows is None else [
            c for c in self.constants if c.of < 2 and c.A.any()]
        self.of_inactive = [c for c in self.constants if c.of == 2]

    def row(self, at: slice) -> slice:
        """Rows of the block with these unknowns."""
        return self._at[at.start] if at.stop > at.start else slice(0, 0)

    def _stacks(self, bodies: Sequence[BodyRows]) -> list[Stack]:
        """Bodies of similar size together."""
        groups: dict[int, list[BodyRows]] = {}
        for body in bodies:  # k displacements: up to TOGETHER, else by powers of two
            k = 0 if body.operators is None else body.operators.mass.shape[1]
            groups.setdefault(0 if k <= TOGETHER else k.bit_length(), []).append(body)
        stacks: list[Stack] = []
        for members in groups.values():
            stacks.append(Stack(
                members, [self.row(b.step.elastic) for b in members], self.layout.size,
                self.rows.size, stacks[-1].span.stop if stacks else 0))
        return stacks

    def _constants(self) -> tuple[list[ConstantOperator], list[ConstantOperator]]:
        """Constant operators of displacements and temperatures, and those by which temperatures
        act on displacements, all with their signs on the left-hand side; 0, 1, 2: of the unknowns,
        their rates, their second rates."""
        own, thermal = [], []
        for h in self.heat:
            rows = self.row(h.at)
            own += [ConstantOperator(rows, h.at, 0, h.operators.conductivity),
                    ConstantOperator(rows, h.at, 1, h.operators.capacity)]
        for b in self.bodies:
            if (t := b.operators) is None:
                continue
            e, rows = b.step.elastic, self.row(b.step.elastic)
            own += [ConstantOperator(rows, e, 0, t.stiffness),
                    ConstantOperator(rows, e, 1, t.damping), ConstantOperator(rows, e, 2, t.mass)]
            if t.coupling.size:
                thermal.append(ConstantOperator(rows, b.step.thermal, 0, -t.coupling))
        return own, thermal

    def linear_system(self) -> LinearSystem:
        """The equations as constant matrices (`StepSolver.linear_system`). Raises InputError with
        the reason where they are not linear with constant matrices."""
        # bodies with kappa or mu, which multiply displacements; on a fixed frame (without guide)
        # only loads that stiffen a body have matrices G
        moving = [b.at for b in self.prescribed_bodies
                  if len(b.table.times) or b.table.at(0.0)[: 2 * len(b.G)].any()
                  or (len(b.G) and b.step.guide is None)]
        reason = ("rigid coordinates or joint forces are unknowns" if len(self.border) else
                  "terms act between bodies or are not linear" if self.coupled else
                  "a frame moves as prescribed, or loads stiffen a body" if moving else
                  "it has sampled rows" if self.sampled else "")
        if reason:
            raise InputError(f"its equations are not linear with constant matrices: {reason}",
                             "reducer")
        n = self.layout.size
        K, D, M = matrices = tuple(np.zeros((n, n)) for _ in range(3))
        for c in (*self.constants, *self.thermal):
            matrices[c.of][c.rows, c.columns] += np.diag(c.A) if c.A.ndim == 1 else c.A

        def force(t: float) -> FloatArray:
            """Right-hand side (n,) at t, s."""
            f = np.zeros(n)
            for h in self.heat:
                f[h.at] = plus_loads(h.operators.constant, h.operators, t)
            for b in self.prescribed_bodies:  # their base is on the left-hand side
                f[b.rows] = -b.base(t)
            return f

        return LinearSystem(M, D, K, force)

    def _solved(self) -> IntArray | slice:
        """Unknowns for which the Jacobian is not the identity (`solved`)."""
        layout = self.layout
        if not self.heat_first:
            return slice(None)
        if self.linear:
            return np.concatenate(
                [np.arange(b.at.start, b.at.start + b.leading) for b in self.prescribed_bodies])
        if layout.first.stop > layout.first.start:
            return np.arange(layout.size)[np.r_[layout.second, layout.algebraic]]
        return slice(None)

    def _maps(self, border: IntArray) -> None:
        """Sets T (N, B b), the map from rigid unknowns and joint forces of the model to the border
        unknowns of all stacked bodies, and `used`: of each body of each stack, numbers of the rows
        and unknowns (m,) that it uses, and their part (b, m) of the map."""
        width = self.stacks[-1].span.stop if self.stacks else 0
        T: Any = np.zeros((len(border), width))
        self.used: list[list[tuple[IntArray, IntArray, FloatArray]]] = []
        for stack in self.stacks:
            used = []
            for i, body in enumerate(stack.bodies):
                # at the end of its b columns; the others stay zero
                end = stack.span.start + (i + 1) * stack.b
                own = body.step.to_border  # (its border unknowns, N)
                T[:, end - len(own) : end] = own.T
                some = np.any(own != 0.0, axis=0)
                used.append((
                    self.border_rows[some], border[some], np.ascontiguousarray(own[:, some])))
            self.used.append(used)
        self.T = csr_array(T.T) if T.size > SPARSE else T  # the sparse one transposed

    def parts(self) -> tuple[Any, ...]:
        return (self.layout, self.heat, self.bodies, self.coupled, self.targets, self.border,
                self.h, self.named, self.heat_first)

    @classmethod
    def of_parts(cls, *parts: Any) -> "Reduced":
        return cls(*parts)

    def working(self, memory: CopyMemory | None = None) -> "Reduced":
        """These equations with new working arrays, and the local copies of terms in `memory`."""
        own = copy(self)
        own.stacks = [copy(s) for s in self.stacks]
        own.prescribed_bodies = [b.working() for b in self.prescribed_bodies]
        for stack in own.stacks:
            stack.reset()
        if memory is not None and any(c.term.relocates for c in self.coupled):
            copies = {id(c): c.by_copies(i, memory) for i, c in enumerate(self.coupled)}
            own.coupled = [copies[id(c)] for c in self.coupled]
            own.known = [copies[id(c)] for c in self.known]
            own.iterated = [copies[id(c)] for c in self.iterated]
        return own

    def after_heat(self) -> "Reduced":
        """The equations of mechanics alone, for known temperatures."""
        first = self.rows.first
        return Reduced(
            self.layout, heat=(), bodies=self.bodies,
            coupled=[c for c in self.coupled if not _inside(c.rows, first)],
            targets=self.targets, border=self.border, h=self.h, named=self.named, heat_first=True,
            rows=self.rows if self.sampled else None,
            tables=[b.table for b in self.prescribed_bodies])

    def heat_alone(self) -> "Reduced":
        """The equations of the temperatures, among rows and unknowns of all blocks."""
        first = self.rows.first
        return Reduced(
            self.layout, heat=self.heat, bodies=(),
            coupled=[c for c in self.coupled if _all_inside(c.rows, first)], targets=(),
            border=self.border, h=self.h, named=self.named,
            rows=self.rows if self.sampled else None)

    def of_atoms(
        self, use: IntArray, chosen: Mapping[str, IntArray] = MappingProxyType({})
    ) -> "Reduced":
        """The equations as functions of the unknowns numbered `use` (m,); the others are zero.
        chosen: elastic block -> numbers of the rows that it keeps; the rows of others stay as they
        are."""
        layout, used, heat, bodies = self.layout, np.zeros(self.layout.size, np.int64), [], []
        used[use] = 1
        new_number = np.cumsum(used) - 1
        # block -> its unknowns in use, numbered in the block; first unknown -> name of the block
        some = {b.name: np.flatnonzero(used[layout[b.name]]) for b in layout}
        new = layout.resized({n: len(at) for n, at in some.items()})
        name = {layout[b.name].start: b.name for b in layout}
        for h in self.heat:
            n = name[h.at.start]
            heat.append(HeatRows(new[n], h.operators.of_atoms(some[n])))
        for b in self.bodies:
            e, T = b.step.elastic, b.step.thermal
            if b.operators is None or e.stop == e.start:
                bodies.append(b)
                continue
            warm = name[T.start] if T.stop > T.start else ""  # its thermal block
            step = replace(b.step, elastic=new[name[e.start]], thermal=new[warm] if warm else T)
            # tabulated loads of bodies on prescribed frames are in `tables` below
            operators = b.operators if b.factors is None else replace(b.operators, tables=())
            bodies.append(BodyRows(step, operators.of_atoms(
                some[name[e.start]], some[warm] if warm else np.zeros(0, np.int64),
                chosen.get(name[e.start])), b.factors))
        coupled = []
        for c in self.coupled:
            own = np.flatnonzero(used[c.columns])
            coupled.append(Coupled(
                OfAtoms(c.term, own, len(c.columns)), c.rows, new_number[c.columns[own]]))
        return Reduced(
            new, heat, bodies, coupled, targets=self.targets, border=positions(new), h=self.h,
            named=self.named, heat_first=self.heat_first,
            rows=self.rows.resized({n: len(r) for n, r in chosen.items()}),
            tables=[b.of_rows(chosen.get(name[b.at.start])) for b in self.prescribed_bodies])

    @property
    def terms(self) -> list[tuple[ReducedTerm, IntArray]]:
        return [(c.term, c.columns) for c in self.coupled]

    @property
    def checks(self) -> list[Checked]:
        return [(c.term, c.columns) for c in self.coupled if c.term.rejects]

    def alone(self) -> dict[str, FloatArray]:
        """Elastic block -> (k, 2 k): response of its coefficients to changes of their r1 and r2
        with all other unknowns fixed and coupling terms neglected, [-D^-1 D_m, -D^-1 M] projected,
        with the damping D_m."""
        return {b.step.elastic_name: -np.hstack([b.operators.damping, b.operators.mass])
                for b in self.bodies if b.operators is not None}

    # ------------------------------------------------------------------ in a step

    def begin(self, step: StepFormula, d: FloatArray) -> None:
        """Takes over the constants of a step; d (n,): its first guess, with final temperatures if
        these are known.

        Sets `base` (n + 1,), the residual without what each iteration adds to it, and X0, R of the
        unknowns with their rates, X = X0 + R d (3, n + 1). The last entries are no unknowns: the
        numbers with which stacks are filled up point there. of_motion, of_inactive: constant
        operators to be multiplied by the free motion, and masses, for inactive unknowns alone,
        because second rates of the free motion are zero.
        """
        n, base, first = self.layout.size, np.zeros(self.rows.size + 1), self.layout.first
        self.step, inactive = step, self.inactive
        motion = [step.free, step.free_rate]
        if len(inactive):  # their x is zero, with d = -free: their rates follow
            motion = [step.free.copy(), step.free_rate.copy(), np.zeros(n)]
            motion[0][inactive], motion[2][inactive] = 0.0, -step.c2 * step.free[inactive]
            motion[1][inactive] -= step.c1 * step.free[inactive]
        if not self.linear:
            if self.c != (c := (step.c1, step.c2, step.c1_first, step.c2_first)):
                self.c, self.rates = c, _rates(step)
            self.X0, self.R = np.zeros((3, n + 1)), self.rates
            self.X0[0, :n], self.X0[1, :n] = motion[:2]
            if len(inactive):
                self.X0[2, :n], self.R = motion[2], self.rates.copy()
                self.R[:, inactive] = 0.0
            self._plus_prescribed(base, step.t)
        for rows, columns, of, A in self.of_inactive if len(inactive) else ():
            base[rows] += A.dot(motion[of][columns])
        for rows, columns, of, A in self.of_motion:
            base[rows] += times(A, motion[of][columns])
        for b in self.prescribed_bodies:
            b.begin(step, d, base)
        if self.heat_first:
            if not self.sampled:  # known temperatures: their rows, d + base, are zero
                base[first] = -d[first]
            for rows, columns, _, A in self.thermal:
                base[rows] += A.dot(step.free[columns] + d[columns])
            if self.known:
                _plus(self.known, base, self._motion(d), step.t)
        self.base = base

    def residual(self, d: FloatArray, slope: bool = False) -> FloatArray:
        """Residual (n,) at the departure d (n,): base + d + rotation of prescribed frames +
        temperature coupling + frames + terms. base: what `begin` has computed; identity: rows with
        a term d, but for sampled rows (`sampled`), which are not one to one with unknowns; linear:
        no frames and terms; iterated: terms not yet in base; slope: True if frames are to give
        their derivatives, too."""
        r = self.base.copy()
        if not self.sampled:
            r[self.identity] += d[self.identity]
        for b in self.prescribed_bodies:
            b.add(r, d)
        if self.linear:
            return r[:-1]
        X = self._motion(d)
        if not self.heat_first:
            for rows, columns, _, A in self.thermal:
                r[rows] += A.dot(X[0, columns])
        rates = (self.step.c1, self.step.c2) if slope else None
        r = self._with_terms(r, X, self.step.t, self.iterated, rates)
        # state whose derivatives the frames have, for the Jacobian; none if they have not
        self.frames_at = X[0, :-1] if slope else _NONE
        return r

    def _motion(self, d: FloatArray) -> FloatArray:
        """Unknowns with their rates (3, n + 1) at the departure d (n,)."""
        X, step, first = np.zeros(self.X0.shape), self.step, self.layout.first
        np.multiply(self.R, d, out=X[:, :-1])
        X += self.X0
        if self.terms_in_heat and step.before is not None:
            X[2, first] = second_difference(step.before[first], X[0, first], X[1, first], step.h)
        return X

    def _with_terms(
        self, r: FloatArray, X: FloatArray, t: float, coupled: Sequence[Coupled],
        rates: tuple[float, float] | None = None
    ) -> FloatArray:
        """r (n + 1,) plus the rows of frames and terms at X (3, n + 1); the last is dropped."""
        self._evaluate(X, t, rates)
        # rigid and constraint rows of each body; T (N, B b), or its transpose if it is sparse
        rows = [stack.H[:, :, -1].ravel() for stack in self.stacks]
        if len(self.border) and rows:
            r[self.border_rows] += self.T.T.dot(np.concatenate(rows)) if issparse(self.T) else (
                self.T.dot(rows[0] if len(rows) == 1 else np.concatenate(rows)))
        for s in self.stacks:
            if s.k:
                r[s.rows] += s.forces()
        return _plus(coupled, r, X, t)[:-1]

    def _evaluate(
        self, X: FloatArray, t: float, rates: tuple[float, float] | None = None
    ) -> None:
        """Evaluates all frames at X (3, n + 1); with derivatives for dv = c1 dx, da = c2 dx if
        `rates` (c1, c2) are given."""
        self.frames_at = _NONE
        Y = X[:, self.border]
        Y = self.T.dot(Y.T).T if issparse(self.T) else Y.dot(self.T)
        for stack in self.stacks:
            stack.evaluate(X, Y, t, rates)

    def jacobian(self, at: Linearisation) -> FloatArray:
        """Exact Jacobian of the unknowns `solved`; that of all others is the identity. Of rigid
        bodies alone its entries (`BorderMatrix`)."""
        if self.corner is not None:
            self._evaluate_at(at.x, at.v, at.a, at.t, *at.c[:2])
            return self.corner.assembled(np.concatenate(
                [stack.H[:, :, :-1].ravel() for stack in self.stacks]))
        if self.linear:  # one block per body, of its leading modes; at.c = (c1, ...)
            c1, J, rows = at.c[0], np.eye(len(np.arange(self.layout.size)[self.solved])), 0
            for b in self.prescribed_bodies:
                some = slice(rows, rows := rows + b.leading)
                J[some, some] += b.slope(at.t, c1, b.leading)
            return J
        J = self.slope_at(at)
        if isinstance(self.solved, slice):
            return J
        return np.asarray(J[self.solved[:, None], self.solved])

    def slope_at(self, at: Linearisation) -> FloatArray:
        """Exact Jacobian of all rows by all unknowns."""
        c1, c2, c1_first, c2_first = at.c
        of_rate, of_acceleration = np.full(self.layout.size, c1), np.full(self.layout.size, c2)
        of_rate[self.layout.first], of_rate[self.layout.algebraic] = c1_first, 0.0
        of_acceleration[self.layout.first], of_acceleration[self.layout.algebraic] = c2_first, 0.0
        return self.slope(at.x, at.v, at.a, at.t, of_rate, of_acceleration)

    def factorize(self, J: FloatArray) -> Factor:
        """J: a matrix, or the entries of `corner`."""
        return factorized(J) if self.corner is None or J.ndim == 2 else self.corner.factorized(J)

    def magnitudes(self, J: FloatArray, x: FloatArray) -> FloatArray:
        if self.corner is None:
            return super().magnitudes(J, x)
        return self.corner.magnitudes(J, np.abs(x))

    def contraction(self, point: Linearisation) -> float:
        return max(b.contraction(point) for b in self.prescribed_bodies) if self.linear else inf

    # ------------------------------------------------------------------ at any state

    def prescribed(self, t: float) -> FloatArray:
        """The part (n,) of the residual that depends on the time (s) alone."""
        r = np.zeros(self.rows.size)
        self._plus_prescribed(r, t)
        for b in self.prescribed_bodies:
            r[b.rows] += b.base(t)
        return r

    def _plus_prescribed(self, r: FloatArray, t: float) -> None:
        """Adds to r what depends on the time (s) alone, without bodies on prescribed frames."""
        if self.targets:
            r[self.target_rows] -= evaluate_amplitudes(self.target_values, t)
        for h in self.heat:
            r[self.row(h.at)] -= plus_loads(h.operators.constant, h.operators, t)
        for b in self.bodies:
            if b.operators is not None and b.factors is None:
                r[self.row(b.step.elastic)] += plus_loads(
                    b.operators.constant, b.operators, t, -1.0)

    def residual_at(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, prescribed: FloatArray
    ) -> FloatArray:
        """Residual (n,) at unknowns x with any rates v, a (n,), at t, s."""
        X, r = np.zeros((3, len(x) + 1)), np.append(prescribed, 0.0)
        X[:, :-1] = x, v, a
        for rows, columns, of, A in (*self.constants, *self.thermal):
            r[rows] += A.dot(X[of, columns])
        for b in self.prescribed_bodies:
            r[b.rows] += b.rotation(x, v, t)
        return self._with_terms(r, X, t, self.coupled)

    def _evaluate_at(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: float, c2: float
    ) -> None:
        """Evaluates all frames with derivatives at a state, for dv = c1 dx and da = c2 dx, unless
        the residual has done so."""
        if len(self.frames_at) != len(x) or (x != self.frames_at).any():
            X = np.zeros((3, len(x) + 1))
            X[:, :-1] = x, v, a
            self._evaluate(X, t, (c1, c2))

    def border_blocks(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: float, c2: float
    ) -> Iterator[BorderBlocks]:
        """Derivatives for each body at a state, for dv = c1 dx and da = c2 dx."""
        self._evaluate_at(x, v, a, t, c1, c2)
        for stack, used in zip(self.stacks, self.used, strict=True):
            for i, (rows, at, T) in enumerate(used):
                yield stack.blocks(i, T, rows, at, c1, c2)

    def slope(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> FloatArray:
        """Jacobian (n, n), or of as many rows as there are, at a state, for dv = c1 dx and da = c2
        dx; c1, c2 (n,). Of a body (`BorderBlocks`) corner: rigid and constraint rows by rigid
        unknowns and joint forces, column: elastic rows by these, row: the former by displacements,
        turning: factors of its inertia matrices by displacements."""
        layout, J = self.layout, np.zeros((self.rows.size, len(x)))
        # the factors are equal within each kind of unknowns; k1_first: c1 of temperatures
        k1_first, k1, k2 = (float(c.max(initial=0.0)) for c in (
            c1[layout.first], c1[layout.second], c2[layout.second]))
        # of: 0, 1, 2 for operators of the unknowns, their rates, their second rates
        for rows, columns, of, A in (*self.constants, *self.thermal):
            first = columns.start >= layout.first.start and columns.stop <= layout.first.stop
            factor = (1.0, k1_first if first else k1, k2)[of]
            if factor:
                J[rows, columns] += factor * A
        for d in self.prescribed_bodies:
            J[d.rows, d.at] += d.slope(t, k1)
        for b in self.border_blocks(x, v, a, t, k1, k2):
            J[np.ix_(b.rows, b.at)] += b.corner
            if b.body.operators is not None:
                e = b.body.step.elastic
                rows = self.row(e)
                J[rows, b.at] += b.column
                J[b.rows, e] += b.row
                g = len(b.body.operators.generators)
                J[rows, e] += np.tensordot(b.turning[:g], b.body.operators.generators, 1)
        for c in self.coupled:
            j = c.columns
            part: Any = c.term.jacobian(x[j], v[j], a[j], t, c1[j], c2[j])
            J[np.ix_(c.rows, j)] += part.toarray() if issparse(part) else part
        return J

    def time_derivative(self, order: int, t: float) -> "Reduced":
        """Partial time derivative of this order of the bodies' constraint rows, at t, s."""
        frames = ((b, b.step.frame.time_derivative(order, t, self.h)) for b in self.bodies)
        bodies = [BodyRows(replace(b.step, frame=f), b.operators) for b, f in frames
                  if f is not None]
        return Reduced(self.layout, heat=(), bodies=bodies, coupled=(), targets=(),
                       border=self.border, h=self.h)

    def terms_alone(self) -> "Reduced":
        """The coupling terms without bodies, heat and prescribed values."""
        return Reduced(self.layout, heat=(), bodies=(), coupled=self.coupled, targets=(),
                       border=self.border, h=self.h)


def positions(layout: Layout) -> IntArray:
    """Positions of all rigid unknowns, then of all multipliers."""
    at = np.arange(layout.size)
    return np.concatenate([at[layout.frames], at[layout.algebraic]])


def _rates(step: StepFormula) -> FloatArray:
    """Derivatives (3, n) of the unknowns and their rates by the departure."""
    layout = step.layout
    R = np.zeros((3, layout.size))
    R[0], R[1, layout.second], R[2, layout.second] = 1.0, step.c1, step.c2
    R[1, layout.first], R[2, layout.first] = step.c1_first, step.c2_first
    return R


def _plus(
    coupled: Sequence[Coupled], r: FloatArray, X: FloatArray, t: float
) -> FloatArray:
    """r (n + 1,) plus these terms at X (3, n + 1) and t, s; in place."""
    for c in coupled:
        j = c.columns
        r[c.rows] += c.term.residual(X[0, j], X[1, j], X[2, j], t)
    return r


def _inside(at: IntArray, span: slice) -> bool:
    """True if any of the unknowns is within the span."""
    return bool(((at >= span.start) & (at < span.stop)).any())


def _all_inside(at: IntArray, span: slice) -> bool:
    """True if all of the unknowns are within the span."""
    return bool(((at >= span.start) & (at < span.stop)).all())


def _merged(constants: Sequence[ConstantOperator], atoms: slice) -> list[ConstantOperator]:
    """Products with unknowns and rates of the free motion, whose second rates are zero: one vector
    each where all operators are diagonal (modal coordinates), one matrix each for few coefficients,
    otherwise those of the blocks. atoms: range of all coefficients; `compact` returns a diagonal
    matrix as its diagonal."""
    n, found = atoms.stop - atoms.start, []
    for of in (0, 1):
        parts = [(c, compact(c.A)) for c in constants if c.of == of and c.A.any()]
        modal = all(A.ndim == 1 for _, A in parts)
        if not parts:
            continue
        if n > WHOLE and not modal:
            found += [c._replace(A=A) for c, A in parts]
            continue
        whole = np.zeros(n) if modal else np.zeros((n, n))
        for c, A in parts:  # A: diagonal (k,) or matrix, c.A: always the matrix
            at = slice(c.rows.start - atoms.start, c.rows.stop - atoms.start)
            if modal:
                whole[at] += A
            else:
                whole[at, at] += c.A
        found.append(ConstantOperator(atoms, atoms, of, whole))
    return found
