"""Terms with constant matrices: elasticity, heat conduction, and given right-hand sides."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from scipy.sparse import csr_array

from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.protocols import Trial
from sparsemor.core.separable import Amplitude, evaluate_amplitudes
from sparsemor.core.time_functions import Held, derivatives


@dataclass(frozen=True, slots=True, eq=False)
class LinearEquations:
    """r = A x + B v - constant - loads @ amplitudes(t); A, B (m, n), loads (m, j)."""

    A: Any
    B: Any
    constant: FloatArray
    loads: FloatArray
    amplitudes: tuple[Amplitude, ...] = ()

    @property
    def elements(self) -> int:
        return 0

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        r = self.A @ x + self.B @ v - self.constant
        if self.amplitudes:
            r = r - self.loads @ evaluate_amplitudes(self.amplitudes, t)
        return np.asarray(r, dtype=np.float64)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Any:
        return self.A + self.B * c1[None, :]


@dataclass(frozen=True, slots=True, eq=False)
class LinearTerm:
    """Linear equations at global `rows` and `columns`; assembled once, so no element is visited.

    `source`: the part of the scene that it comes from, set in assembly.
    """

    body: str
    rows: IntArray
    columns: IntArray
    equations: LinearEquations
    elements: int = 0
    source: str = ""
    linear: ClassVar[bool] = True

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        return self.equations.residual(x, v, a, t)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Csr:
        return csr_array(self.equations.jacobian(x, v, a, t, c1, c2))

    def time_derivative(self, order: int, t: float, h: float) -> "LinearTerm | None":
        e = self.equations
        if not e.amplitudes:
            return None
        held = tuple(Held(derivatives(f, t, h)[order - 1]) for f in e.amplitudes)
        of_time = LinearEquations(0.0 * e.A, 0.0 * e.B, 0.0 * e.constant, e.loads, held)
        return replace(self, equations=of_time)

    def restrict(self, keep: IntArray) -> "LinearTerm":
        e = self.equations
        kept = LinearEquations(e.A[keep], e.B[keep], e.constant[keep], e.loads[keep], e.amplitudes)
        return replace(self, rows=self.rows[keep], equations=kept)

    def compress(self, trial: Trial, left: FloatArray) -> LinearEquations:
        e, T = self.equations, trial.atoms
        return LinearEquations(
            left @ np.asarray(e.A @ T), left @ np.asarray(e.B @ T),
            left @ (e.constant - e.A @ trial.offset), left @ e.loads, e.amplitudes,
        )
