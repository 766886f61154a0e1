"""Residual terms of the contributions of bodies, joints, contacts and loads: the general form of
the equations, built independently of the block operators (block_operators.py).

A term evaluated element by element is taken as it is; matrices, vectors, load tables, constraints
and forces on frames become terms with the rows and columns of the blocks that they name.
"""

from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np

from sparsemor.core.arrays import IntArray, union
from sparsemor.core.model.frame_equations import frame_rows, frame_term
from sparsemor.core.model.linear_equations import matrix_term, table_term, target_term, vector_term
from sparsemor.core.protocols.contributions import (
    FrameRecord,
    MatrixRecord,
    Origin,
    Records,
    VectorRecord,
)
from sparsemor.core.protocols.layout import Layout, Quantity
from sparsemor.core.protocols.term import Term

R = TypeVar("R", MatrixRecord, VectorRecord)
Touched = Mapping[str, Mapping[str, IntArray]]
"""Body, joint, contact or load -> block of unknowns -> sorted row numbers that it acts on."""


def general_terms(layout: Layout, records: Records) -> dict[str, list[Term]]:
    """Residual terms by the body, joint, contact or load that contributes them. A force on a
    prescribed frame without an elastic field has no rows and gives no term. records.frames:
    inertia, forces and joints of floating frames, with what they do to displacements; constraints:
    their prescribed values alone."""
    found: dict[str, list[Term]] = {}
    owners = {b.name: b for b in records.bodies}
    made: list[tuple[Origin, Term]] = []
    for f in records.frames:
        if acts(layout, f):
            made.append((f.origin, frame_term(layout, owners[f.body], f)))
    # matrices and vectors of one source on one block are one term: large parts cancel in it
    matrices, vectors = by_block(records.matrices), by_block(records.vectors)
    for at, group in matrices.items():
        made.append((at[0], matrix_term(layout, group, vectors.pop(at, []))))
    made += [(origin, vector_term(layout, rest)) for (origin, _), rest in vectors.items()]
    made += [(t.origin, table_term(layout, t)) for t in records.tables]
    made += [(r.origin, r.term) for r in records.local]
    made += [(c.origin, target_term(layout, c)) for c in records.constraints]
    for origin, term in made:
        if len(term.rows):
            found.setdefault(origin.part, []).append(term)
    return found


def by_block(records: Sequence[R]) -> dict[tuple[Origin, str], list[R]]:
    """Contributions grouped by their source (body, joint, contact or load) and by the block of
    their rows."""
    groups: dict[tuple[Origin, str], list[R]] = {}
    for r in records:
        groups.setdefault((r.origin, r.rows), []).append(r)
    return groups


def touched(layout: Layout, records: Records) -> Touched:
    """Row numbers that each body, joint, contact and load acts on, by block of unknowns."""
    found: dict[str, dict[str, list[IntArray]]] = {}

    def add(origin: Origin, block: str, rows: IntArray) -> None:
        if len(rows):
            found.setdefault(origin.part, {}).setdefault(block, []).append(rows)

    for f in records.frames:
        at = frame_rows(layout, f)[1]  # of rigid, elastic and multiplier unknowns the elastic ones
        if len(at):
            block = layout.name_of(f.body, Quantity.DISPLACEMENT)
            add(f.origin, block, at - layout[block].start)
    for m in records.matrices:
        for X in (m.A, m.B, m.M):
            if X is not None:
                add(m.origin, m.rows, np.flatnonzero(np.diff(X.indptr)))
    for r in records.vectors:
        add(r.origin, r.rows, np.flatnonzero(r.w))
    for t in records.tables:
        add(t.origin, t.rows, np.flatnonzero(np.diff(t.load.columns.indptr)))
    for local in records.local:
        for block in local.blocks:
            here, rows = layout[block], local.term.rows
            add(local.origin, block, rows[(rows >= here.start) & (rows < here.stop)] - here.start)
    return {part: {block: union(rows) for block, rows in blocks.items()}
            for part, blocks in found.items()}


def acts(layout: Layout, record: FrameRecord) -> bool:
    """True if a force, constraint or inertia reads or acts on an unknown."""
    return bool(sum(map(len, frame_rows(layout, record))) or record.reads in layout)
