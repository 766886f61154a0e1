"""Methods in a package of their own: a sampler, an integrator, a contact law, a sparse solver and a
reducer, by public names of sparsemor alone."""

from typing import Annotated

import numpy as np
from pydantic import Field

from sparsemor.core import (
    Basis,
    BlockData,
    BoolArray,
    Dictionary,
    FloatArray,
    Group,
    InputError,
    IntArray,
    Integrator,
    NormalLaw,
    Sampler,
    Slot,
    SparseOutcome,
    SparseProblem,
    SparseSolver,
    SparseStart,
    Status,
    UpdateRule,
    UpdateRules,
    slot_default,
)
from sparsemor.reducers import Maps, ProjectionReducer, Reducible, TestMap


class EveryNth(Sampler):
    """Rows at equal distances in the order of the unknowns."""

    start: int = Field(default=0, ge=0)
    """First row, counted among those that are not required."""

    def sample(
        self, block: BlockData, m: int, dictionary: Dictionary, rng: np.random.Generator,
        required: IntArray,
    ) -> IntArray:
        free = np.setdiff1d(np.arange(block.size), required)
        if m > free.size:
            raise InputError(f"{m} rows of {block.name} are wanted, only {free.size} are left")
        picked = (self.start + np.arange(m) * free.size // max(m, 1)) % max(free.size, 1)
        return np.union1d(required, free[picked])


class Trapezoidal(Integrator):
    """Trapezoidal rule, second order without damping: x = x0 + h (v0 + v) / 2, likewise v.

    Rates of algebraic unknowns are zero.
    """

    @property
    def order(self) -> int:
        return 2

    def rules(self, h: float) -> UpdateRules:
        x, v, a = np.eye(3)
        half = 0.5 * h
        return UpdateRules(
            UpdateRule(np.array([half * half, half, 1.0]), np.array([
                x + half * (2.0 * v + half * a), v + half * a, 0.0 * a])),
            UpdateRule(np.array([half, 1.0, 0.0]), np.array([x + half * v, 0.0 * v, 0.0 * a])))


class PowerLaw(NormalLaw):
    """Power law of contact: pressure p = K d^n at penetration d."""

    stiffness: float = Field(default=1e11, gt=0)
    """Modulus K, Pa/m^n."""
    exponent: float = Field(default=1.5, ge=1)
    """Exponent n; 1.5 has the growth of Hertz's contact force."""

    def pressure(
        self, depth: FloatArray, rate: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        K, n = self.stiffness, self.exponent
        return K * depth**n, K * n * depth ** (n - 1.0), 0.0 * rate


class HardThresholding(SparseSolver):
    """Hard thresholding pursuit: gradient step, largest entries of each group, least squares.

    Foucart 2011, doi 10.1137/100806278; a nonlinear residual is linearised in every iteration.
    With correlated columns the supports can come back in a circle: the one of the smallest residual
    is kept then, and Gauss-Newton goes on with it.
    """

    iterations: int = Field(default=100, ge=1)
    """Iterations before the search is given up."""
    tolerance: float = Field(default=1e-10, gt=0)
    """Last change of the coefficients, relative to their size."""

    @np.errstate(over="ignore", invalid="ignore")  # ends in the status not_finite
    def solve(self, problem: SparseProblem, start: SparseStart) -> SparseOutcome:
        groups, c = problem.groups, start.c
        active = _largest(groups, np.where(start.support, np.abs(c), 0.0))
        c = np.where(active, c, 0.0)
        tried: dict[bytes, float] = {}
        best, circle = active, False
        for count in range(1, self.iterations + 1):
            r, J = problem.residual(c), problem.jacobian(c)
            if not (np.isfinite(r).all() and np.isfinite(J).all()):
                return _ended(c, active, Status.NOT_FINITE, count, r)
            lengths = np.linalg.norm(J, axis=0)
            A = J / np.where(lengths > 0.0, lengths, 1.0)
            if count > 1 and not circle:
                left = float(np.linalg.norm(r))
                if left <= min(tried.values(), default=left):
                    best = active
                last = active.tobytes()
                tried[last] = left
                active = _largest(groups, np.abs(lengths * c - A.T @ r))
                circle = active.tobytes() in tried and active.tobytes() != last
                active = best if circle else active
            z, rank = np.zeros(c.size), 0
            z[active], _, rank, _ = np.linalg.lstsq(A[:, active], J @ c - r, rcond=1e-10)
            if rank < active.sum():
                return _ended(c, active, Status.RANK_DEFICIENT, count, r)
            old, c = lengths * c, z / np.where(lengths > 0.0, lengths, 1.0)
            if count > 1 and np.linalg.norm(z - old) <= self.tolerance * np.linalg.norm(z):
                return _ended(c, active, Status.DONE, count, problem.residual(c))
        return _ended(c, active, Status.NOT_CONVERGED, self.iterations, problem.residual(c))


def _largest(groups: tuple[Group, ...], sizes: FloatArray) -> BoolArray:
    """(k,) the `budget` largest entries of each group above zero; groups without one as a whole."""
    active = np.zeros(sizes.size, dtype=np.bool_)
    for g in groups:
        part = sizes[g.start : g.stop]
        kept = np.argsort(-part, kind="stable")[: g.budget]
        active[g.start + kept[(part[kept] > 0.0) | (g.budget is None)]] = True
    return active


def _ended(
    c: FloatArray, active: BoolArray, status: Status, count: int, r: FloatArray
) -> SparseOutcome:
    return SparseOutcome(c, active, status, count, float(np.linalg.norm(r)))


class Oblique(ProjectionReducer):
    """Oblique (Petrov-Galerkin) projection onto the trial basis along a test basis of its own."""

    test: Annotated[Basis, Slot("basis")] = slot_default("pod")
    """Test basis of every block, with at least as many columns as the trial basis."""

    def maps(self, block: Reducible) -> Maps:
        test, _ = block.offline.dictionary(block.name, self.test)
        k, most = test.atoms.shape[1], block.dictionary.atoms.shape[1]
        if k < most:
            raise InputError(f"{k} test functions of {block.name} for {most} trial ones", "test")
        return Maps(TestMap(left=test.atoms.T), facts={"test_functions": k})
