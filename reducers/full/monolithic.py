"""The whole system at once: all terms summed, one sparse Jacobian.

Right for any terms: the way of full order where a term couples bodies, such as a contact on
deformed surfaces, with constant matrices assembled once and a factor of the Jacobian that is kept
while it serves. Factorized again in each iteration it is the textbook method, the check of the fast
path.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from sparsemor.core import (
    AssembledModel,
    BoolArray,
    Csr,
    Dictionary,
    FloatArray,
    HasConstantMatrices,
    IntArray,
    Layout,
    NamesSource,
    Note,
    ResultantSource,
    State,
    StepFormula,
    StepOutcome,
    Term,
)
from sparsemor.core.model.equations import jacobian, residual
from sparsemor.core.protocols.step_solver import resultant_sources
from sparsemor.reducers.step.acceptance import Tolerances
from sparsemor.reducers.step.newton.iteration import solve
from sparsemor.reducers.step.newton.memory import NewtonMemory
from sparsemor.reducers.step.rejection import Checked, checked, rejected_step
from sparsemor.reducers.step.solver import Facts


@dataclass(frozen=True, slots=True, eq=False)
class Summed:
    """The terms of a model: linear ones as K x + C v + M a + given(t), (n, n) csr; others one by
    one. price: see `newton.Equations`."""

    layout: Layout
    K: Csr
    C: Csr
    M: Csr
    linear: tuple[Term, ...]
    others: tuple[Term, ...]
    named: tuple[tuple[str, frozenset[str]], ...]
    price: int

    @classmethod
    def of(cls, model: AssembledModel, price: int) -> "Summed":
        layout, n = model.layout, model.layout.size
        linear = tuple(t for t in model.terms if constant(t))
        zero, one = np.zeros(n), np.ones(n)

        def slope(c1: FloatArray, c2: FloatArray) -> Csr:
            if not linear:
                return csc_array((n, n)).tocsr()
            return jacobian(layout, linear, zero, zero, zero, 0.0, c1, c2).tocsr()

        K = slope(zero, zero)
        return cls(layout, K, slope(one, zero) - K, slope(zero, one) - K, linear,
                   tuple(t for t in model.terms if not constant(t)),
                   coupling(model), price)

    def with_work(self) -> "Summed":
        """Itself: its terms write to no arrays that are kept."""
        return self

    def given(self, t: float) -> FloatArray:
        zero = np.zeros(self.layout.size)
        return residual(self.layout, self.linear, zero, zero, zero, t)

    def residual(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, given: FloatArray
    ) -> FloatArray:
        r = residual(self.layout, self.others, x, v, a, t)
        r += self.K @ x + self.C @ v + given
        if self.M.nnz:
            r += self.M @ a
        return r

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Any:
        J = self.K + self.C * c1[None, :] + self.M * c2[None, :]
        if self.others:
            J = J + jacobian(self.layout, self.others, x, v, a, t, c1, c2).tocsr()
        return csc_array(J)

    def factorize(self, J: Any) -> Any:
        if self.price == 0:
            return splu(J)
        # the pattern is symmetric: ordered as such, with pivots off the diagonal where it is small,
        # a factor costs a third and a solve a quarter
        return splu(J, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01,
                    options={"SymmetricMode": True})


def coupling(model: AssembledModel) -> tuple[tuple[str, frozenset[str]], ...]:
    """Name in the scene, and blocks, of each term between blocks."""
    found = []
    for term in model.separated.between:
        name = term.source if isinstance(term, NamesSource) else ""
        found.append((name, touched(model.layout, term.rows)))
    return tuple(found)


def constant(term: Term) -> bool:
    """True if a term's matrices are constant."""
    return isinstance(term, HasConstantMatrices) and term.linear


def touched(layout: Layout, rows: IntArray) -> frozenset[str]:
    """Names of the blocks that rows are in."""
    return frozenset(layout.containing(rows))


def elements(
    model: AssembledModel, terms: Sequence[Any], rows: Sequence[IntArray]
) -> dict[str, int]:
    """Reducible block -> elements that one evaluation of the terms visits for its rows."""
    found = {name: 0 for name in model.reducible()}
    for term, at in zip(terms, rows, strict=True):
        for name in touched(model.layout, at) & found.keys():
            found[name] += term.elements
    return found


@dataclass(frozen=True, slots=True, eq=False)
class GeneralStepper:
    """StepSolver for a whole model, nothing reduced."""

    model: AssembledModel
    equations: Summed
    tolerances: Tolerances
    points: int
    dictionaries: Mapping[str, Dictionary] = field(default_factory=dict)
    rows: Mapping[str, IntArray] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()
    facts: Facts = field(default_factory=dict)
    checks: tuple[Checked, ...] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "checks", checked((t, t.columns) for t in self.model.terms))

    @property
    def layout(self) -> Layout:
        return self.model.layout

    @property
    def elements_touched(self) -> Mapping[str, int]:
        terms = self.model.terms
        return elements(self.model, terms, [t.rows for t in terms])

    def start(self, state: State) -> tuple[State, NewtonMemory]:
        return state, NewtonMemory(state.x, self.points, len(self.layout.blocks))

    def solve(self, step: StepFormula, memory: NewtonMemory) -> tuple[StepOutcome, NewtonMemory]:
        outcome = solve(self.equations, step, memory, self.tolerances)
        return rejected_step(outcome, self.checks, step, self.layout), memory

    def resultant_sources(self, memory: NewtonMemory | None) -> tuple[ResultantSource, ...]:
        return resultant_sources((t, t.columns) for t in self.model.terms)

    def supports(self, memory: NewtonMemory) -> Mapping[str, BoolArray]:
        return memory.supports

    def counters(self, memory: NewtonMemory) -> Mapping[str, int]:
        return memory.counters()
