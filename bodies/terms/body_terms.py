"""Contributions of a body's fields to the equations: elasticity, conduction, convection, inertia of
displacements, and loads that move over its surface as time tables."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import csr_array, diags_array, kron

from sparsemor.bodies.fem.field_matrices import Elasticity, HasFields, Heat, numbered
from sparsemor.bodies.fem.integrals import on_cells, on_facets
from sparsemor.bodies.fem.pointwise_law import PointwiseLaw, StressLaw
from sparsemor.bodies.fem.quadrature import Quadrature
from sparsemor.bodies.terms.geometric_stiffness import thermal_stiffness
from sparsemor.bodies.terms.modal_damping import ModalDamping
from sparsemor.bodies.terms.weak_term import NodalField, WeakTerm
from sparsemor.core import (
    Amplitude,
    Csr,
    Equations,
    FloatArray,
    IntArray,
    Quantity,
    SurfaceLoads,
    Table,
)
from sparsemor.core.protocols.load_tables import LoadTable


def write_elasticity(body: HasFields, equations: Equations, e: Elasticity) -> None:
    """Adds stiffness, damping and thermal forces of the free displacements: K u + D u' - K_fT (T -
    T_ref), with constant temperatures T0 for a body without the field (equations.md, section 1).

    e.free: numbers of the free displacements; e.coupling (d N, N) = K_fT; e.modal: damping L
    diag(c) L^T; e.laws: stress beyond constant properties. Matrices add to the left-hand side,
    vectors to the right. Prescribed temperatures: sums of shape * f(t) at some nodes, whose vectors
    have the kind "prescribed", as they are no loads. e.prestressed, which a body with temperature
    unknowns is never: adds the geometric stiffness of its constant thermal stress.
    """
    F, Kt = e.free, e.coupling[e.free]
    block, thermal = f"{body.name}.elastic", f"{body.name}.thermal"
    equations.matrix(block, block, A=e.stiffness[F][:, F], B=e.damping[F][:, F])
    if e.modal is not None:
        at, L = equations.numbers(block), e.modal.L[F]
        equations.local([block], ModalDamping(at, at, L, e.modal.c, L))
    for law, cells in e.laws:
        _write_stress(body, equations, law, cells)
    assert body.T0 is not None and body.T_ref is not None
    if body.heat is None:
        force = np.asarray(Kt @ (body.T0 - body.T_ref))
        equations.vector(block, force)
        if e.prestressed and force.any():
            equations.matrix(block, block, A=thermal_stiffness(body, force))
        return
    equations.vector(block, -np.asarray(Kt @ body.T_ref))
    if len(body.heat.free):
        Kt_free = Kt[:, body.heat.free]
        equations.matrix(block, thermal, A=-Kt_free)
        if e.two_way:  # the rate of the entropy beta : strain, times the temperature
            T = diags_array(body.T_ref[body.heat.free])
            equations.matrix(thermal, block, B=csr_array(T @ Kt_free.T))
    for nodes, function, shape in body.heat.prescribed:
        equations.vector(block, np.asarray(Kt[:, nodes] @ shape), function.value, "prescribed")


def write_conduction(body: HasFields, equations: Equations, h: Heat) -> None:
    """Adds conduction and capacity of the free temperatures: C T' + K T, the pointwise laws of
    properties that depend on temperature, and as loads the effect of prescribed temperatures, sums
    of shape * f(t) at some nodes: -K shape f and -C shape f' on the right-hand side. A law that
    reads rates stores heat, and is lumped (evaluated at the nodes) where the capacity is.
    "prescribed": kind of a vector that is no load."""
    block, free = f"{body.name}.thermal", h.free
    if not len(free):
        return
    equations.matrix(block, block, A=h.conductivity[free][:, free], B=h.capacity[free][:, free])
    for law, cells in h.laws:
        stored = any(v.rate for v in law.reads)
        write_law(body, equations, equations.over_steps(law), facets=None, cells=cells,
                  at_nodes=stored and h.lumped)
    for nodes, function, shape in h.prescribed:
        for matrix, f in ((h.conductivity, function.value), (h.capacity, function.rate)):
            equations.vector(block, -np.asarray(matrix[free][:, nodes] @ shape), f, "prescribed")


def write_film(
    body: str, equations: Equations, heat: Heat, vector: FloatArray, amplitude: Amplitude,
    film: Csr | None,
) -> None:
    """Adds a nodal heat vector (N,), W, times an amplitude to the right-hand side, and a convection
    matrix `film` (N, N), W/K, times the temperatures to the left: of prescribed ones, shape * f(t)
    at some nodes, as a vector on the right-hand side (of the kind "prescribed", no load)."""
    block, free = f"{body}.thermal", heat.free
    if not len(free):
        return
    equations.vector(block, vector[free], amplitude)
    if film is None:
        return
    mine = film[free]
    equations.matrix(block, block, A=mine[:, free])
    for nodes, function, shape in heat.prescribed:
        equations.vector(block, -np.asarray(mine[:, nodes] @ shape), function.value, "prescribed")


def _write_stress(
    body: HasFields, equations: Equations, law: StressLaw, cells: IntArray | None
) -> None:
    """Adds a stress law; one that is linear in the displacements becomes a stiffness matrix and a
    constant force where the body's temperatures are no unknowns."""
    if body.heat is not None or not law.linear:
        write_law(body, equations, law, facets=None, cells=cells)
        return
    assert body.mesh is not None
    for _, points in on_cells(body.mesh, law.degree, cells):
        term, (block,) = law_term(body, equations, law, points)
        # rows and columns of the term are numbers of the state, `first` that of the block's first
        # its residual, for all unknowns 0, is on the left-hand side, a vector on the right
        n, first = equations.size(block), int(equations.numbers(block)[0])
        zero = np.zeros(len(term.columns))
        force = np.zeros(n)
        force[term.rows - first] = term.residual(zero, zero, zero, 0.0)
        K = term.jacobian(zero, zero, zero, 0.0, zero, zero).tocoo()
        at = term.rows[K.row] - first, term.columns[K.col] - first
        equations.matrix(block, block, A=csr_array((K.data, at), shape=(n, n)))
        equations.vector(block, -force)


def write_law(
    body: HasFields, equations: Equations, law: PointwiseLaw, facets: IntArray | None,
    cells: IntArray | None, *, at_nodes: bool = False,
) -> None:
    """Adds a pointwise law over boundary facets (F, w) of corner numbers, or over cells by their
    numbers, all if None; a term for each kind of them, times the thickness of the body. at_nodes:
    quadrature at the nodes of the cells, as for a lumped capacity matrix."""
    assert body.mesh is not None
    # a variable or test function with an axis is a derivative along it
    steep = any(v.axis is not None for v in (*law.reads, *law.tests))
    # a capacity with a peak at a point of negative weight would take heat away
    stores = any(v.rate for v in law.reads)
    kinds = [at for _, at in on_cells(
        body.mesh, law.degree, cells, gradients=steep, at_nodes=at_nodes,
        positive=stores)] if facets is None else (
        on_facets(body.mesh, facets, law.degree, gradients=steep))
    for points in kinds:
        term, blocks = law_term(body, equations, law, points)
        if len(term.rows):
            equations.local(blocks, term)


def law_term(
    body: HasFields, equations: Equations, law: PointwiseLaw, quadrature: Quadrature
) -> tuple[WeakTerm, list[str]]:
    """Weak term of a law, and the blocks that it reads and adds to.

    A field that is no unknown of the body has its initial value: zero displacement, temperatures
    T0.
    """
    # the law adds to rows of the field that it tests, and reads the unknowns of others
    row_quantity, read = law.tests[0].quantity, {v.quantity for v in law.reads}
    names = {Quantity.DISPLACEMENT: f"{body.name}.elastic",
             Quantity.TEMPERATURE: f"{body.name}.thermal"}
    numbers = {q: equations.numbers(name) for q, name in names.items()}
    columns = np.unique(np.concatenate([numbers[q] for q in read]))
    fields, row_of = {}, np.zeros((0, 1), np.int64)
    for quantity in {row_quantity, *read}:
        whole, unknowns = _field(body, quantity, quadrature), numbers[quantity]
        free = whole.column_of >= 0
        if quantity is row_quantity:
            row_of = whole.column_of
        # positions of the field's unknowns among the columns; none where the law does not read it
        at = np.searchsorted(columns, unknowns) if quantity in read else np.full(len(unknowns), -1)
        column_of = np.full(whole.column_of.shape, -1, np.int64)
        column_of[free] = at[whole.column_of[free]]
        fields[quantity] = NodalField(
            whole.shape, column_of, whole.constant, whole.prescribed)
    term = WeakTerm(
        rows=numbers[row_quantity], columns=columns, law=law, fields=fields, row_of=row_of,
        weights=quadrature.weights * body.thickness, coordinates=quadrature.coordinates)
    here = np.unique(row_of[fields[row_quantity].shape.nodes])
    blocks = [n for q, n in names.items() if len(numbers[q]) and q in {row_quantity, *read}]
    return term.restrict(here[here >= 0]), blocks


def _field(body: HasFields, quantity: Quantity, quadrature: Quadrature) -> NodalField:
    """A field of the body at all its N nodes; `column_of`: positions among its free unknowns, -1
    where there is none. Values that are no unknowns: displacements 0; temperatures T0 for a body
    without a thermal field, else the prescribed ones."""
    assert body.mesh is not None
    N, d = body.mesh.points.shape
    if quantity is Quantity.DISPLACEMENT:
        free = np.zeros(0, np.int64) if body.elasticity is None else body.elasticity.free
        return NodalField(quadrature.shape, numbered(free, N * d).reshape(N, d), np.zeros((N, d)))
    T0 = np.zeros(N) if body.T0 is None else body.T0
    if body.heat is None:
        return NodalField(quadrature.shape, numbered(np.zeros(0, np.int64), N)[:, None],
                          T0[:, None])
    return NodalField(quadrature.shape, numbered(body.heat.free, N)[:, None],
                      np.zeros((N, 1)), body.heat.prescribed)


def generator(m: Csr, B: FloatArray) -> Csr:
    """(d N, d N) inertia matrix m (x) B without stored zeros; m (N, N): mass matrix, kg; B (d, d).
    """
    return csr_array(kron(m, csr_array(B), format="csr"))


def about(m: Csr, X: FloatArray, matrices: FloatArray) -> FloatArray:
    """(d N, g) functionals M_g X of the g matrices (g, d, d)."""
    return np.stack([(m @ X @ B.T).ravel() for B in matrices], axis=1)


def write_surface_loads(
    body: HasFields, equations: Equations, loads: SurfaceLoads, times: FloatArray
) -> None:
    """Adds forces on the elastic and heat on the thermal unknowns of the loaded nodes at times
    (T,), s: loads.force (T, j, d), N, in body axes, loads.heat (T, j), W, of loads.nodes (j,).

    A frame with prescribed motion needs no resultants: its rigid equations are not solved.
    """
    names = [f"{equations.origin.part}, node {n}" for n in loads.nodes.tolist()]
    if body.elasticity is not None:
        d = loads.force.shape[2]
        dofs = (d * loads.nodes[:, None] + np.arange(d)).ravel()
        force = loads.force.reshape(len(times), -1)
        _write(equations, f"{body.name}.elastic", body.elasticity.free, dofs,
               [f"{n}, {axis}" for n in names for axis in "xyz"[:d]], Table(times, force))
    if body.heat is not None:
        _write(equations, f"{body.name}.thermal", body.heat.free, loads.nodes, names,
               Table(times, loads.heat))


def _write(
    equations: Equations, block: str, free: IntArray, dofs: IntArray, names: Sequence[str],
    table: Table,
) -> None:
    """Adds a load table: its column i acts on dof number dofs[i] of a field.

    Columns of prescribed displacements or temperatures are dropped, and a table without remaining
    columns.
    """
    acts = np.flatnonzero(np.isin(dofs, free))
    if not len(acts):
        return
    at = np.searchsorted(free, dofs[acts])
    columns = csr_array((np.ones(len(acts)), (at, np.arange(len(acts)))),
                        shape=(len(free), len(acts)))
    equations.table(block, LoadTable(
        equations.origin.part, columns, tuple(names[i] for i in acts.tolist()),
        table.columns(acts)))
