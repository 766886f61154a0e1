"""Term of the weak form with a pointwise law over cells or boundary facets.

    r_a = sum over elements and points of  w  y_i(z, x, t)  D_i phi_a

The law is evaluated at the quadrature points of each element (fem/pointwise_law.py). Restriction to
rows, element weights and projection are the same for all laws, dimensions and finite elements.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from math import prod
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from sparsemor.bodies.fem.pointwise_law import PointwiseLaw, Response, Variable
from sparsemor.bodies.fem.quadrature import ShapeFunctions
from sparsemor.bodies.terms.point_term import PointTerm, ProjectedVariable, prescribed
from sparsemor.bodies.terms.polynomial_term import polynomial_of
from sparsemor.core import (
    Csr,
    FloatArray,
    IntArray,
    Quantity,
    ReducedTerm,
    Term,
    TimeFunction,
    Trial,
)


@dataclass(frozen=True, slots=True, eq=False)
class NodalField:
    """A field at the nodes of the elements of a term.

    column_of (N, m): column of the term for each of m components at each node, -1 where the
    component is no unknown. constant (N, m): its value there, K or m. prescribed: temperatures that
    are sums of shape * f(t), instead of it: nodes, f, shape (values at these nodes). shape: shape
    functions and node numbers of the elements.
    """

    shape: ShapeFunctions
    column_of: IntArray
    constant: FloatArray
    prescribed: tuple[tuple[IntArray, TimeFunction, FloatArray], ...] = ()

    def nodal(self, x: FloatArray, t: float | None) -> FloatArray:
        """Nodal values (N, m) for unknowns x (n,) at the columns (`column_of`, -1: none), at t, s;
        t None: without constants and prescribed values. prescribed: (nodes, function f of time,
        values) of which the temperature at a node is the sum; a node may be in several."""
        free = self.column_of >= 0
        found = self.constant.copy() if t is not None else np.zeros(self.column_of.shape)
        found[free] = x[self.column_of[free]]
        if t is not None:
            for at, _, _ in self.prescribed:
                found[at, 0] = 0.0
            for at, f, shape in self.prescribed:
                found[at, 0] += shape * f.value(t)
        return found

    def rates(self, v: FloatArray, t: float, kind: int = 1) -> FloatArray:
        """Rates (N, m) of the nodal values for rates v (n,) at the columns; kind 2: second
        differences."""
        found = self.nodal(v, None)
        for at, f, shape in self.prescribed:
            found[at, 0] += shape * prescribed(f, kind, t)
        return found

    def part(self, elements: IntArray) -> tuple[NodalField, IntArray]:
        """The field at the nodes of some elements, and the numbers of these nodes."""
        shape = self.shape.part(elements)
        used = np.unique(shape.nodes)
        place = np.full(len(self.column_of), -1, np.int64)
        place[used] = np.arange(len(used))
        prescribed = tuple((place[at][place[at] >= 0], f, w[place[at] >= 0])
                           for at, f, w in self.prescribed)
        return NodalField(shape.renumbered(used), self.column_of[used], self.constant[used],
                          tuple(p for p in prescribed if len(p[0]))), used


@dataclass(frozen=True, slots=True, eq=False)
class WeakTerm(Term):
    """Residual of a pointwise law over E elements with Q quadrature points each.

    rows (m,), columns (n,): positions in the state vector. fields: field of each quantity; row_of
    (N, components): position in `rows` of each component at each node of the field that the law
    tests, -1 for none. weights (E, Q): quadrature weights, times the thickness of a planar body;
    coordinates (d, E, Q), m.
    """

    rows: IntArray
    columns: IntArray
    law: PointwiseLaw
    fields: Mapping[Quantity, NodalField]
    row_of: IntArray
    weights: FloatArray
    coordinates: FloatArray
    source: str = ""

    @property
    def elements(self) -> int:
        return len(self.weights)

    @property
    def weighs_elements(self) -> bool:
        return True

    @property
    def point_values(self) -> int:
        """Numbers per atom that the projection holds: variables and test functions at points."""
        variables = {v.of_values for v in self.law.reads}
        widths = [self.fields[v.quantity].shape.along(v.axis).shape[2]
                  for v in (*variables, *self.law.tests)]
        return self.elements * int(sum(widths))

    @property
    def test_field(self) -> NodalField:
        """Field whose test functions multiply the law."""
        return self.fields[self.law.tests[0].quantity]

    # ------------------------------------------------------------------ evaluation

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        loads, at = self._loads(x, v, a, t), self.row_of[self.test_field.shape.nodes]
        kept = at >= 0
        return np.bincount(at[kept], loads[kept], minlength=len(self.rows)).astype(np.float64)

    def _response(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> Response:
        """Response of the law at all quadrature points, from the fields that it reads there: values
        (kind 0), rates (1) and second differences (2, in a); unknowns at the columns (n,)."""
        nodal: dict[tuple[Quantity, int], FloatArray] = {}
        z = []
        for variable in self.law.reads:
            kind = variable.kind
            field, key = self.fields[variable.quantity], (variable.quantity, kind)
            if key not in nodal:
                nodal[key] = field.nodal(x, t) if kind == 0 else (
                    field.rates(v if kind == 1 else a, t, kind))
            z.append(interpolated(field.shape, nodal[key][:, variable.component], variable.axis))
        return self.law(z, self.coordinates, t)

    def _loads(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        """(E, n, components) contribution of each element to its nodes."""
        shape = self.test_field.shape
        loads = np.zeros((*shape.nodes.shape, self.row_of.shape[1]))
        response = self._response(x, v, a, t)
        for test, y in zip(self.law.tests, response.y, strict=True):
            loads[:, :, test.component] += element_loads(shape, y, self.weights, test.axis)
        return loads

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Csr:
        """Sparse Jacobian (m, n) from the element matrices of each pair of test function and
        variable; c1 (n,): derivatives of the rates by the unknowns. row_of, column_of: row and
        column of each component at each node, -1 for none. Laws have no derivatives by second
        differences."""
        data, i, j = [np.zeros(0)], [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        for test, variable, local in self._local_matrices(self._response(x, v, a, t)):
            field = self.fields[variable.quantity]
            rows = self.row_of[self.test_field.shape.nodes, test][:, :, None]
            columns = field.column_of[field.shape.nodes, variable.component][:, None, :]
            kept = (rows >= 0) & (columns >= 0)
            to = np.broadcast_to(columns, kept.shape)[kept]
            values = local[kept]
            data.append(values * c1[to] if variable.rate else values)
            i.append(np.broadcast_to(rows, kept.shape)[kept])
            j.append(to)
        return csr_array((np.concatenate(data), (np.concatenate(i), np.concatenate(j))),
                         shape=(len(self.rows), len(self.columns)))

    def _local_matrices(self, response: Response) -> Iterator[tuple[int, Variable, FloatArray]]:
        """Component of the test functions, variable, and element matrices (E, n, n') of each pair
        for which some derivative dy_i/dz_j is not zero: sums over the points of weight times test
        function (`along`: or its derivative along an axis) dy_i/dz_j times shape function."""
        tests, reads, found = self.law.tests, self.law.reads, dict[tuple[int, Variable], Any]()
        for (i, j), derivative in response.derivatives.items():
            rows = self.test_field.shape.along(tests[i].axis)
            columns = self.fields[reads[j].quantity].shape.along(reads[j].axis)
            factors = np.broadcast_to(derivative, self.weights.shape) * self.weights
            if rows.shape[2] == columns.shape[2] == 1:  # both constant in each element
                local = factors.sum(axis=1)[:, None, None] * rows * columns.transpose(0, 2, 1)
            else:
                local = (rows * factors[:, None]) @ np.broadcast_to(
                    columns, (*columns.shape[:2], factors.shape[1])).transpose(0, 2, 1)
            # derivatives of one variable along all axes are in the same rows and columns
            key = tests[i].component, replace(reads[j], axis=None)
            found[key] = local if key not in found else found[key] + local
        return ((test, variable, local) for (test, variable), local in found.items())

    # ------------------------------------------------------------------ reduction

    def restrict(self, keep: IntArray) -> WeakTerm:
        """Term with the rows `keep` only: the elements that contribute to them."""
        new = np.full(len(self.rows) + 1, -1, np.int64)
        new[keep] = np.arange(len(keep))
        new[-1] = -1
        row_of = new[self.row_of]
        used = np.unique([test.component for test in self.law.tests])
        acts = row_of[:, used][self.test_field.shape.nodes] >= 0
        return self._part(np.flatnonzero(acts.any(axis=(1, 2))), self.rows[keep], row_of)

    def _part(self, elements: IntArray, rows: IntArray, row_of: IntArray) -> WeakTerm:
        """Term of some elements (numbers), with the columns that these read. rows: positions in the
        state vector of the new term's rows; row_of: numbers in them of all nodes and components, -1
        for none."""
        fields, read = {}, {v.quantity for v in self.law.reads}
        used = [np.zeros(0, np.int64)]
        for quantity, field in self.fields.items():
            fields[quantity], nodes = field.part(elements)
            if field is self.test_field:
                row_of = row_of[nodes]
            if quantity in read:
                at = fields[quantity].column_of
                used.append(at[at >= 0])
        columns = np.unique(np.concatenate(used))
        # new number of each column, -1 for those that are left out and at [-1]: no unknown
        back = np.full(len(self.columns) + 1, -1, np.int64)
        back[columns] = np.arange(len(columns))
        back[-1] = -1
        return replace(
            self, rows=rows, columns=self.columns[columns], row_of=row_of,
            fields={q: replace(f, column_of=back[f.column_of]) for q, f in fields.items()},
            weights=self.weights[elements], coordinates=self.coordinates[:, elements])

    def weighted(self, weights: FloatArray) -> WeakTerm:
        """Term with element weights (E,) >= 0, as in ECSW; elements of weight 0, and rows without a
        remaining element, are dropped."""
        some = replace(self, weights=self.weights * weights[:, None])
        some = some._part(np.flatnonzero(weights), self.rows, self.row_of)
        rows = np.unique(some.row_of[some.test_field.shape.nodes])
        return some.restrict(rows[rows >= 0])

    def contributions(
        self, left: FloatArray, x: FloatArray, v: FloatArray, t: FloatArray,
        elements: IntArray | None = None,
    ) -> FloatArray:
        """(F, l, M) contribution of each element, or of those with the given numbers, to the
        residual, projected by left (l, m), at states x and rates v (n, M) and times t (M,), s; for
        hyper-reduction by element weights. row_of: row of each component at each node, -1: none."""
        part = self if elements is None else self._part(elements, self.rows, self.row_of)
        part_columns = np.searchsorted(self.columns, part.columns)
        part_rows = part.row_of[part.test_field.shape.nodes]
        weights = np.where(part_rows >= 0, left[:, part_rows], 0.0)
        weights = weights.reshape(*weights.shape[:2], prod(weights.shape[2:]))
        contributed = np.zeros((len(part_rows), len(left), len(t)))
        # axes l: row of `left`, f: element, i: node and component; second rates are zero
        for i, time in enumerate(t.tolist()):
            rates = v[part_columns, i]
            loads = part._loads(x[part_columns, i], rates, 0.0 * rates, time)
            contributed[:, :, i] = np.einsum(
                "lfi,fi->fl", weights, loads.reshape(len(part_rows), weights.shape[2]))
        return contributed

    def compress(self, trial: Trial, left: FloatArray) -> ReducedTerm:
        """Term projected on a trial basis, evaluated at the quadrature points unless the law has a
        cheaper form."""
        used = np.flatnonzero(np.any(left != 0, axis=0))
        restricted = self.restrict(used)
        numbers = np.searchsorted(self.columns, restricted.columns)
        points = restricted._projected(
            Trial(trial.atoms[numbers], trial.offset[numbers]), left[:, used])
        stress = self.law.green_lagrange
        return points if stress is None else polynomial_of(points, stress)

    def _projected(self, trial: Trial, left: FloatArray) -> PointTerm:
        """This term at its quadrature points as a function of the coefficients of a trial basis,
        projected by left (l, m): each variable that the law reads as P c + offset + parts (values
        of prescribed temperatures times functions of time), each test function under `left`."""
        # last row of atoms, last column of `left`: zeros, for nodes without an unknown (-1)
        padded = np.concatenate([trial.atoms, np.zeros((1, trial.atoms.shape[1]))])
        reads, projections = [], []
        for variable in dict.fromkeys(v.of_values for v in self.law.reads):
            field = self.fields[variable.quantity]
            axis, nodes = variable.axis, field.shape.nodes
            columns = field.column_of[:, variable.component]
            offset = np.concatenate([trial.offset, [0.0]])[columns]
            offset = np.where(columns >= 0, offset, field.constant[:, variable.component])
            parts = []
            for prescribed_nodes, function, values in field.prescribed:
                offset[prescribed_nodes] = 0.0
                nodal_values = np.zeros(len(columns))
                nodal_values[prescribed_nodes] = values
                parts.append((interpolated(field.shape, nodal_values, axis), function))
            P = np.einsum("enk,enq->eqk", padded[columns[nodes]],
                          np.broadcast_to(field.shape.along(axis), (
                              *nodes.shape, field.shape.along(axis).shape[2])), optimize=True)
            reads.append(variable)
            projections.append(ProjectedVariable(P, interpolated(field.shape, offset, axis), parts))
        shape = self.test_field.shape
        left_padded = np.concatenate([left, np.zeros((len(left), 1))], axis=1)
        tests = []
        for test in self.law.tests:
            at_nodes = left_padded[:, self.row_of[shape.nodes, test.component]]  # (l, E, n)
            functions = shape.along(test.axis)
            L = np.einsum("len,enq->leq", at_nodes, np.broadcast_to(
                functions, (*shape.nodes.shape, functions.shape[2])), optimize=True)
            tests.append(L)
        return PointTerm.from_law(
            self.law, self.weights, self.coordinates, reads, projections, tests, self.source)


def interpolated(shape: ShapeFunctions, nodal: FloatArray, axis: int | None) -> FloatArray:
    """Values (E, Q), or derivatives along an axis (E, Q or 1), of a nodal field (N,)."""
    functions, u = shape.along(axis), nodal[shape.nodes]
    if len(functions) == 1 and len(u) != 1:
        return np.asarray(u @ functions[0])
    return np.asarray((u[:, None, :] @ functions)[:, 0])


def element_loads(
    shape: ShapeFunctions, y: FloatArray, weights: FloatArray, axis: int | None
) -> FloatArray:
    """(E, n) sums over the points of weights (E, Q) y times each test function or derivative."""
    functions, flux = shape.along(axis), y * weights
    if functions.shape[2] == 1:
        return np.asarray(functions[:, :, 0] * flux.sum(axis=1)[:, None])
    if len(functions) == 1:
        return np.asarray(flux @ functions[0].T)
    return np.asarray((functions @ flux[:, :, None])[:, :, 0])
