"""Sampled elastic residual of one body with atom selection, at the solution of a step."""

import numpy as np

from sparsemor.core import FloatArray, StepFormula, evaluate_amplitudes, total_load
from sparsemor.reducers.sparse.sampled_block import SampledElastic
from sparsemor.reducers.step.condensed_newton import Mechanics
from sparsemor.reducers.step.iteration_state import Workspace


class SampledBody:
    """Sampled elastic rows of one body as one product with a vector u of all its inputs.

    u = [G c and G r1 combined, r1, temperatures, amplitudes of loads, 1, sigma, c], with the
    matrices G of the frame's rotation and the factors sigma of the frame directions. near (first,
    j): matrix of the compressed rows in which B or the frame directions are nonzero, divided by the
    largest column norm of B; far: matrix of the other rows, on which sigma and c have no effect. u
    and its views are overwritten in each evaluation.
    """

    def __init__(self, number: int, s: SampledElastic) -> None:
        T, B = s.few
        size = float(np.linalg.norm(B, axis=0).max())
        self.number, self.first, self.amplitudes = number, s.first, T.amplitudes
        self.name, self.budget, self.k = s.block.name, s.block.budget, B.shape[1]
        self.tables = tuple(t.over(size) for t in T.tables)
        self.still = not len(T.generators)
        matrices, damped = [T.mass] if self.still else T.generators, bool(T.damping.any())
        g = len(matrices)
        parts = [*matrices, *([T.damping] if damped else []), -T.coupling, -T.loads,
                 T.constant[:, None], T.directions, B]
        rows = np.hstack(parts) / size
        self.near, self.problem_rows = np.ascontiguousarray(rows[: s.first]), len(rows)
        self.far = np.ascontiguousarray(rows[s.first :, : -T.directions.shape[1] - self.k])
        self.B, self.P, self.F = B[: s.first] / size, T.directions[: s.first] / size, T.functional
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
        self, step: StepFormula, x: FloatArray, mechanics: Mechanics, work: Workspace
    ) -> FloatArray:
        """Residual (first,) of the `near` rows at the solution x of the step that `mechanics` has
        just solved with the working arrays `work`."""
        i, u, loop = self.number, self.u, work.loop
        b, w = mechanics.bodies[i], work.frames[i]
        assert loop is not None
        pair, G = self.pair, self.combined
        pair[0], pair[1] = x[b.elastic], step.r1[b.elastic]
        if self.still:
            G[0] = 0.0
        else:
            factors = w.coefficients[:-1].reshape(2, -1).copy()
            factors[0] += step.c1 * factors[1]
            np.dot(factors.T, pair, out=G)
        G[0] += step.r2[b.elastic]
        if self.damping is not None:
            u[self.damping] = pair[1]
        if self.amplitudes:
            u[self.known] = evaluate_amplitudes(self.amplitudes, step.t)
        u[self.temperature] = x[b.thermal]
        # without a border its factors are those of the frame's own motion
        u[self.sigma] = loop.sigma[i] if mechanics.size else w.sigma[-1]
        u[self.c] = pair[0]
        near: FloatArray = self.near.dot(u)
        if self.tables:
            near = near - total_load(self.tables, step.t)[: self.first]
        return near

    def rest(self, t: float) -> FloatArray:
        """Residual of the `far` rows, after `residual` in a step to t, s."""
        far: FloatArray = self.far.dot(self.past)
        return far - total_load(self.tables, t)[self.first :] if self.tables else far

    def turning(self, work: Workspace, c1: float) -> tuple[FloatArray, FloatArray]:
        """Frame-rotation terms sum_g kappa_g M_g, which B neglects: matrices (first, k) of the
        `near` rows and of the `far` rows."""
        g = len(self.combined)
        kappa, mu = work.frames[self.number].coefficients[: 2 * g].reshape(2, g) if (
            not self.still) else np.zeros((2, g))
        kappa = kappa + c1 * mu
        factors = 0.0 * kappa if self.still else kappa
        near, far = (np.tensordot(
            A[:, : self.combined.size].reshape(len(A), *self.combined.shape), factors, (1, 0))
            for A in (self.near, self.far))
        return near, far
