"""Takes the terms of bodies apart for the fast step solvers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import csr_array

from sparsemor.bodies.frame_term import FrameTerm
from sparsemor.bodies.integrals import elastic_integrals, heat_integrals
from sparsemor.bodies.linear_term import LinearTerm
from sparsemor.bodies.table_term import TableTerm
from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.errors import Fault, InputError
from sparsemor.core.layout import Layout
from sparsemor.core.protocols import Term
from sparsemor.core.separable import (
    Amplitude,
    ElasticOperators,
    HeatBody,
    LoadColumn,
    MovingBody,
)
from sparsemor.core.tables import LoadTable

if TYPE_CHECKING:
    from sparsemor.bodies.body import Body


def moving_body(body: Body, layout: Layout, terms: Sequence[Term]) -> MovingBody | None:
    """The mechanical equations of one body as constant matrices and one frame kernel.

    None when the body neither moves nor deforms.
    """
    frames = [t for t in terms if isinstance(t, FrameTerm)]
    if not frames:
        return None
    first: Any = frames[0].equations.frame  # of the body's dimension
    elastic = body.position(layout, "elastic")
    inertia = next((t for t in frames if t.equations.V), None)
    if not body.moves and body.guide is None:  # at rest: nothing of the mass but M u''
        frames = [t for t in frames if t is not inertia]
    if not body.moves:
        _check_pushing(body, frames)
    items = tuple(i for t in frames for i in t.equations.frame.items)
    frame = replace(first, items=items)
    operators = None
    if len(elastic) and inertia is not None:
        operators = _operators(body, layout, frames, inertia, terms, elastic)
    origin = np.zeros(frame.border)
    if not body.moves and body.guide is None:
        origin[: len(body.pose)] = body.pose
    return MovingBody(
        body.name, frame, _to_border(body, layout, frames), origin,
        f"{body.name}.elastic" if len(elastic) else "",
        f"{body.name}.thermal" if body.heat is not None else "", operators, body.guide,
    )


def _check_pushing(body: Body, frames: Sequence[FrameTerm]) -> None:
    """InputError for items that a prescribed frame could not evaluate."""
    faults = [
        Fault(f"loads.{t.source}" if t.source != body.name else f"bodies.{body.name}",
              f"its item {type(item).__name__} has no method `push`, which is how items act on a "
              f"body whose frame is prescribed or at rest ({body.name!r} is one): give it that "
              "method (bodies/spatial/items.py, `Pushing`)")
        for t in frames for item in t.equations.frame.without_push]
    if faults:
        raise InputError(faults)


def _to_border(body: Body, layout: Layout, frames: Sequence[FrameTerm]) -> FloatArray:
    """(b, N): rigid coordinates, its own and those that its joints read, and attachment forces
    from rigid blocks and multipliers."""
    n_rigid = sum(b.size for b in layout if b.field == "rigid")
    start = layout.algebraic.start
    width = n_rigid + layout.size - start
    own = np.zeros((len(body.pose), width))
    rigid = body.position(layout, "rigid")
    own[np.arange(len(rigid)), rigid] = 1.0
    others, forces = [], []
    for t in frames:
        is_rigid, is_lam = t.columns < n_rigid, t.columns >= start
        T, d = np.zeros((t.equations.frame.border, width)), t.equations.frame.rigid_size
        T[:, t.columns[is_rigid]] = t.equations.Y[:, is_rigid]
        T[:, n_rigid + t.columns[is_lam] - start] = t.equations.Y[:, is_lam]
        others.append(T[len(own) : d])
        forces.append(T[d:])
    return np.concatenate([own, *others, *forces])


def _operators(
    body: Body, layout: Layout, frames: Sequence[FrameTerm], inertia: FrameTerm,
    terms: Sequence[Term], elastic: IntArray,
) -> ElasticOperators:
    """frames: what acts through the frame; inertia: one of them, unless the frame is at rest."""
    n, first = len(elastic), int(elastic[0])
    P, columns = [np.zeros((n, 0))], list[LoadColumn]()
    for t in frames:
        for item in t.equations.frame.items:
            columns += [LoadColumn(name, item.forces > 0) for name in item.names(t.source)]
        here = (t.rows >= first) & (t.rows < first + n)
        D = np.zeros((n, t.equations.frame.p))
        D[t.rows[here] - first] = np.asarray(t.equations.W)[here]
        P.append(D)
    at = np.searchsorted(inertia.rows, elastic)
    generators = tuple(csr_array(V[at][:, at]) for V in inertia.equations.V)
    linear = [t for t in terms if isinstance(t, LinearTerm) and _within(t.rows, elastic)]
    thermal = body.position(layout, "thermal")
    constant, loads, amplitudes, names = _given(linear, elastic)
    return ElasticOperators(
        mass=generators[0], damping=_sum(linear, elastic, elastic, "B"),
        stiffness=_sum(linear, elastic, elastic, "A"),
        generators=generators if inertia in frames else (),
        directions=np.concatenate(P, axis=1),
        coupling=-_sum(linear, elastic, thermal, "A") if len(thermal) else None,
        constant=constant, loads=loads, amplitudes=amplitudes,
        columns=tuple(columns), load_names=names,
        integrals=None if body.mesh is None else partial(elastic_integrals, body),
        tables=_tables(terms, elastic),
    )


def heat_body(body: Body, layout: Layout, terms: Sequence[Term]) -> HeatBody | None:
    """The thermal equations of one body; local terms are kept as they are."""
    thermal = body.position(layout, "thermal")
    if not len(thermal):
        return None
    mine = [t for t in terms if len(t.rows) and _within(t.rows, thermal)]
    linear = [t for t in mine if isinstance(t, LinearTerm)]
    local = tuple(t for t in mine if not isinstance(t, LinearTerm | TableTerm))
    constant, loads, amplitudes, names = _given(linear, thermal)
    return HeatBody(
        body.name, f"{body.name}.thermal", _sum(linear, thermal, thermal, "B"),
        _sum(linear, thermal, thermal, "A"), constant, loads, amplitudes, local, names,
        None if body.mesh is None else partial(heat_integrals, body), _tables(mine, thermal),
    )


def _tables(terms: Sequence[Term], block: IntArray) -> tuple[LoadTable, ...]:
    """The loads that move over one block."""
    return tuple(t.over(block) for t in terms
                 if isinstance(t, TableTerm) and _within(t.rows, block))


def _within(rows: IntArray, block: IntArray) -> bool:
    return bool(len(rows) and rows.min() >= block[0] and rows.max() <= block[-1])


def _sum(terms: Sequence[LinearTerm], rows: IntArray, columns: IntArray, which: str) -> Csr:
    """Sum of the terms' A or B over one block's rows and another's columns."""
    total = csr_array((len(rows), len(columns)))
    for t in terms:
        m = csr_array(getattr(t.equations, which)).tocoo()
        j = t.columns[m.col] - columns[0]
        here = (j >= 0) & (j < len(columns))
        i = t.rows[m.row[here]] - rows[0]
        total = total + csr_array((m.data[here], (i, j[here])), shape=total.shape)
    return csr_array(total)


def _given(
    terms: Sequence[LinearTerm], rows: IntArray
) -> tuple[FloatArray, FloatArray, tuple[Amplitude, ...], tuple[str, ...]]:
    """Constant right-hand side, load columns, their amplitudes and names."""
    constant, columns, amplitudes = np.zeros(len(rows)), [np.zeros((len(rows), 0))], []
    names: list[str] = []
    for t in terms:
        at = t.rows - rows[0]
        constant[at] += t.equations.constant
        wide = np.zeros((len(rows), t.equations.loads.shape[1]))
        wide[at] = t.equations.loads
        columns.append(wide)
        amplitudes += list(t.equations.amplitudes)
        # a body's own columns, and those of a film after its first, are of given temperatures
        own = "given temperature" if t.source == t.body else t.source
        extra = f"{own}, given temperature"
        names += [own if i == 0 or own == "given temperature" else extra
                  for i in range(wide.shape[1])]
    return constant, np.concatenate(columns, axis=1), tuple(amplitudes), tuple(names)
