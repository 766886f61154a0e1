"""One block of the sparse method: its sampled rows, preconditioner and budget, and its reduced
operators for a support (set of active atoms)."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from scipy.sparse import eye_array

from sparsemor.core import (
    AssembledModel,
    BoolArray,
    Csr,
    Dictionary,
    FloatArray,
    InputError,
    IntArray,
    OfflineProducts,
    Preconditioner,
    Sampler,
    StepFactors,
)
from sparsemor.core.linalg.column_subsets import ColumnSubsets, is_unit_matrix
from sparsemor.core.linalg.dense import coherence, condition_number, orthonormal, svd, unit_columns
from sparsemor.core.model.factorizations import solve_or_fail
from sparsemor.core.protocols.separable import HeatBody
from sparsemor.core.registry.returned_values import built_weights, sampled_rows
from sparsemor.reducers.block_counts import compresses, required_rows
from sparsemor.reducers.linalg.left_inverse import SAMPLED_RTOL, left_inverse, squares
from sparsemor.reducers.sparse.row_compression import compact, elastic_columns, heat_columns
from sparsemor.reducers.sparse.supported_equations import ActiveRows
from sparsemor.reducers.step.convergence_test import Tolerances
from sparsemor.reducers.step.projected_operators import ProjectedElastic, ProjectedHeat, TestMap
from sparsemor.reducers.step.thermal_block import CompressedHeat
from sparsemor.reducers.trial_bases import DEPENDENT, local_terms

T = TypeVar("T", ProjectedElastic, ProjectedHeat)
_CHUNK = 256
"""Number of right-hand sides that are solved at once."""


@dataclass(frozen=True, slots=True, eq=False)
class Sampled:
    """Sampled rows of one block. B (m, k), or (k, k) with a P (k, m), = P times the sampled rows of
    the step's operator D (heat: c1 C + K) times the atoms.

    test: map of the residual to the sampled rows, or to all rows of D^-1 r compressed to as many
    as atoms; weight (m, m) or None: the preconditioner P, (k, m) where it needs as few rows as
    atoms; budget: largest number of active atoms.
    """

    name: str
    dictionary: Dictionary
    test: TestMap
    budget: int
    B: FloatArray
    weight: FloatArray | None

    @property
    def atoms(self) -> int:
        return int(self.B.shape[1])

    @property
    def selects(self) -> bool:
        return self.budget < self.atoms

    def left_inverse(self, support: IntArray | None) -> FloatArray:
        """Left inverse (s, m) of the columns of B on the support, by least squares. Raises
        SolveFailed."""
        return on_support(self.name, self.B, support)

    def without_map(self) -> "Sampled":
        """The block for steps that need no rows of other forces, without an array of its size."""
        return replace(self, test=TestMap())

    def on_all_rows(self, left: FloatArray) -> FloatArray:
        """Combinations left (l, m) of the sampled rows as combinations (l, n) of all n rows."""
        P = self.weight
        return self.test.times(left if P is None else left @ P, len(self.dictionary.offset))


def on_support(name: str, B: FloatArray, support: IntArray | None) -> FloatArray:
    """Left inverse (s, m) of the columns of B (m, k) in the support, by least squares. Raises
    SolveFailed."""
    return left_inverse(name, B if support is None else B[:, support], sampled=True)


@dataclass(frozen=True, slots=True, eq=False)
class RangeColumns:
    """Columns of B (j, k) in the compressed rows where B is nonzero. lengths (k,): their lengths, 1
    for a column of zeros; unit: the columns scaled to unit length, with factors of subsets."""

    name: str
    B: FloatArray
    lengths: FloatArray
    unit: ColumnSubsets

    @classmethod
    def from_matrix(cls, name: str, B: FloatArray) -> "RangeColumns":
        size = np.sqrt(squares(B))
        lengths = np.where(size > 0.0, size, 1.0)
        return cls(name, B, lengths, ColumnSubsets(np.ascontiguousarray(B / lengths), SAMPLED_RTOL))

    def left_inverse(self, support: IntArray | None) -> FloatArray:
        """Left inverse (s, j) of the columns on the support, by least squares. Raises
        SolveFailed."""
        mask = np.zeros(self.B.shape[1], dtype=np.bool_)
        mask[slice(None) if support is None else support] = True
        inverse = self.unit.left_inverse(mask)
        if inverse is None:
            return on_support(self.name, self.B, support)  # which reports why
        return np.asarray(inverse / self.lengths[mask][:, None])


@dataclass(frozen=True, slots=True, eq=False)
class SampledBlock(Generic[T]):
    """Sampled rows of a block and their compressions.

    operators: operators in the sampled rows, including the preconditioner. compressed: operators
    and B in the compressed rows (row_compression.py) where atoms are selected; columns: B in the
    rows in which it is nonzero, the first ones and the only ones that affect a least-squares
    solution; basis (m, l): basis of the compressed rows in the sampled rows, None where they are
    the same.
    """

    block: Sampled
    operators: T
    compressed: tuple[T, FloatArray]
    columns: RangeColumns
    basis: FloatArray | None


@dataclass(frozen=True, slots=True, eq=False)
class SampledElastic(SampledBlock[ProjectedElastic]):
    """Sampled rows of an elastic block. block: its m rows, with the operator B (m, k) of a step on
    its atoms, and its budget; compressed: operators and B in fewer rows where atoms are selected,
    by an orthonormal `basis` (m, l) of the columns of all operators, None for the rows as they are;
    columns: the first rows of the compressed B, in the others it is zero."""

    @classmethod
    def from_operators(cls, block: Sampled, operators: ProjectedElastic) -> "SampledElastic":
        """A sampled elastic block, its rows compressed where atoms are selected."""
        if not block.selects:
            return cls(block, operators, compressed=(operators, block.B),
                       columns=RangeColumns.from_matrix(block.name, block.B), basis=None)
        c = compact(operators, block.B, elastic_columns(operators))
        t, B = c.operators, c.B
        # all compressed rows are in the range of B: few active columns are read in each step
        if c.reach == len(B):
            t, B = t.by_columns(), np.asfortranarray(B)
        columns = RangeColumns.from_matrix(block.name, B[: c.reach])
        return cls(block, operators, (t, B), columns, c.basis)

    @property
    def forces(self) -> TestMap | None:
        """Test map of other forces in the rows of `compressed`, None where these are the sampled
        ones; there are none in blocks whose atoms are selected: the identity is never applied."""
        return TestMap() if self.block.selects else None

    def on(self, support: IntArray | None) -> ActiveRows:
        """The active rows on a support, of all atoms if None. Raises SolveFailed."""
        active = np.arange(self.block.atoms) if support is None else support
        if self.columns.unit.unit:  # B is the unit matrix: its rows `active` are a left inverse
            return ActiveRows(active, chosen=active)
        return ActiveRows(active, self.columns.left_inverse(support))


@dataclass(frozen=True, slots=True, eq=False)
class SampledHeat(SampledBlock[ProjectedHeat]):
    """Sampled rows of a thermal block; range_rows: operators in the rows of `columns`; c1: factor
    of rates in a step.

    block: its m sampled rows, with the operator B (m, k) of a step on its atoms. Where rows are
    compressed, `basis` Z (m, l) is orthonormal, block.B = Z[:, :j] columns.B with columns.B (j, k),
    and `compressed` are operators and B times Z^T; else Z is None, and these rows are the sampled
    ones. on_all_rows turns combinations (s, m) of sampled rows, which include the preconditioner,
    into combinations (s, n) of all rows of the block.
    """

    range_rows: ProjectedHeat
    model: AssembledModel
    body: HeatBody
    c1: float
    tolerances: Tolerances

    @classmethod
    def from_operators(
        cls, block: Sampled, operators: ProjectedHeat, model: AssembledModel, body: HeatBody,
        c1: float, tolerances: Tolerances,
    ) -> "SampledHeat":
        """A sampled thermal block, its rows compressed where atoms are selected: to those of an
        orthonormal basis whose first c.reach columns span the range of B (m, k). operators: in the
        m sampled rows; c1: factor of rates in a step."""
        if not block.selects:
            return cls(block, operators, compressed=(operators, block.B),
                       columns=RangeColumns.from_matrix(block.name, block.B), basis=None,
                       range_rows=operators, model=model, body=body, c1=c1, tolerances=tolerances)
        # the span of local terms is not known: as many compressed rows as sampled ones
        c = compact(operators, block.B, (
            np.eye(len(block.B)),) if body.local else heat_columns(operators))
        in_range = np.arange(c.reach)  # rows in which B is not zero
        return cls(
            block, operators, compressed=(c.operators, c.B),
            columns=RangeColumns.from_matrix(block.name, c.B[in_range]), basis=c.basis,
            range_rows=c.operators.through(TestMap(in_range)), model=model, body=body, c1=c1,
            tolerances=tolerances)

    @property
    def forces(self) -> TestMap | None:
        """Test map of forces in the rows of `compressed`, None where these are the sampled ones."""
        Z = self.basis
        return None if Z is None else self.block.test.then(self.block.weight).then(Z.T)

    def on(self, support: IntArray | None) -> CompressedHeat:
        """The reduced block on a support, of all atoms if None. range_rows: its operators in the
        rows in which B is not zero. Raises SolveFailed."""
        # B is the unit matrix: the rows of the support are its left inverse
        if self.columns.unit.unit and support is not None and not self.body.local:
            return CompressedHeat.of_orthonormal(
                self.range_rows, support, self.c1, self.tolerances)
        inverse = self.columns.left_inverse(support)
        # the same in the sampled rows, under which local terms are evaluated
        rows = inverse if self.basis is None else inverse @ self.basis[:, : inverse.shape[1]].T
        local = local_terms(self.model, self.body, self.block.dictionary, self.block.on_all_rows(
            rows)) if self.body.local else []
        return CompressedHeat.from_operators(
            self.range_rows, inverse, support, self.c1, self.tolerances, local)


SPREAD = 2.0
"""Largest ratio sqrt(m/n) / sigma of m sampled rows of n to which their number is raised; sigma:
smallest singular value of the sampled rows of an orthonormal basis of the operator's columns. The
least-squares solution of the sampled rows has at most 1/sigma times the residual of that of all
rows, and sqrt(1 + SPREAD^2) = 2.2 times for residuals spread evenly over the rows (of D^-1 r, a
residual is an error of displacements or temperatures)."""
MOST_TIMES = 16
"""Largest number of rows, as a multiple of the number of atoms, that is taken for this bound."""


def choose_rows(
    model: AssembledModel, offline: OfflineProducts | None, name: str, rows: int | None,
    budget: int, sampler: Sampler, dictionary: Dictionary, rng: np.random.Generator,
    step: StepFactors, preconditioned: bool = False,
) -> IntArray:
    """Row numbers (m,) drawn by the sampler, including the required ones; cached if `offline` is
    given. rows: number of rows, None for the smallest of 2, 4, 8, 16 times the number of atoms
    whose solutions are within `SPREAD` of those of all rows.

    budget: largest number of active atoms, which the rows must at least be. rng is used for this
    draw alone; a cached result leaves its state unchanged. preconditioned: True for rows of D^-1 r,
    whose operator is the identity. Raises InputError for too few rows.
    """
    required, data = model.required[name], model.block_data(name, step=step)
    if preconditioned:
        one = eye_array(data.size, format="csr")
        data = replace(data, stiffness=one, mass=0.0 * one, damping=None)

    def draw(count: int) -> IntArray:
        """Required rows and `count` others."""
        return sampled_rows(sampler, data, count, dictionary, rng, required)

    def make() -> dict[str, IntArray]:
        """Sampled rows as they are cached; without a number of rows so many of n that they
        determine the k atoms well: doubled until sqrt(m/n) <= SPREAD sigma, at most MOST_TIMES
        k."""
        if rows is not None:
            return {"rows": draw(rows)}
        k, n = dictionary.atoms.shape[1], data.size
        Q = span(unit_columns(data.operator @ dictionary.atoms))
        most = n - required_rows(model, name, sampler)
        count = min(2 * k, most)
        while True:
            found = draw(count)
            # smallest singular value of the sampled rows of an orthonormal basis (`SPREAD`)
            sigma = float(svd(Q[found])[1].min(initial=np.inf)) if len(found) >= Q.shape[1] else 0.0
            if np.sqrt(len(found) / n) <= SPREAD * sigma or count >= min(MOST_TIMES * k, most):
                return {"rows": found}
            count = min(2 * count, most)

    drawn = repr(rng.bit_generator.state)
    depends = (name, rows, sampler, dictionary.atoms, required, drawn, data.ring, data.stiffness,
               data.mass, data.factors)
    stored = make() if offline is None else offline.remember("rows", depends, make)
    chosen: IntArray = np.asarray(stored["rows"])
    active = min(budget, dictionary.atoms.shape[1])
    if len(chosen) < active:
        raise InputError(
            f"{name}: {len(chosen)} rows cannot determine {active} active atoms; take more rows "
            "or fewer atoms", "reducer.budgets")
    return chosen


def weigh(
    offline: OfflineProducts | None, preconditioner: Preconditioner, name: str, B: FloatArray
) -> FloatArray | None:
    """Preconditioner matrix P (m, m) for the sampled rows B (m, k), None for the identity; cached
    if `offline` is given.

    One that is undefined for more rows than atoms is applied to R of B = Q R: P = P_R Q^T (k, m).
    Least-squares solutions by Q^T B are those by B for every set of active atoms. Raises InputError
    where it is undefined for this shape, too.
    """
    Q = None
    if compresses(preconditioner, *B.shape):
        Q, B = np.linalg.qr(B)
    reason = preconditioner.check(*B.shape)
    if reason:
        raise InputError(f"{name}: {reason}", "reducer.preconditioner")

    def make() -> dict[str, FloatArray]:
        """Matrix of the preconditioner as it is cached."""
        return {"P": built_weights(preconditioner, B)}

    stored = make() if offline is None else offline.remember(
        "preconditioner", (preconditioner, B), make)
    P: FloatArray = np.asarray(stored["P"])
    if Q is not None:
        return np.asarray(P @ Q.T)
    return None if np.array_equal(P, np.eye(len(P))) else P


def row_facts(B: FloatArray, weight: FloatArray | None) -> Mapping[str, float | int | str]:
    """Mutual coherence and condition number of the sampled rows B (m, k), before and after
    preconditioning.

    `condition` is computed for unit columns, because each solve scales the columns.
    """
    unit = is_unit_matrix(B)  # orthonormal atoms in all rows of D^-1 r
    facts: dict[str, float | int | str] = {
        "rows": len(B), "atoms": B.shape[1], "coherence": 0.0 if unit else coherence(B),
        "condition": 1.0 if unit else condition_number(unit_columns(B))}
    if weight is not None:
        F = weight @ B
        facts |= {"coherence_after": coherence(F),
                  "condition_after": condition_number(unit_columns(F))}
    return facts


def numbers(support: BoolArray) -> IntArray | None:
    """Numbers of the active atoms; None when all are active."""
    return None if support.all() else np.flatnonzero(support)


def span(atoms: FloatArray) -> FloatArray:
    """Orthonormal basis (n, l) of the span of atoms (n, k): the atoms themselves if they are."""
    if orthonormal(atoms):
        return atoms
    U, s, _ = svd(atoms)
    return np.ascontiguousarray(U[:, s > DEPENDENT * s.max(initial=0.0)])


class CompressedRows(NamedTuple):
    """All rows of D^-1 r of a block, compressed to as many as its atoms A: left (l, n) times r,
    with the operator B = left D A (l, k)."""

    left: FloatArray
    B: FloatArray

    @classmethod
    def from_atoms(
        cls, model: AssembledModel, offline: OfflineProducts, name: str, step: StepFactors,
        atoms: FloatArray, changing: bool
    ) -> "CompressedRows":
        """Rows Q^T D^-1 r with an orthonormal basis Q of the atoms, whose least-squares solutions
        are those of all rows of D^-1 r: the error that r causes.

        changing: True where the operator changes in the run. D^-1 r is no error then, and large
        rotations by bending make its solutions diverge: the rows (A^T D A)^-1 A^T r minimise its
        energy r^T D^-1 r, and A^T r is the virtual work of the atoms whatever the operator is.
        """
        D = model.block_data(name, step=step).operator
        if changing:
            return cls(left_inverse(name, atoms.T @ (D @ atoms)) @ atoms.T, np.eye(atoms.shape[1]))
        Q = span(atoms)
        B = np.eye(Q.shape[1]) if Q is atoms else Q.T @ atoms
        return cls(inverse_rows(model, offline, name, D, Q), B)


def effect_of_rows(
    model: AssembledModel, offline: OfflineProducts, name: str, step: StepFactors,
    atoms: FloatArray, rows: IntArray
) -> FloatArray:
    """Map (k, n) of forces on all rows of a block to the coefficients that the sampled rows of
    D^-1 r recover, those of least norm where the rows are fewer than the atoms."""
    D = model.block_data(name, step=step).operator
    return np.asarray(np.linalg.pinv(atoms[rows]) @ inverse_rows(model, offline, name, D, rows))


def inverse_rows(
    model: AssembledModel, offline: OfflineProducts | None, name: str, operator: Csr,
    rows: IntArray | FloatArray
) -> FloatArray:
    """Rows (m, n) of the inverse of a block's symmetric operator (n, n): those with the numbers
    `rows` (m,), or combinations of all, rows^T D^-1 with `rows` (n, m).

    One solve per row; cached if `offline` is given.
    """
    def make() -> Mapping[str, FloatArray]:
        """Rows of the inverse as they are cached, by solves of a chunk of right-hand sides at a
        time: unit vectors for numbers of rows (m,), else the columns of `rows` (n, m)."""
        factor, n = model.factorize(name, operator, "rows of the inverse"), operator.shape[0]
        count = rows.shape[-1]
        inverse = np.empty((count, n))
        for first in range(0, count, _CHUNK):
            part = rows[..., first : first + _CHUNK]
            if part.ndim == 1:
                right = np.zeros((n, len(part)))
                right[part, np.arange(len(part))] = 1.0
            else:
                right = np.ascontiguousarray(part)
            inverse[first : first + _CHUNK] = solve_or_fail(factor, right, name).T
        return {"rows": inverse}

    stored = make() if offline is None else offline.remember(
        "inverse rows", (name, operator, rows, model.linear_solver(name)), make)
    return np.asarray(stored["rows"], dtype=np.float64)
