"""Radiation to the surroundings, evaluated facet by facet."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field
from scipy.sparse import csr_array

from sparsemor.bodies.fem.fields import Heat
from sparsemor.bodies.fem.surface import facet_measures
from sparsemor.bodies.loads.amplitude import NumberOrFunction
from sparsemor.bodies.loads.part import LoadPart
from sparsemor.bodies.mesh.plausibility import celsius_notes
from sparsemor.bodies.targets import find_surfaces
from sparsemor.core import (
    Amplitude,
    CompressedLocal,
    Csr,
    Effect,
    Equations,
    FloatArray,
    InputError,
    IntArray,
    Part,
    Plugin,
    Trial,
)

STEFAN_BOLTZMANN = 5.670374419e-8
"""Stefan-Boltzmann constant, W/(m^2 K^4), CODATA 2018 (exact since the SI of 2019)."""
LARGEST = 1e77
"""Temperature (K) above which the fourth power overflows: the step then ends as not finite."""


@dataclass(frozen=True, slots=True, eq=False)
class RadiationTerm:
    """Radiation contribution to the heat residual: integral eps sigma (T^4 - T_inf^4) phi_i over
    facets (exact quadrature).

    rows, columns: global numbers of equations and unknowns; facets (F, d): positions in the list of
    the facets' nodes; weights (F,) = measure x thickness x eps sigma; row_of, column_of: position
    of each listed node in `rows`, `columns` (-1: none); prescribed: pairs (positions in the list,
    T(t)) of nodes with prescribed temperature.
    """

    rows: IntArray
    columns: IntArray
    facets: IntArray
    weights: FloatArray
    row_of: IntArray
    column_of: IntArray
    prescribed: tuple[tuple[IntArray, Amplitude], ...]
    surroundings: Amplitude

    @property
    def elements(self) -> int:
        return len(self.facets)

    def _nodal(self, x: FloatArray, t: float) -> FloatArray:
        T = np.zeros(len(self.column_of))
        free = self.column_of >= 0
        T[free] = x[self.column_of[free]]
        for at, function in self.prescribed:
            T[at] = function(t)
        return T

    def _fourth(self, t: float) -> float:
        """T_inf^4 at time t (s); infinite if it overflows."""
        T = self.surroundings(t)
        return T**4 if abs(T) < LARGEST else np.inf

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        phi, w = RULES[self.facets.shape[1]]
        T = self._nodal(x, t)[self.facets] @ phi  # (F, quadrature points)
        flux = (T**4 - self._fourth(t)) * self.weights[:, None]
        loads = flux @ (phi * w).T
        target = self.row_of[self.facets]
        keep = target >= 0
        return np.bincount(target[keep], loads[keep], minlength=len(self.rows)).astype(np.float64)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Csr:
        d = self.facets.shape[1]
        phi, w = RULES[d]
        T = self._nodal(x, t)[self.facets] @ phi
        slope = 4 * T**3 * self.weights[:, None] * w
        local = np.einsum("fq,iq,jq->fij", slope, phi, phi)
        i = np.repeat(self.row_of[self.facets], d, axis=1).ravel()
        j = np.tile(self.column_of[self.facets], d).ravel()
        keep = (i >= 0) & (j >= 0)
        return csr_array((local.ravel()[keep], (i[keep], j[keep])),
                         shape=(len(self.rows), len(self.columns)))

    def contributions(
        self, left: FloatArray, x: FloatArray, v: FloatArray, t: FloatArray
    ) -> FloatArray:
        """(F, l, M) contribution of each facet, projected by left (l, m), at states x (n, M) and
        times t (M,), s."""
        place = self.row_of[self.facets]
        seen = np.where(place >= 0, left[:, place], 0.0)  # (l, F, d)
        phi, w = RULES[self.facets.shape[1]]
        found = np.zeros((len(self.facets), len(left), len(t)))
        for i, time in enumerate(t):
            T = self._nodal(x[:, i], float(time))[self.facets] @ phi
            flux = (T**4 - self._fourth(float(time))) * self.weights[:, None]
            found[:, :, i] = np.einsum("lfi,fi->fl", seen, flux @ (phi * w).T)
        return found

    def weighted(self, weights: FloatArray) -> "RadiationTerm":
        """Term with nonnegative facet weights (F,) (hyper-reduction); facets of weight 0, and rows
        without a remaining facet, are dropped."""
        kept = np.flatnonzero(weights)
        rows = np.unique(self.row_of[self.facets[kept]])
        some = replace(self, facets=self.facets[kept], weights=(self.weights * weights)[kept])
        return some.restrict(rows[rows >= 0])

    def restrict(self, keep: IntArray) -> "RadiationTerm":
        """Term with the rows `keep` only: facets that contribute to these rows, and their nodes."""
        row_of = np.full(len(self.row_of), -1, dtype=np.int64)
        for new, old in enumerate(keep):
            row_of[self.row_of == old] = new
        touched = (row_of[self.facets] >= 0).any(axis=1)
        nodes = np.unique(self.facets[touched])
        renumber = np.full(len(row_of), -1, dtype=np.int64)
        renumber[nodes] = np.arange(len(nodes))
        columns = np.unique(self.column_of[nodes][self.column_of[nodes] >= 0])
        back = np.searchsorted(columns, self.column_of[nodes])
        return replace(
            self, rows=self.rows[keep], columns=self.columns[columns],
            facets=renumber[self.facets[touched]], weights=self.weights[touched],
            row_of=row_of[nodes],
            column_of=np.where(self.column_of[nodes] >= 0, back, -1),
            prescribed=tuple((renumber[at][renumber[at] >= 0], f) for at, f in self.prescribed),
        )

    def compress(self, trial: Trial, left: FloatArray) -> CompressedLocal:
        return CompressedLocal.of(self, trial, left)


def _line() -> tuple[FloatArray, FloatArray]:
    """Shape functions (2, 3) and weights (3,) of the three Gauss points that integrate T^4 phi
    exactly on a line."""
    x, w = np.polynomial.legendre.leggauss(3)
    return np.stack([1 - x, 1 + x]) / 2, w / 2


def _triangle() -> tuple[FloatArray, FloatArray]:
    """Shape functions (3, 7) and weights (7,) of Radon's rule of degree 5, which integrates T^4 phi
    exactly on a triangle."""
    root = np.sqrt(15.0)
    points, weights = [np.full(3, 1 / 3)], [9 / 40]
    for sign in (-1.0, 1.0):
        near = (6 + sign * root) / 21
        points += [np.where(np.arange(3) == i, 1 - 2 * near, near) for i in range(3)]
        weights += [(155 + sign * root) / 1200] * 3
    return np.stack(points, axis=1), np.array(weights)


RULES = {2: _line(), 3: _triangle()}
"""Quadrature rules by the number of a facet's nodes."""


class Radiation(Plugin):
    """Radiation: heat loss q = eps sigma (T^4 - T_inf^4) from the boundary facets (T in K)."""

    acts_on: ClassVar[Effect] = "temperature"

    on: Annotated[list[str], Field(min_length=1)]
    """Surfaces `body:set`."""
    emissivity: float = Field(gt=0, le=1)
    """Emissivity eps."""
    surroundings: NumberOrFunction
    """Temperature of the surroundings, K, a number or a function of time."""

    def build(self, name: str, parts: Mapping[str, Part]) -> LoadPart:
        surfaces = find_surfaces(parts, self.on, "thermal")
        for body, mesh, _ in surfaces:
            if mesh.order == 2:
                raise InputError(f"radiation is integrated over linear elements, and body "
                                 f"{body.name!r} has quadratic ones: take order: 1 for it", "on")

        def write(equations: Equations) -> None:
            for body, mesh, facets in surfaces:
                assert body.heat is not None
                weights = (STEFAN_BOLTZMANN * self.emissivity * body.thickness
                           * facet_measures(mesh, facets))
                block = f"{body.name}.thermal"
                equations.local([block], _term(
                    facets, weights, body.heat, equations.numbers(block),
                    self.surroundings.value))

        notes = celsius_notes(
            name, self.surroundings.value(0.0), {b.name: b.T0 for b, _, _ in surfaces})
        return LoadPart(name, write, surroundings=self.surroundings.value, notes=notes)


def _term(
    facets: IntArray, weights: FloatArray, heat: Heat, at: IntArray, surroundings: Amplitude
) -> RadiationTerm:
    nodes = np.unique(facets)
    is_free = np.isin(nodes, heat.free)
    place = np.where(is_free, np.cumsum(is_free) - 1, -1)
    unknown = at[np.searchsorted(heat.free, nodes[is_free])]
    prescribed = tuple(
        (np.flatnonzero(np.isin(nodes, at)), f.value) for at, f in heat.prescribed)
    return RadiationTerm(unknown, unknown, np.searchsorted(nodes, facets), weights, place, place,
                         prescribed, surroundings)
