"""Projected term of the weak form, evaluated at quadrature points.

With reduced unknowns c, the variables of the law at all points are z = P c + o(t), and rates z' =
P c' + o'(t). The projected residual and its Jacobian are

    r = L y(z, t),      J = (L dy/dz) P,

so that a step costs points x atoms. P (points, k), o and L (l, points) are constant but for
prescribed temperatures, which add columns times functions of time to o. The *kind* of a variable
that the law reads is 0 for a value, 1 for its rate, 2 for its second difference over a step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sparsemor.bodies.fem.pointwise_law import PointwiseLaw, Response, Variable
from sparsemor.core import FloatArray, ReducedTerm, TimeFunction
from sparsemor.core.protocols.step_amplitude import present_step
from sparsemor.core.protocols.term import PointArrays


@dataclass(frozen=True, slots=True)
class Bend:
    """Second difference of a function of time over a step of h, s (`StepFormula`):
    2 (f(t - h) - f(t) + h f'(t))/h^2."""

    function: TimeFunction
    h: float

    def __call__(self, t: float) -> float:
        f, h = self.function, self.h
        return 2.0 * (f.value(t - h) - f.value(t) + h * f.rate(t)) / h**2 if h > 0.0 else 0.0


def prescribed(function: TimeFunction, kind: int, t: float) -> float:
    """Value (kind 0), rate (1) or second difference over the present step (2) of a prescribed
    temperature."""
    if kind == 2:
        return Bend(function, present_step().h)(t)
    return function.rate(t) if kind else function.value(t)


class ProjectedVariable(NamedTuple):
    """A variable on the trial basis: P (E, R, k), offset (E, R) with R = Q points, or 1 where it is
    constant in each element; parts: effect (E, R) of each prescribed function of time."""

    P: FloatArray
    offset: FloatArray
    parts: Sequence[tuple[FloatArray, TimeFunction]]


@dataclass(frozen=True, slots=True, eq=False)
class PointTerm(ReducedTerm):
    """Projected weak term: residual L y(P c + o) of l rows in k reduced unknowns.

    law: pointwise law; weights (E, Q) of the points; coordinates (d, E, Q), m. P (p, k), offset
    (p,): the variables one after the other, those of `spans` (range in P, points per element).
    parts: (column (p,), function) of prescribed temperatures. reads: index in `spans` of each
    variable that the law reads, and its kind. tests: L (l, E Q) for each y, with the
    weights, or (l, E) where the test function's derivative is constant in each element.
    """

    law: PointwiseLaw
    weights: FloatArray
    coordinates: FloatArray
    P: FloatArray
    offset: FloatArray
    parts: tuple[tuple[FloatArray, TimeFunction], ...]
    spans: tuple[tuple[slice, int], ...]
    reads: tuple[tuple[int, int], ...]
    tests: tuple[FloatArray, ...]
    kinds: frozenset[int]
    source: str = ""

    @classmethod
    def from_law(
        cls, law: PointwiseLaw, weights: FloatArray, coordinates: FloatArray,
        variables: Sequence[Variable], projections: Sequence[ProjectedVariable],
        tests: Sequence[FloatArray], source: str,
    ) -> PointTerm:
        """Term from each variable on the trial basis and each test function under the left
        projection, (l, E, Q or 1); variables: those of `projections`, values without their rates.

        Of a variable P (E, R, k) and offset (E, R), R = Q points, or 1 where it is constant in each
        element; all are put below each other, and `spans` has the range of rows and R of each. One
        column for each prescribed function of time, with its effect on all variables.
        """
        k = projections[0].P.shape[2]
        spans, first = [], 0
        for one in projections:
            spans.append((slice(first, first + one.offset.size), one.offset.shape[1]))
            first += one.offset.size
        columns: list[tuple[FloatArray, TimeFunction]] = []
        for (at, _), one in zip(spans, projections, strict=True):
            for effect, function in one.parts:
                column = next((c for c, f in columns if f is function), None)
                if column is None:
                    column = np.zeros(first)
                    columns.append((column, function))
                column[at] += effect.ravel()
        at_variable = {v: i for i, v in enumerate(variables)}
        reads = tuple((at_variable[v.of_values], v.kind) for v in law.reads)
        Q = weights.shape[1]
        flat = tuple(np.ascontiguousarray(  # sizes by number: without atoms there is no row
            (L * weights if L.shape[2] == Q else L).reshape(len(L), L.shape[1] * L.shape[2]))
            for L in tests)
        return cls(
            law, weights, coordinates,
            P=np.concatenate([one.P.reshape(one.offset.size, k) for one in projections]),
            offset=np.concatenate([one.offset.ravel() for one in projections]),
            parts=tuple(columns), spans=tuple(spans), reads=reads, tests=flat,
            kinds=frozenset(kind for _, kind in reads), source=source)

    @property
    def elements(self) -> int:
        return len(self.weights)

    def arrays(self) -> PointArrays | None:
        """The term as arrays for compiled steps, None where its law has none. parts: (column,
        function) of prescribed temperatures; reads: of each variable of the law its first row in P,
        number of values per element, and kind (0 value, 1 rate, 2 second difference)."""
        law = self.law.arrays()
        if law is None:
            return None
        columns, functions = [c for c, _ in self.parts], [f for _, f in self.parts]
        return PointArrays(
            law=law, weights=self.weights,
            coordinates=self.coordinates.reshape(len(self.coordinates), -1),
            P=self.P, offset=self.offset,
            effects=np.array(columns).reshape(len(columns), len(self.P)).T,
            values=tuple(f.value for f in functions), rates=tuple(f.rate for f in functions),
            bends=tuple(Bend(f, law.step) for f in functions),
            reads=np.array([(self.spans[i][0].start, self.spans[i][1], kind)
                            for i, kind in self.reads], dtype=np.int64),
            tests=self.tests)

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        return self._rows(self._response(x, v, a, t))

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> FloatArray:
        return self._slopes(self._response(x, v, a, t), c1)

    def linearized(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Residual and Jacobian with one evaluation of the law."""
        response = self._response(x, v, a, t)
        return self._rows(response), self._slopes(response, c1)

    def _response(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> Response:
        """The law at all points, for reduced unknowns x, v, a (k,). kind 0, 1, 2: unknowns, their
        rates and second rates (of temperatures: second differences over the step), z = P times
        these plus, for values, the offset, plus columns of `parts` times prescribed functions of
        time. reads: of each variable of the law its index in `spans` (rows of P, values per
        element) and kind."""
        by_kind = {}
        for kind, unknowns in enumerate((x, v, a)):
            if kind in self.kinds:
                z = self.P.dot(unknowns)
                if kind == 0:
                    z += self.offset
                for column, f in self.parts:
                    z += prescribed(f, kind, t) * column
                by_kind[kind] = z
        values = []  # each variable as (E, Q), or (E, 1) where it is constant in each element
        for i, kind in self.reads:
            at, width = self.spans[i]
            values.append(by_kind[kind][at].reshape(-1, width))
        return self.law(values, self.coordinates, t)

    def _rows(self, response: Response) -> FloatArray:
        """L y (l,)."""
        E, Q = self.weights.shape
        found = np.zeros(len(self.tests[0]))
        for L, y in zip(self.tests, response.y, strict=True):
            if L.shape[1] == E * Q:
                found += L.dot(_full(y, E, Q).ravel())
            else:
                found += L.dot((y * self.weights).sum(axis=1))
        return found

    def _slopes(self, response: Response, c1: FloatArray) -> FloatArray:
        """(L dy/dz) P (l, k), rates by c1 (k,): dv = c1 dx. tests: L of each y, (l, E Q) with the
        weights, or (l, E) without; reads: of each variable of the law its index in `spans` (rows of
        P, values per element: Q or 1) and kind, 1 for a rate. Laws have no derivatives by second
        differences."""
        E, Q = self.weights.shape
        rows = len(self.tests[0])
        # L dy/dz of the variables at all points, then of their rates
        sums: list[FloatArray | None] = [None, None]
        begun = set()
        for (i, j), derivative in response.derivatives.items():
            L, (variable, kind) = self.tests[i], self.reads[j]
            rate = kind == 1
            at, width = self.spans[variable]
            D = np.asarray(derivative)
            # L and the variable each have a value per point, or one per element (sum over points)
            if L.shape[1] == E * Q and width == Q:
                part = L * _full(D, E, Q).ravel()
            elif L.shape[1] == E * Q:
                part = (L.reshape(rows, E, Q) * _full(D, E, Q)).sum(axis=2)
            elif width == 1:
                part = L * (D * self.weights).sum(axis=1)
            else:
                part = (L[:, :, None] * (D * self.weights)).reshape(rows, E * Q)
            by_z = sums[rate]
            if by_z is None:
                by_z = sums[rate] = np.zeros((rows, len(self.P)))
            if (variable, rate) in begun:
                by_z[:, at] += part
            else:
                by_z[:, at] = part
                begun.add((variable, rate))
        by_value, by_rate = sums
        if by_value is not None and by_rate is not None and (c1 == c1[0]).all():
            by_value += c1[0] * by_rate  # one product with P instead of two
            by_rate = None
        J = np.zeros((rows, self.P.shape[1])) if by_value is None else by_value.dot(self.P)
        return J if by_rate is None else np.asarray(J + by_rate.dot(self.P) * c1)


def _full(y: FloatArray, E: int, Q: int) -> FloatArray:
    """y as an array (E, Q)."""
    return y if y.shape == (E, Q) else np.broadcast_to(y, (E, Q))
