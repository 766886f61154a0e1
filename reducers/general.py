"""The textbook step: all terms summed, the whole sparse Jacobian factorized in each iteration.

Slow, and right for any terms: the check of the fast path, and the way out for terms that a body
cannot take apart.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from sparsemor.core.arrays import BoolArray, FloatArray, IntArray
from sparsemor.core.equations import jacobian, rate_factors, residual
from sparsemor.core.layout import Layout
from sparsemor.core.model import Model
from sparsemor.core.protocols import Dictionary, State, StepFormula, StepOutcome
from sparsemor.core.status import Status
from sparsemor.reducers.bordered import Tolerances
from sparsemor.reducers.stepper import Facts, Memory


@dataclass(frozen=True, slots=True, eq=False)
class GeneralStepper:
    """StepSolver for a whole model, nothing reduced."""

    model: Model
    tolerances: Tolerances
    points: int
    dictionaries: Mapping[str, Dictionary] = field(default_factory=dict)
    rows: Mapping[str, IntArray] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    facts: Facts = field(default_factory=dict)

    @property
    def layout(self) -> Layout:
        return self.model.layout

    @property
    def elements_touched(self) -> Mapping[str, int]:
        touched = {b: 0 for b in self.model.reducible()}
        for term in self.model.terms:
            for name in touched:
                at = self.layout[name]
                if len(term.rows) and at.start <= term.rows[0] < at.stop:
                    touched[name] += term.elements
        return touched

    def start(self, state: State) -> tuple[State, Memory]:
        return state, Memory(state.x, self.points)

    def solve(self, step: StepFormula, memory: Memory) -> tuple[StepOutcome, Memory]:
        x = memory.ring.predict()
        c1, c2 = rate_factors(self.layout, step.c1, step.c2, step.c1_first)
        terms, last = self.model.terms, np.inf
        scale = _scale(self.layout, x)
        for i in range(1, self.tolerances.max_iterations + 1):
            v, a = c1 * x + step.r1, c2 * x + step.r2
            r = residual(self.layout, terms, x, v, a, step.t)
            if not np.isfinite(r).all():
                return StepOutcome(x, Status.NOT_FINITE, i), memory
            J = csc_array(jacobian(self.layout, terms, x, v, a, step.t, c1, c2))
            try:
                dx = splu(J).solve(r)
            except RuntimeError:
                return StepOutcome(x, Status.SINGULAR, i), memory
            memory.factorizations += 1
            x = x - dx
            scale = np.maximum(scale, _scale(self.layout, x))
            change = float((np.abs(dx) / scale)[: self.layout.algebraic.start].max(initial=0.0))
            if change <= self.tolerances.remaining or (change >= 0.25 * last and change <= 1e-9):
                memory.ring.push(x)
                return StepOutcome(x, Status.DONE, i), memory
            last = change
        return StepOutcome(x, Status.NOT_CONVERGED, self.tolerances.max_iterations), memory

    def supports(self, memory: Memory) -> Mapping[str, BoolArray]:
        return {}

    def counters(self, memory: Memory) -> Mapping[str, int]:
        return {"factorizations": memory.factorizations, "support_changes": 0}


def _scale(layout: Layout, x: FloatArray) -> FloatArray:
    """Largest value of each unknown's block (1 at least for rigid coordinates)."""
    scale = np.ones(layout.size)
    for b in layout:
        top = float(np.abs(x[layout[b.name]]).max())
        scale[layout[b.name]] = max(top, 1.0) if b.field == "rigid" else max(top, 1e-300)
    return scale
