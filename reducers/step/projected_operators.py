"""Constant operators of one block on a trial basis (atoms) and under a test map (rows or left
matrix).

The test map is the only difference between the projected and the sampled reducers: Galerkin uses
atoms^T, the sparse method sampled rows, DEIM atoms^T for the linear operators of the block and an
interpolation from a few rows for its forces. All have m rows and k columns here.

*Projected* operators are T^T K A, with the trial basis A and the test map T^T. Of a step formula c'
= c1 c + r1 and c'' = c2 c + r2, r1 and r2 are known before the step.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.sparse import csr_array, issparse

from sparsemor.core import (
    Amplitude,
    Dictionary,
    FloatArray,
    Frame,
    IntArray,
    ReducedTerm,
    Table,
    Trial,
)
from sparsemor.core.protocols.separable import ElasticLocal, ElasticOperators, HeatBody
from sparsemor.core.protocols.term import PointArrays
from sparsemor.reducers.linalg.modal_coordinates import diagonal
from sparsemor.reducers.step.time_tables import projected_tables

PROPORTIONAL = 1e-8
"""Relative size of damping that couples eigenmodes below which it is round-off."""


@dataclass(frozen=True, slots=True, eq=False)
class TestMap:
    """Test map (left projection) of a block: `rows` (m,), a dense `left` (l, n), or `left` (l, m)
    of those rows; identity if both are None."""

    rows: IntArray | None = None
    left: FloatArray | None = None

    @property
    def identity(self) -> bool:
        return self.rows is None and self.left is None

    def __call__(self, matrix: Any) -> Any:
        """The map applied to a matrix (n, j) or vector (n,)."""
        chosen = matrix if self.rows is None else matrix[self.rows]
        return chosen if self.left is None else self.left @ chosen

    def then(self, left: FloatArray | None) -> "TestMap":
        """This map followed by the matrix left (l, m), None for the identity."""
        if left is None:
            return self
        return TestMap(self.rows, left if self.left is None else left @ self.left)

    def of_tables(self, tables: Sequence[Table]) -> tuple[Table, ...]:
        """The map applied to tabulated loads (T, n) at each of their T times."""
        chosen = tables if self.rows is None else [t.columns(self.rows) for t in tables]
        return tuple(chosen if self.left is None else [t.through(self.left) for t in chosen])

    def times(self, left: FloatArray, n: int) -> FloatArray:
        """Product of left (s, l) and this map as one matrix (s, n) for all n rows of the block."""
        both = left if self.left is None else left @ self.left
        if self.rows is None:
            return both
        matrix = np.zeros((len(left), n))
        matrix[:, self.rows] = both
        return matrix


@dataclass(frozen=True, slots=True, eq=False)
class ProjectedLocal:
    """A local term of an elastic block on the trial basis and under the test map, as a function of
    the coefficients [c | cT] of displacements and temperatures; of_temperature: True if it depends
    on temperatures alone; left: a further test map of its rows, None for the identity."""

    term: ReducedTerm
    of_temperature: bool
    left: FloatArray | None = None

    @classmethod
    def from_term(
        cls, local: ElasticLocal, atoms: Dictionary, heat: Dictionary | None, test: TestMap
    ) -> "ProjectedLocal":
        """Projection of a local term of a block with n unknowns and k atoms; heat: dictionary of
        the temperatures that it depends on, with kt atoms; None where there are none. local.hot:
        True for the term's columns that are temperatures."""
        n, elastic, thermal = len(atoms.offset), ~local.hot, local.hot
        k = atoms.atoms.shape[1]
        kt = 0 if heat is None else heat.atoms.shape[1]
        # trial basis of the values that the term reads, by the coefficients [c | cT]
        basis, offset = np.zeros((len(thermal), k + kt)), np.zeros(len(thermal))
        at = local.columns[elastic]
        basis[elastic, :k], offset[elastic] = atoms.atoms[at], atoms.offset[at]
        if heat is not None and thermal.any():
            at = local.columns[thermal]
            basis[thermal, k:], offset[thermal] = heat.atoms[at], heat.offset[at]
        # test map of the m rows of the term: its entries placed in the n rows of the block
        m = len(local.rows)
        placed = test(csr_array((np.ones(m), (local.rows, np.arange(m))), shape=(n, m)))
        left = np.ascontiguousarray(placed.toarray() if issparse(placed) else placed)
        # True: the term depends on temperatures alone (`of_temperature`)
        return cls(local.term.compress(Trial(basis, offset), left), bool(thermal.all()))

    def through(self, test: TestMap, m: int) -> "ProjectedLocal":
        """The term with a further test map of its m rows."""
        left = test(np.eye(m) if self.left is None else self.left)
        return ProjectedLocal(self.term, self.of_temperature, np.ascontiguousarray(left))

    def rows(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        """Forces (m,) at coefficients [c | cT] and their rates."""
        r = self.term.residual(x, v, a, t)
        return r if self.left is None else np.asarray(self.left @ r)

    def arrays(self) -> PointArrays | None:
        """The term as arrays, None where the projected one has none."""
        made = self.term.arrays()
        return made if made is None or self.left is None else made.through(self.left)


@dataclass(frozen=True, slots=True, eq=False)
class ProjectedElastic:
    """Elastic operators of one body on a trial basis and under a test map: m rows, k atoms, p frame
    directions, g rotation matrices M_g (`generators`), kt thermal columns, j prescribed loads.

        rows: mass r2 + damping r1 + (stiffness + c1 damping + c2 mass) c
              + directions sigma + sum_g kappa_g generators_g c + mu_g generators_g r1
              - coupling cT - loads amplitudes(t) - tables(t) + constant + local terms.

    The first line is under the map `test`; all other terms, the forces, are under `force` if it is
    given. functional (p, k) = directions^T atoms; quadratic (g, k, k) = atoms^T M_g atoms, empty
    (0, k, k) where no rigid equation needs it.
    """

    frame: Frame
    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    generators: FloatArray
    directions: FloatArray
    coupling: FloatArray
    loads: FloatArray
    constant: FloatArray
    quadratic: FloatArray
    functional: FloatArray
    amplitudes: tuple[Amplitude, ...]
    tables: tuple[Table, ...] = ()
    local: tuple[ProjectedLocal, ...] = ()

    @classmethod
    def from_operators(
        cls, ops: ElasticOperators, frame: Frame, atoms: Dictionary, heat: Dictionary | None,
        test: TestMap, force: TestMap | None = None, rigid: bool = True,
    ) -> "ProjectedElastic":
        """Projection of full-order elastic operators.

        heat: dictionary of the body's thermal block, None when it has no such block. force: test
        map of all terms but mass, damping and stiffness; `test` if None. rigid: False where the
        motion of frames is prescribed and no rigid equation needs the quadratic forms, which for a
        complete basis of 7000 atoms take minutes and a gigabyte.
        """
        force_map = test if force is None else force
        T, o = atoms.atoms, atoms.offset
        # sigma multiplies the columns of `loading`; P gives the functionals of u that frames read
        P = ops.directions.copy()
        loading = P
        Mo = [M @ o for M in ops.generators]
        if np.any(o):
            # z = X + offset + atoms c: the shape moves, and with it every direction M_g X
            frame = frame.shifted(P.T @ o, np.array([o @ q for q in Mo]))
            for column, g in frame.shape_columns:
                P[:, column] += Mo[g]
            loading = P.copy()
            for column, g in frame.stiff_columns:
                loading[:, column] += Mo[g]
        constant = test(ops.stiffness) @ o - force_map(ops.constant)
        coupling = np.zeros((len(constant), 0))
        if ops.coupling is not None and heat is not None:
            Kt = force_map(ops.coupling)
            constant = constant - Kt @ heat.offset
            coupling = np.asarray(Kt @ heat.atoms)
        k, mass = T.shape[1], np.asarray(test(ops.mass @ T))
        damping = np.zeros(mass.shape)
        if ops.damping.nnz or ops.damps:
            damping = np.asarray(test(ops.damping_force(T)))
        generators, quadratic = np.zeros((0, len(constant), k)), np.zeros((0, k, k))
        if ops.generators:
            generators = np.stack([np.asarray(force_map(M @ T)) for M in ops.generators])
        if ops.generators and rigid:
            quadratic = np.stack([T.T @ (M @ T) for M in ops.generators])
        return cls(
            frame=frame, mass=mass, damping=damping, stiffness=np.asarray(test(ops.stiffness) @ T),
            generators=generators, directions=np.asarray(force_map(loading)), coupling=coupling,
            loads=np.asarray(force_map(ops.loads)), constant=np.asarray(constant),
            quadratic=quadratic, functional=P.T @ T, amplitudes=ops.amplitudes,
            tables=projected_tables(ops.tables, force_map),
            local=tuple(ProjectedLocal.from_term(
                part, atoms, heat, force_map) for part in ops.local),
        )

    def in_modes(self) -> "ProjectedElastic":
        """Operators for atoms that are modal coordinates of their span: off-diagonal round-off is
        removed from mass and stiffness, and from damping proportional to them."""
        d = diagonal(self.damping)
        size = np.sqrt(np.abs(np.diagonal(d)))
        alone = (np.abs(self.damping - d) <= PROPORTIONAL * np.outer(size, size)).all()
        return replace(self, mass=diagonal(self.mass), stiffness=diagonal(self.stiffness),
                       damping=d if alone else self.damping)

    def through(self, test: TestMap) -> "ProjectedElastic":
        """These operators with a further test map of their m rows. `functional` and `quadratic`,
        which frames read, have no rows and stay."""
        if test.identity:
            return self
        m, k = self.mass.shape
        generators = [test(A) for A in self.generators]
        constant = test(self.constant)
        return replace(
            self, mass=test(self.mass), damping=test(self.damping), stiffness=test(self.stiffness),
            generators=np.stack(generators) if generators else np.zeros((0, len(constant), k)),
            directions=test(self.directions), coupling=test(self.coupling), loads=test(self.loads),
            constant=constant, tables=test.of_tables(self.tables),
            local=tuple(part.through(test, m) for part in self.local))

    def by_columns(self) -> "ProjectedElastic":
        """These operators with contiguous columns, of which some are soon read."""
        return replace(
            self, mass=np.asfortranarray(self.mass), damping=np.asfortranarray(self.damping),
            stiffness=np.asfortranarray(self.stiffness),
            coupling=np.asfortranarray(self.coupling),
            generators=np.ascontiguousarray(
                self.generators.transpose(0, 2, 1)).transpose(0, 2, 1))

    def of_atoms(
        self, use: IntArray, warm: IntArray, rows: IntArray | None = None
    ) -> "ProjectedElastic":
        """These operators, without local terms, for the atoms `use` of the displacements and `warm`
        of the temperatures; in all rows (None), or in those numbered `rows` alone."""
        def some(A: FloatArray, columns: IntArray) -> FloatArray:
            """Columns of a matrix, or of a stack of matrices, in the rows."""
            if rows is None or not A.size:
                return A[..., columns] if A.size else A
            return np.asarray(A[..., rows[:, None], columns])

        test = TestMap(rows)
        return replace(
            self, mass=some(self.mass, use), damping=some(self.damping, use),
            stiffness=some(self.stiffness, use),
            generators=some(self.generators, use) if len(self.generators) else (
                np.zeros((0, len(test(self.constant)), len(use)))),
            quadratic=self.quadratic[:, use[:, None], use], functional=self.functional[:, use],
            coupling=some(self.coupling, warm), directions=test(self.directions),
            loads=test(self.loads), constant=test(self.constant),
            tables=test.of_tables(self.tables))

    def block(self, c1: float, c2: float) -> FloatArray:
        """Operator D = stiffness + c1 damping + c2 mass of a step, (m, k)."""
        return np.asarray(self.stiffness + c1 * self.damping + c2 * self.mass)


@dataclass(frozen=True, slots=True, eq=False)
class ProjectedHeat:
    """Thermal operators of one block on a trial basis and under a test map: m rows of capacity T' +
    conductivity T - constant - loads amplitudes(t) - tables(t).

    The last three terms are forces, under the map `force` if it is given.
    """

    capacity: FloatArray
    conductivity: FloatArray
    constant: FloatArray
    loads: FloatArray
    amplitudes: tuple[Amplitude, ...]
    tables: tuple[Table, ...] = ()

    @classmethod
    def from_operators(
        cls, heat: HeatBody, atoms: Dictionary, test: TestMap, force: TestMap | None = None
    ) -> "ProjectedHeat":
        """Projection of full-order thermal operators; force: test map of the forces, `test` if
        None."""
        T, o, force_map = atoms.atoms, atoms.offset, test if force is None else force
        K = test(heat.conductivity)
        return cls(
            np.asarray(test(heat.capacity) @ T), np.asarray(K @ T),
            np.asarray(force_map(heat.constant) - K @ o), np.asarray(force_map(heat.loads)),
            heat.amplitudes, projected_tables(heat.tables, force_map))

    def in_modes(self) -> "ProjectedHeat":
        """Operators for atoms that are modal coordinates of their span: off-diagonal round-off is
        removed."""
        return replace(
            self, capacity=diagonal(self.capacity), conductivity=diagonal(self.conductivity))

    def through(self, test: TestMap) -> "ProjectedHeat":
        """These operators with a further test map of their rows."""
        if test.identity:
            return self
        return replace(
            self, capacity=test(self.capacity), conductivity=test(self.conductivity),
            constant=test(self.constant), loads=test(self.loads),
            tables=test.of_tables(self.tables))

    def of_atoms(self, use: IntArray) -> "ProjectedHeat":
        """These operators for some atoms."""
        return replace(
            self, capacity=self.capacity[:, use], conductivity=self.conductivity[:, use])

    def block(self, c1: float) -> FloatArray:
        """Operator B = c1 C + K of a step, (m, k)."""
        return np.asarray(self.conductivity + c1 * self.capacity)
