"""Monolithic solution of a step: all terms summed into one system with one sparse Jacobian.

It applies to any terms. It is used at full order where a term couples bodies, such as contact
between deformable surfaces: constant matrices are assembled once and the factorized Jacobian is
reused while convergence is fast. Factorized in every iteration it is the textbook Newton method,
the reference for the block-wise solution.
"""

from copy import copy
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from sparsemor.core import AssembledModel, Csr, FloatArray, IntArray, Layout, StepFormula, Term
from sparsemor.core.model.equations import rate_factors, system_jacobian, system_residual
from sparsemor.reducers.block_counts import coupling
from sparsemor.reducers.step.jacobian_factors import Factor, superlu
from sparsemor.reducers.step.local_copies import CopyMemory
from sparsemor.reducers.step.monolithic_step import Checked, WholeEquations, checked
from sparsemor.reducers.step.newton_loop import Linearisation


@dataclass(eq=False)
class Summed(WholeEquations):
    """Equations of a model summed over its terms: linear terms as K x + C v + M a + prescribed(t)
    with (n, n) csr matrices, the other terms one by one. price: see `StepEquations`."""

    layout: Layout
    K: Csr
    C: Csr
    M: Csr
    linear: tuple[Term, ...]
    others: tuple[Term, ...]
    named: tuple[tuple[str, frozenset[str]], ...]
    price: int
    checks: tuple[Checked, ...] = ()

    @classmethod
    def from_model(cls, model: AssembledModel, price: int) -> "Summed":
        """The whole model, with the matrices of its linear terms assembled once. price: cost of a
        new Jacobian in iterations with the old one, 0 for a new one in each."""
        layout, n = model.layout, model.layout.size
        linear = tuple(t for t in model.terms if t.linear)
        zero, one = np.zeros(n), np.ones(n)

        def slope(c1: FloatArray, c2: FloatArray) -> Csr:
            """Jacobian of the linear terms for dv = c1 dx and da = c2 dx."""
            if not linear:
                return csc_array((n, n)).tocsr()
            return system_jacobian(layout, linear, zero, zero, zero, 0.0, c1, c2).tocsr()

        K = slope(zero, zero)
        return cls(
            layout, K=K, C=slope(one, zero) - K, M=slope(zero, one) - K, linear=linear,
            others=tuple(t for t in model.terms if not t.linear), named=coupling(model),
            price=price, checks=checked((t, t.columns) for t in model.terms))

    @property
    def terms(self) -> tuple[tuple[Term, IntArray], ...]:
        return tuple((t, t.columns) for t in (*self.linear, *self.others))

    def working(self, memory: CopyMemory | None = None) -> "Summed":
        """These equations in the steps of one run."""
        return copy(self)

    def begin(self, step: StepFormula, d: FloatArray) -> None:
        zero = np.zeros(self.layout.size)
        self.step = step
        self.prescribed = system_residual(self.layout, self.linear, zero, zero, zero, step.t)

    def residual(self, d: FloatArray, slope: bool = False) -> FloatArray:
        x, v, a = self.step.at(d)
        r = system_residual(self.layout, self.others, x, v, a, self.step.t)
        r += self.K @ x + self.C @ v + self.prescribed
        if self.M.nnz:
            r += self.M @ a
        return r

    def slope(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Csr:
        """Jacobian (n, n) at a state, for dv = c1 dx and da = c2 dx; c1, c2 (n,)."""
        J = self.K + self.C * c1[None, :] + self.M * c2[None, :]
        if self.others:
            J = J + system_jacobian(self.layout, self.others, x, v, a, t, c1, c2).tocsr()
        return csc_array(J)

    def jacobian(self, at: Linearisation) -> Csr:
        c1, c2 = rate_factors(self.layout, *at.c[:3])
        c2[self.layout.first] = at.c[3]
        return self.slope(at.x, at.v, at.a, at.t, c1, c2)

    def factorize(self, J: Csr) -> Factor:
        # pivots off the diagonal where it is small
        factor: Factor = splu(J) if self.price == 0 else superlu(J, threshold=0.01)
        return factor
