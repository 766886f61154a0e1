"""Reduced models in which a term couples bodies, such as contact between deformable surfaces.

All unknowns of the step are solved together: rigid coordinates, multipliers and the coefficients of
all atoms, by Newton's method with a dense Jacobian. Each coupling term is evaluated on the trial
bases of the blocks and projected by their test maps; local terms visit elements near the sampled
rows only.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, Generic, TypeVar

import numpy as np

from sparsemor.core import (
    AssembledModel,
    Dictionary,
    FloatArray,
    IntArray,
    Layout,
    Note,
    State,
    StepFormula,
    Term,
    Trial,
    information,
)
from sparsemor.core.model.compressed_local import CompressedLocal
from sparsemor.core.model.constraint_rates import along_motion, motion_step
from sparsemor.core.protocols.step_solver import unavailable_resultants
from sparsemor.core.protocols.time_function import derivative_from_right, time_derivatives
from sparsemor.reducers.block_counts import coupling, elements
from sparsemor.reducers.linalg.least_norm import least
from sparsemor.reducers.step.blockwise_solver import Facts, reduce_state
from sparsemor.reducers.step.convergence_test import Tolerances
from sparsemor.reducers.step.frame_step import BodyStep, PrescribedFactors
from sparsemor.reducers.step.local_copies import Coupled
from sparsemor.reducers.step.monolithic_step import WholeMemory, WholeStepper, linear_response
from sparsemor.reducers.step.newton_loop import Loop
from sparsemor.reducers.step.projected_operators import ProjectedElastic, ProjectedHeat, TestMap
from sparsemor.reducers.step.reduced_equations import BodyRows, HeatRows, Reduced, positions

T = TypeVar("T", ProjectedElastic, ProjectedHeat)


@dataclass(frozen=True, slots=True, eq=False)
class ProjectedBlock(Generic[T]):
    """One block on its trial basis of k atoms and under its test maps, with l rows. left (k, l):
    left inverse of the projected operator of a step, left @ (K + c1 C + c2 M) = 1 (of heat K + c1
    C), None for rows that stay as they are; forces: test map of all other terms."""

    operators: T
    left: FloatArray | None
    forces: TestMap

    @property
    def solved(self) -> T:
        """The rows multiplied by the left inverse, so that the block's own operator is the
        identity."""
        if self.left is None:
            return self.operators
        return self.operators.through(TestMap(left=self.left))

    def force_map(self, n: int) -> FloatArray:
        """Left inverse times the test map of forces, (k, n), for all n rows of the block."""
        left = np.eye(len(self.operators.constant)) if self.left is None else self.left
        return self.forces.times(left, n)


@dataclass(frozen=True, slots=True, eq=False)
class ProjectedModel:
    """A model with its blocks projected; without projected blocks a model of rigid bodies. rows:
    sampled rows of each block; heat, elastic: projected blocks by name."""

    model: AssembledModel
    dictionaries: Mapping[str, Dictionary] = field(default_factory=dict)
    rows: Mapping[str, IntArray] = field(default_factory=dict)
    heat: Mapping[str, ProjectedBlock[ProjectedHeat]] = field(default_factory=dict)
    elastic: Mapping[str, ProjectedBlock[ProjectedElastic]] = field(default_factory=dict)

    @property
    def layout(self) -> Layout:
        return self.model.layout.resized(
            {n: d.atoms.shape[1] for n, d in self.dictionaries.items()})

    @property
    def row_layout(self) -> Layout | None:
        """Layout of the rows, where some are not times the left inverse of their block."""
        blocks: dict[str, ProjectedBlock[Any]] = {**self.heat, **self.elastic}
        if all(b.left is not None for b in blocks.values()):
            return None
        return self.layout.resized({n: len(b.solved.constant) for n, b in blocks.items()})

    def force_map(self, name: str) -> FloatArray:
        """Left inverse of a block times its test map of forces, (k, n)."""
        n = len(self.dictionaries[name].offset)
        block = self.heat[name] if name in self.heat else self.elastic[name]
        return block.force_map(n)


@dataclass(frozen=True, slots=True, eq=False)
class ReducedGeneral(WholeStepper):
    """Step solver of a reduced model with dense equations for all unknowns together. Without
    dictionaries it is one of rigid bodies, whose initial state is consistent already."""

    equations: Reduced

    def start(self, state: State) -> tuple[State, WholeMemory]:
        if self.dictionaries:
            state = with_rates(self.equations.working(), reduce_state(
                state, self.layout, self.dictionaries))
        return WholeStepper.start(self, state)

    def alone(self) -> Mapping[str, FloatArray]:
        """Elastic block -> (k, 2 k): response to changes of its r1 and r2, all others fixed."""
        return self.equations.alone()

    def response(self, step: StepFormula, x: FloatArray) -> FloatArray:
        """Linear response (n, 2 n) of the step's solution x to changes of [r1; r2]."""
        return linear_response(self.equations, step, x)


def reduced_general(
    projected: ProjectedModel, tolerances: Tolerances, points: int,
    limits: Mapping[str, float] | None = None, notes: tuple[Note, ...] = (),
    facts: Facts | None = None, ahead: bool = True,
) -> ReducedGeneral:
    """Step solver of a reduced model in which terms couple bodies; points: number of past states to
    extrapolate; limits: largest permitted |coefficient| of each block; facts: block -> numbers to
    report; ahead: True if prescribed motion and loads are evaluated now for all their times."""
    model, dictionaries = projected.model, projected.dictionaries
    equations = dense_equations(projected, ahead=ahead)
    coupled, terms = equations.coupled, coupling_terms(model)
    visited = elements(model, [c.term for c in coupled], [t.rows for t in terms])
    count = sum(c.term.elements for c in coupled)
    # named: name of each coupling term in the scene, "" without one, and the blocks that it couples
    names = ", ".join(sorted({n for n, _ in equations.named if n})) or "a term"
    reports = (information(
        f"{names} couples blocks inside the step: all unknowns are solved together, and each "
        f"evaluation visits {count} elements", "coupled"),) if dictionaries else ()
    reports = (*notes, *reports, *unavailable_resultants(c.term for c in coupled))
    return ReducedGeneral(
        equations=equations, loop=Loop(equations.layout, tolerances), elements_touched=visited,
        points=points, dictionaries=dictionaries, rows=projected.rows, limits=limits or {},
        notes=reports, facts=facts or {})


def dense_equations(
    projected: ProjectedModel, by_elements: bool = False, ahead: bool = True
) -> Reduced:
    """Equations of a whole step of a reduced model. by_elements: local terms are evaluated with
    their sparse derivatives at each element, which for many atoms costs less than projected points;
    they must be left out of the elastic operators in `projected`. ahead: True if prescribed motion
    and loads are evaluated now for all their times.

    Rows are one to one with unknowns unless a block keeps its sampled rows (`row_layout`)."""
    model, layout, rows = projected.model, projected.layout, projected.row_layout
    project = _TermProjection(
        model, layout, rows=rows or layout, dictionaries=projected.dictionaries,
        force_map=cache(projected.force_map), by_elements=by_elements)
    return Reduced(
        layout,
        heat=[HeatRows(layout[n], b.solved) for n, b in projected.heat.items()],
        bodies=_bodies(projected, ahead), coupled=[project(t) for t in coupling_terms(model)],
        targets=model.separated.border_targets, border=positions(layout), h=model.separated.step,
        named=coupling(model), rows=rows)


def coupling_terms(model: AssembledModel) -> list[Term]:
    """Terms that are not linear in the unknowns of one body, or act between bodies."""
    s = model.separated
    return [*(t for b in s.heat for t in b.local), *s.elastic_local, *s.between]


def _bodies(projected: ProjectedModel, ahead: bool) -> list[BodyRows]:
    """All bodies; where no rigid coordinate is unknown, with kappa, mu and sigma of their frames as
    functions of time (`factors`), tabulated if `ahead`."""
    layout, prescribed = projected.layout, not projected.model.separated.border_size
    found = []
    for m in projected.model.separated.moving:
        block = projected.elastic.get(m.elastic)
        operators = None if block is None else block.solved
        step = BodyStep.from_body(m, layout, None if operators is None else operators.frame)
        factors = PrescribedFactors.table(step, m, ahead) if (
            prescribed and operators is not None) else None
        found.append(BodyRows(step, operators, factors))
    return found


@dataclass(frozen=True, slots=True, eq=False)
class _TermProjection:
    """Projection of a coupling term block by block. layout: of the reduced unknowns; rows: of the
    reduced rows; force_map: block name -> test map (l, n) of its forces; by_elements: terms with
    point values keep their sparse derivatives at each element."""

    model: AssembledModel
    layout: Layout
    rows: Layout
    dictionaries: Mapping[str, Dictionary]
    force_map: Callable[[str], FloatArray]
    by_elements: bool = False

    def __call__(self, term: Term) -> Coupled:
        trial, columns = self._trial(term.columns)
        left, rows = self._left(term.rows)
        if self.by_elements and term.point_values:
            return Coupled(CompressedLocal.of(term, trial, left), rows, columns)
        return Coupled(term.compress(trial, left), rows, columns)

    def _parts(self, at: IntArray) -> Iterable[tuple[str, IntArray, IntArray]]:
        """For each block that contains some of the unknowns `at`: its name, their positions in
        `at`, and their positions in the block."""
        full = self.model.layout
        for b in full:
            here = full[b.name]
            some = np.flatnonzero((at >= here.start) & (at < here.stop))
            if len(some):
                yield b.name, some, at[some] - here.start

    def _trial(self, at: IntArray) -> tuple[Trial, IntArray]:
        """Trial basis of the unknowns `at` (n,) of the full model, atoms (n, k) and offset (n,),
        and the numbers (k,) of the reduced unknowns; those without a dictionary are their own.
        Of each block, `some` are positions in `at` and `local` those in the block."""
        offset = np.zeros(len(at))
        columns, numbers = [np.zeros((len(at), 0))], [np.zeros(0, np.int64)]
        for name, some, local in self._parts(at):
            d = self.dictionaries.get(name)
            used = np.unique(local) if d is None else np.arange(d.atoms.shape[1])
            atoms = np.zeros((len(at), len(used)))
            if d is None:
                atoms[some, np.searchsorted(used, local)] = 1.0
            else:
                atoms[some], offset[some] = d.atoms[local], d.offset[local]
            columns.append(atoms)
            numbers.append(self.layout[name].start + used)
        return Trial(np.hstack(columns), offset), np.concatenate(numbers)

    def _left(self, at: IntArray) -> tuple[FloatArray, IntArray]:
        """Test map (l, n) of the rows `at` (n,) of the full model to reduced rows, and the numbers
        (l,) of these; rows without a dictionary are their own. Of each block, `some` are positions
        in `at` and `local` those in the block."""
        parts, numbers = [np.zeros((0, len(at)))], [np.zeros(0, np.int64)]
        for name, some, local in self._parts(at):
            map_ = self.force_map(name) if name in self.dictionaries else None
            used = np.unique(local) if map_ is None else np.arange(len(map_))
            left = np.zeros((len(used), len(at)))
            if map_ is None:
                left[np.searchsorted(used, local), some] = 1.0
            else:
                left[:, some] = map_[:, local]
            parts.append(left)
            numbers.append(self.rows[name].start + used)
        return np.vstack(parts), np.concatenate(numbers)


def with_rates(equations: Reduced, state: State) -> State:
    """The state with accelerations, rates of temperature and multipliers that satisfy the reduced
    equations: of least norm where these are not determined (consistent_start.py).

    They are linear in these unknowns z, A z + r = 0; constraints enter as their second time
    derivative. K, C, M (n, n): derivatives of the residual by x, v and a. z and the columns of A
    are in the order of the layout: the slices `second` (accelerations), `first` (rates of
    temperature) and `algebraic` (changes of multipliers) follow each other.
    """
    layout, t, x, a = equations.layout, state.t, state.x.copy(), np.zeros(len(state.x))
    second, first, algebraic = layout.second, layout.first, layout.algebraic
    v, zero, one = state.v.copy(), np.zeros(layout.size), np.ones(layout.size)
    v[first] = 0.0
    K = equations.slope(x, v, a, t, c1=zero, c2=zero)
    c1, c2 = 1.0 / equations.h, 1.0 / equations.h**2  # mass is not lost against stiffness
    C = (equations.slope(x, v, a, t, c1=c1 * one, c2=zero) - K) / c1
    M = (equations.slope(x, v, a, t, c1=zero, c2=c2 * one) - K) / c2
    A = np.hstack([M[:, second], C[:, first], K[:, algebraic]])
    A[algebraic] = 0.0  # second derivative of constraints: G a + quadratic terms
    A[algebraic, second] = K[algebraic, second]
    r = equations.residual_at(x, v, a, t, equations.prescribed(t))
    r[algebraic] = _curvature(equations, x, v, t)
    z = -_eliminated(A, r, equations.border)  # border: rigid coordinates and multipliers
    a[second], v[first] = z[second], z[first]
    x[algebraic] += z[algebraic]
    return replace(state, x=x, v=v, a=a)


def _eliminated(A: FloatArray, r: FloatArray, border: IntArray) -> FloatArray:
    """Solution z of A z = r; the coefficients of atoms, which masses and capacities determine, are
    eliminated first, then the unknowns numbered `border`, rigid coordinates and multipliers, are
    solved for, with least norm where they are not determined."""
    inner = np.setdiff1d(np.arange(len(r)), border)
    # Schur complement; the last column belongs to r
    right = np.column_stack([A[np.ix_(inner, border)], r[inner]])
    inner_solution = np.linalg.lstsq(A[np.ix_(inner, inner)], right, rcond=None)[0]
    rest = A[np.ix_(border, inner)] @ inner_solution
    z = np.zeros(len(r))
    z[border] = least(A[np.ix_(border, border)] - rest[:, :-1], r[border] - rest[:, -1])
    z[inner] = inner_solution[:, -1] - inner_solution[:, :-1] @ z[border]
    return z


def _curvature(equations: Reduced, x: FloatArray, v: FloatArray, t: float) -> FloatArray:
    """Second time derivative of the constraints g at zero accelerations,

        (d/ds G(x + s v, t)) v + 2 (dG/dt) v + d2g/dt2,    G = dg/dx

    (core/model/constraint_rates.py), time derivatives those of frames, prescribed values and terms.
    """
    layout, zero, h = equations.layout, np.zeros(len(x)), equations.h
    rows, moving = layout.algebraic, np.zeros(len(x))
    moving[layout.second] = v[layout.second]

    def rate(e: Reduced, s: float, time: float) -> FloatArray:
        """G(x + s v, time) v of the constraint rows of equations e."""
        J = e.slope(x + s * moving, zero, zero, time, c1=zero, c2=zero)
        return np.asarray(J[rows] @ moving)

    def value(e: Reduced, time: float) -> FloatArray:
        """Values g of the constraint rows of equations e, without prescribed ones."""
        return e.residual_at(x, zero, zero, time, prescribed=zero)[rows]

    # derivative by s at 0: sum of weight times value at s, a central difference
    found = sum([weight * rate(equations, s, t)
                 for s, weight in along_motion(motion_step(layout, moving, h))])
    once, twice = (equations.time_derivative(n, t) for n in (1, 2))
    found = found + 2.0 * rate(once, 0.0, t) + value(twice, t)
    for i, f in equations.targets:  # position in `border`, prescribed value; g = (...) - f(t)
        found[equations.border[i] - rows.start] -= time_derivatives(f, t, h)[1]
    if equations.coupled:  # their time derivatives: finite differences
        other = equations.terms_alone()
        found = found + derivative_from_right(lambda s: value(other, s), 2, t, h)
        found = found + 2.0 * derivative_from_right(lambda s: rate(other, 0.0, s), 1, t, h)
    return found
