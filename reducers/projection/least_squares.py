"""Least-squares Petrov-Galerkin reducers: full residual (`lspg`), sampled residual modes (`gnat`).

Carlberg, Bou-Mosleh and Farhat 2011, doi 10.1002/nme.3050; Carlberg, Farhat, Cortial and Amsallem
2013, doi 10.1016/j.jcp.2013.02.028. The least squares run over the elastic or thermal rows of a
block with its constant operator D; the equations of rigid coordinates and multipliers are satisfied
exactly.
"""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from sparsemor.core import Dictionary, FloatArray, InputError, Note, SolveFailed, Status
from sparsemor.core.linalg.dense import svd
from sparsemor.core.model.factorizations import solve_or_fail
from sparsemor.reducers import (
    Interpolating,
    Maps,
    Projection,
    ProjectionReducer,
    Reducible,
    TestMap,
    choose_points,
    force_modes,
    interpolation,
    projection_notes,
)

Norm = Literal["rows", "energy"]

MODE_RTOL = 1e-12
"""Residual modes with singular values below this fraction of the largest are dropped as round-
off."""


class Lspg(ProjectionReducer):
    """LSPG, least-squares Petrov-Galerkin: coefficients minimise the residual of all rows.

    The minimiser depends on the residual only through its projection on the span of D atoms, with
    the constant operator D of a step, so all operators are projected offline as in `galerkin`.
    """

    norm: Norm = "energy"
    """`energy`: norm in D^-1, whose minimiser is the solution of `galerkin`; `rows`: 2-norm of the
    rows, as published. In the latter stiff deformations dominate, and with few atoms errors of
    elastic blocks grow from step to step to ten times those of Galerkin projection."""

    def maps(self, block: Reducible) -> Maps:
        """Test map atoms^T (k, n) for the energy norm; Q^T, where D atoms = Q R, for the rows."""
        if self.norm == "energy":
            return Maps(TestMap(left=block.dictionary.atoms.T), facts={"norm": "D^-1"})
        Q = np.linalg.qr(_operator_images(block))[0]
        return Maps(TestMap(left=Q.T), facts={"norm": "rows"})

    def notes_on(self, projection: Projection) -> Sequence[Note]:
        return projection_notes(projection, least_squares=self.norm == "rows")


class Gnat(Interpolating):
    """GNAT, Gauss-Newton with approximated tensors: gappy least squares of the residual's modes.

    Coefficients minimise |(P U)^+ P r| over the sampled rows P r of a residual with modes U. At
    reduced states a residual is D atoms times the error of the coefficients plus the part of the
    force outside that span: U spans the columns of D atoms and the force modes. There must be at
    least as many points as modes in U; `oversampling` is the number of points per mode.
    """

    norm: Norm = "energy"
    """`energy`: norm in D^-1 of the residual reconstructed from its modes, in which the minimiser
    is close to Galerkin's; where D is not positive definite, and by `rows`, its 2-norm, as
    published (see `lspg`)."""

    def notes_on(self, projection: Projection) -> Sequence[Note]:
        """Notes on the least squares of all rows, which those of the modes approximate."""
        return projection_notes(projection, least_squares=self.norm == "rows")

    def maps(self, block: Reducible) -> Maps:
        """Test map Q^T W (P U)^+ (k, m) at the points for operators and forces, where W (P U)^+ P D
        atoms = Q R.

        D: operator of the step; U: residual modes, P: rows at the points; W: factor of the norm,
        W^T W = U^T D^-1 U, or the identity for the norm of the rows.
        """
        force, B = force_modes(block, self.basis_of_force(block)), _operator_images(block)
        U = residual_modes(B, force.atoms)
        q = U.shape[1]
        modes = Dictionary(U, np.zeros(len(U)), tuple(f"residual {i}" for i in range(q)))
        points = choose_points(block, modes, self.wanted(block, q), self.sampler, self.required)
        reconstruction, facts = interpolation(block.name, U, points)
        notes = self.notes(block, points, U, reconstruction)
        factor = energy_factor(block, U) if self.norm == "energy" else None
        if factor is not None:
            reconstruction = factor @ reconstruction
        elif self.norm == "energy" and "norm" in self.model_fields_set:
            raise InputError(f"{block.name} has no energy norm, its operator is not positive "
                             "definite: take norm: rows", "reducer.norm")
        # Q of W (P U)^+ P D atoms = Q R: least squares of it are Q^T r = 0
        left = np.linalg.qr(reconstruction @ B[points])[0].T @ reconstruction
        return Maps(
            TestMap(rows=points, left=left), force=None, rows=points, facts={
                "norm": "rows" if factor is None else "D^-1",
                "force_modes": force.atoms.shape[1], "residual_modes": q, **facts},
            notes=notes)


def _operator_images(block: Reducible) -> FloatArray:
    """Products of the step's operator D with the atoms (n, k), as unit columns."""
    B = np.asarray(block.linear.operator @ block.dictionary.atoms)
    norms = np.linalg.norm(B, axis=0)
    if not norms.all():
        raise SolveFailed(Status.RANK_DEFICIENT, 0.0, block.name,
                          f"{int((norms == 0).sum())} atoms have no residual")
    return np.asarray(B / norms)


def residual_modes(B: FloatArray, F: FloatArray) -> FloatArray:
    """Orthonormal basis (n, q) of the span of D atoms B (n, k) and force modes F (n, f)."""
    U, s, _ = svd(np.hstack([B, F]))
    return np.asarray(U[:, s > MODE_RTOL * s[0]])


def energy_factor(block: Reducible, U: FloatArray) -> FloatArray | None:
    """Factor W (q, q) of the energy norm, |W z|^2 = (U z)^T D^-1 (U z); None where the constant
    operator D is not positive definite."""
    try:
        factor = block.model.factorize(block.name, block.linear.operator, "norm")
        flexible = U.T @ solve_or_fail(factor, np.ascontiguousarray(U), block.name)
        return np.asarray(np.linalg.cholesky(flexible).T)
    except (SolveFailed, np.linalg.LinAlgError):
        return None
