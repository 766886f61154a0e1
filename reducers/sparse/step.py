"""The sparse projection-free step on one page (Liang et al. 2026, doi 10.3390/math14152728).

Displacements and temperatures of a block are few atoms (columns of a dictionary A) times
coefficients, x = offset + A c with few c_i nonzero (Eq. 8-16, 32-33). Unknowns of a step are these
c, the rigid coordinates and the joint forces; its equations are the residual R of the full-order
model, with the rates at the end of the step as the integrator's formula gives them (Eq. 24):

1. draw a few rows S of each block, of R or of D^-1 R with the operator D = K + c1 C + c2 M; or
   take all rows of D^-1 R, which are exactly as many as atoms in an orthonormal basis of these;
2. precondition them by P, a unit-norm tight frame for example (Eq. 29-31);
3. linearise:  P S R(c + d) = r + B d  with the constant B = P S D A;
4. select the active atoms, min |r + B d| with at most `budget` nonzeros of c + d (Eq. 25);
5. solve  B^+ P S R = 0 of each block on its active atoms, together with all equations of rigid
   coordinates and joint forces, by Newton's method;
6. solve again on the atoms that were selected at the solution.

No equation is projected, and none outside the sample is evaluated. Written for reading, with dense
matrices and the terms of the model as they are (`Term`): the steps of the product do the same with
small constant matrices (`step_solver.py`), and tests compare them with this page.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from sparsemor.core import (
    AssembledModel,
    BoolArray,
    Dictionary,
    FloatArray,
    Preconditioner,
    Sampler,
    SolveFailed,
    SparseSolver,
    Status,
    StepFactors,
    StepFormula,
)
from sparsemor.core.linalg.column_subsets import ColumnSubsets
from sparsemor.core.model.equations import rate_factors, system_jacobian, system_residual
from sparsemor.core.registry.returned_values import prepared_recovery
from sparsemor.reducers.linalg.left_inverse import SAMPLED_RTOL
from sparsemor.reducers.sparse.sampled_block import choose_rows, weigh

ITERATIONS, ROUNDS = 30, 10
Supports = Mapping[str, BoolArray]
"""Block -> its active atoms (k,)."""


class SampledRows:
    """Preconditioned sample of a block: `rows` P S (m, n) of its residual; B = P S D A (m, k) as
    columns of unit length and their lengths (k,); and the sparse solver prepared for them. The
    argument rows: number of sampled rows, None for all of D^-1 R; inverted: True for a sample of
    D^-1 R. Numbers in comments are those of the steps above."""

    def __init__(
        self, model: AssembledModel, name: str, dictionary: Dictionary, step: StepFactors,
        sampler: Sampler, preconditioner: Preconditioner | None, solver: SparseSolver,
        rows: int | None, budget: int, inverted: bool, rng: np.random.Generator,
    ) -> None:
        """The sample S of R or D^-1 R (step 1 of the module), its preconditioner P (2), and B =
        P S D A (3), with the operator D of a step and the atoms A; budget: most active atoms."""
        D = model.block_data(name, step=step).operator.toarray()
        if rows is None:  # 1. all of D^-1 R
            S = np.linalg.qr(dictionary.atoms)[0].T @ np.linalg.inv(D)
        else:
            drawn = choose_rows(
                model, offline=None, name=name, rows=rows, budget=budget, sampler=sampler,
                dictionary=dictionary, rng=rng, step=step, preconditioned=inverted)
            S = np.linalg.inv(D)[drawn] if inverted else np.eye(len(D))[drawn]
        P = None if preconditioner is None else weigh(
            offline=None, preconditioner=preconditioner, name=name,
            B=S @ D @ dictionary.atoms)  # 2.
        self.name, self.rows = name, S if P is None else P @ S
        B = self.rows @ D @ dictionary.atoms  # 3.
        self.lengths = np.linalg.norm(B, axis=0)
        self.unit = ColumnSubsets(B / self.lengths, SAMPLED_RTOL)
        self.recovery = prepared_recovery(solver, self.unit, budget)


class SparseStep:
    """Sparse steps of a model with these dictionaries; thermal, elastic: samples of its blocks.
    hysteresis: fraction by which other atoms must lower the norm of the residual to replace those
    of the step before. All n unknowns of the model are x = offset + E z, E (n, k)."""

    def __init__(
        self, model: AssembledModel, dictionaries: Mapping[str, Dictionary],
        thermal: Sequence[SampledRows], elastic: Sequence[SampledRows], hysteresis: float
    ) -> None:
        """thermal, elastic: samples of the blocks; hysteresis: fraction by which other supports
        must lower the residual norm to replace those of the step before."""
        self.model, self.thermal, self.elastic = model, thermal, elastic
        self.hysteresis = hysteresis
        self.layout = model.layout.resized({n: d.atoms.shape[1] for n, d in dictionaries.items()})
        # unknowns of the model (n,) are offset + E z, with z (k,): coefficients, and all unknowns
        # of the blocks without a dictionary
        n = model.layout.size
        self.E, self.offset = np.zeros((n, self.layout.size)), np.zeros(n)
        for b in model.layout:
            at, d = model.layout[b.name], dictionaries.get(b.name)
            self.E[at, self.layout[b.name]] = np.eye(b.size) if d is None else d.atoms
            self.offset[at] = 0.0 if d is None else d.offset

    def step(
        self, formula: StepFormula, z: FloatArray, supports: Supports
    ) -> tuple[FloatArray, Supports]:
        """Unknowns z (k,) at the end of a step and the supports on which they were computed, from a
        guess z and the supports of the step before (all atoms before the first one)."""
        first = all(active.all() for active in supports.values())
        z = self.solved(formula, z, supports)
        # temperatures load the bodies and are selected first, each block on its own; an exchange in
        # one body changes the joint forces on the next, so that elastic blocks decide together
        for groups in ([[b] for b in self.thermal], [self.elastic]):
            for again in range(ROUNDS if first else 1):
                R, found = self.residual(formula, z)[0], dict[str, BoolArray]()
                for group in groups:
                    found |= self.selected(group, R, z, supports, first and not again)
                if not found:
                    break
                supports = {**supports, **found}
                z = self.solved(formula, z, supports)  # 6.
        return z, supports

    def residual(self, formula: StepFormula, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residual R (n,) of the full-order model at unknowns z (k,), and dR/dz (n, k)."""
        layout, terms, (z, v, a) = self.model.layout, self.model.terms, formula.at(z - formula.free)
        at = self.offset + self.E @ z, self.E @ v, self.E @ a, formula.t
        c1, c2 = rate_factors(layout, formula.c1, formula.c2, formula.c1_first)
        c2[layout.first] = formula.c2_first if formula.before is not None else 0.0
        return (system_residual(layout, terms, *at),
                system_jacobian(layout, terms, *at, c1, c2) @ self.E)

    def solved(self, formula: StepFormula, z: FloatArray, supports: Supports) -> FloatArray:
        """Unknowns with the equations of all rigid coordinates and joint forces, and B^+ P S R = 0
        of each block on its active atoms; other coefficients are zero. Raises SolveFailed."""
        # equations W R = 0 with W (k, n): all rows of the border, B^+ P S of the blocks
        active, W = np.ones(len(z), np.bool_), np.zeros(self.E.T.shape)
        for b in self.layout:
            if b.name not in supports:
                W[self.layout[b.name], self.model.layout[b.name]] = np.eye(b.size)
        for s in (*self.thermal, *self.elastic):
            support, left = supports[s.name], s.unit.left_inverse(supports[s.name])
            if left is None:  # the rows do not distinguish these atoms
                raise SolveFailed(Status.RANK_DEFICIENT, formula.t, s.name)
            active[self.layout[s.name]] = support
            block = W[self.layout[s.name], self.model.layout[s.name]]
            block[support] = (left / s.lengths[support, None]) @ s.rows
        z, last = np.where(active, z, 0.0), np.inf
        for _ in range(ITERATIONS):  # 5.
            R, J = self.residual(formula, z)
            change = np.linalg.solve((W @ J)[np.ix_(active, active)], (W @ R)[active])
            z[active] -= change
            size = float(np.abs(change).max())
            if size < 1e-9 and size >= 0.25 * last:  # what is left is round-off
                return z
            last = size
        raise SolveFailed(Status.NOT_CONVERGED, formula.t)

    def selected(
        self, group: Sequence[SampledRows], R: FloatArray, z: FloatArray, supports: Supports,
        first: bool
    ) -> dict[str, BoolArray]:
        """Supports that replace those of blocks which decide together, with all other unknowns held
        at the solution z, where the residual is R. first: whatever the present ones are."""
        # squared residuals of the group, with the present supports and with the new ones
        found, now, after = dict[str, BoolArray](), 0.0, 0.0
        for s in group:
            r, c = s.rows @ R[self.model.layout[s.name]], s.lengths * z[self.layout[s.name]]
            new = s.recovery.select(r, c, supports[s.name]).support  # 4.
            # after least squares on the new atoms, without the ones that leave; None: dependent
            left = s.unit.squared_residual(new, r - s.unit.A[:, ~new] @ c[~new])
            weight = float(s.lengths.max()) ** -2  # residuals of blocks have different units
            now += weight * float(r @ r)
            after += weight * float(r @ r if left is None else left)
            if left is not None and not np.array_equal(new, supports[s.name]):
                found[s.name] = new
        return found if first or after < (1.0 - self.hysteresis) ** 2 * now else {}
