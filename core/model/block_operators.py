"""Operators of blocks, with the couplings and constraints between them, from the contributions of
bodies, joints, contacts and loads.

A block is the unknowns of one field of one body, or the multipliers of one joint. A matrix on (a,
a) is an operator of block a, one on (a, b) couples two blocks. A term evaluated element by element
belongs to the block that it names, or to none where it names several. Tests compare them with the
terms of general_terms.py.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from sparsemor.core.arrays import Csr, FloatArray
from sparsemor.core.errors import Fault, InputError
from sparsemor.core.model.frame_equations import stiffness_term
from sparsemor.core.model.general_terms import acts, by_block
from sparsemor.core.model.linear_equations import (
    matrix_term,
    right_hand_side,
    table_term,
    vector_term,
)
from sparsemor.core.protocols.body_frame import FrameItem
from sparsemor.core.protocols.contributions import (
    BodyRecord,
    FrameRecord,
    LocalRecord,
    MatrixRecord,
    Records,
    VectorRecord,
)
from sparsemor.core.protocols.layout import Block, Layout, Quantity
from sparsemor.core.protocols.load_tables import LoadTable
from sparsemor.core.protocols.separable import (
    Amplitude,
    ElasticLocal,
    ElasticOperators,
    HeatBody,
    HeatCoupling,
    LoadColumn,
    MovingBody,
    Separated,
)
from sparsemor.core.protocols.term import Term


def block_operators(layout: Layout, records: Records, step: float) -> Separated:
    """Block operators of the recorded contributions, and the couplings and constraints between
    blocks. step: time step, s. Raises InputError for a force or constraint that cannot be evaluated
    on a body with prescribed motion."""
    operators = _BlockOperators(layout, records)
    moving = [m for b in records.bodies if (m := operators.mechanics(b)) is not None]
    heat = [operators.heat(b) for b in layout if operators.field(b.name) is Quantity.TEMPERATURE]
    return Separated(
        tuple(moving), tuple(heat), operators.border, tuple(operators.targets()),
        tuple(operators.other()), step, tuple(operators.couplings()))


def stiffness_terms(layout: Layout, records: Records) -> dict[str, Term]:
    """Residual terms of the bodies that their loads stiffen, of this stiffness alone, by name."""
    operators, found = _BlockOperators(layout, records), dict[str, Term]()
    for b in records.bodies:
        made = operators.mechanics(b) if b.stiffened is not None else None
        if made is not None and made.operators is not None:
            border = np.r_[layout.frames, layout.algebraic]
            found[b.name] = stiffness_term(made, layout.numbers(made.elastic), border)
    return found


@dataclass(frozen=True, slots=True, eq=False)
class _BlockOperators:
    layout: Layout
    records: Records

    @property
    def rigid(self) -> int:
        """Number of rigid coordinates, which are the first unknowns."""
        return self.layout.frames.stop

    @property
    def border(self) -> int:
        """Number of rigid coordinates and Lagrange multipliers together."""
        return self.rigid + self.layout.size - self.layout.algebraic.start

    def targets(self) -> Iterable[tuple[int, Amplitude]]:
        """Constraint rows: (position among rigid coordinates and multipliers, prescribed function
        of time)."""
        for c in self.records.constraints:
            first = self.layout[c.block].start - self.layout.algebraic.start + self.rigid
            yield from ((first + i, f) for i, f in enumerate(c.targets))

    def other(self) -> Iterable[Term]:
        """Terms that belong to no single block and are no conduction between two bodies."""
        layout, r = self.layout, self.records
        # blocks with operators of their own, which take their vectors and tables
        fields = {b.name for b in layout if self.field(b.name)}
        for m in r.matrices:
            if not self._has_slot(m) and not self._couples_heat(m):
                yield matrix_term(layout, [m], [])
        for (_, rows), group in by_block(r.vectors).items():
            if rows not in fields:
                yield vector_term(layout, group)
        for t in r.tables:
            if t.rows not in fields:
                yield table_term(layout, t)
        for local in r.local:
            if self._owner(local) is None and len(local.term.rows):
                yield local.term

    def _has_slot(self, m: MatrixRecord) -> bool:
        """True if a matrix belongs to the operators of one body: mass, damping, stiffness, capacity
        or conductivity of one of its blocks, or its thermal coupling, by which the temperatures
        (columns) drive the displacements (rows). field: quantity of a block that can have
        operators, else None."""
        rows, columns = self.layout.block(m.rows), self.layout.block(m.columns)
        if rows.owner != columns.owner:
            return False
        if m.rows != m.columns:
            pair = self.field(m.rows), self.field(m.columns)
            return pair == (Quantity.DISPLACEMENT, Quantity.TEMPERATURE) and (
                m.B is None and m.M is None)
        return self.field(m.rows) is Quantity.DISPLACEMENT or (
            self.field(m.rows) is Quantity.TEMPERATURE and m.M is None)

    def field(self, block: str) -> Quantity | None:
        """Displacement or temperature if the block has mechanical or thermal operators, else None;
        only the first displacement and the first temperature block of a body can have them."""
        b = self.layout.block(block)
        if b != self.layout.of(b.owner, b.kind.quantity):
            return None
        if b.kind.quantity is Quantity.DISPLACEMENT:
            return b.kind.quantity if self._deforms(b.owner) else None
        return b.kind.quantity if b.kind.quantity is Quantity.TEMPERATURE else None

    def _owner(self, local: LocalRecord) -> str | None:
        """Block whose operators include a term evaluated element by element, or None. The term must
        add to rows of this block only and read this block only, or for displacements also the
        temperatures of the same body. field: quantity of a block that can have operators, else
        None."""
        rows = self.layout.containing(local.term.rows)
        if len(rows) != 1 or self.field(rows[0]) is None:
            return None
        (block,), allowed = rows, set(rows)
        if self.field(block) is Quantity.DISPLACEMENT:
            allowed.add(self.layout.name_of(self.layout.block(block).owner, Quantity.TEMPERATURE))
            if local.together:  # it needs all unknowns of the model to be solved for at once
                return None
        return block if allowed.issuperset(local.blocks) else None

    def _deforms(self, body: str) -> bool:
        """True if a body has elastic operators, that is, inertia that acts on displacements."""
        return any(f.body == body and f.generators for f in self.records.frames)

    def _local(self, block: str) -> tuple[Term, ...]:
        """Terms evaluated element by element that are part of the operators of a block."""
        return tuple(r.term for r in self.records.local
                     if len(r.term.rows) and self._owner(r) == block)

    def _elastic_local(self, term: Term, block: str, thermal: str) -> ElasticLocal:
        """A term evaluated element by element, with rows and columns as positions in the elastic
        block `block` and in the temperature block `thermal` of the same body; `hot` (n,): True for
        columns of temperatures."""
        first, columns = self.layout[block].start, term.columns.copy()
        hot = ~np.isin(columns, self.layout.numbers(block))
        columns[~hot] -= first
        if hot.any():
            columns[hot] -= self.layout[thermal].start
        return ElasticLocal(term, term.rows - first, columns, hot)

    def couplings(self) -> Iterable[HeatCoupling]:
        """Conduction and capacity matrices between temperature blocks of different bodies."""
        for m in self.records.matrices:
            if self._couples_heat(m) and not self._has_slot(m):
                shape = tuple(len(self.layout.numbers(n)) for n in (m.rows, m.columns))
                A, B = (csr_array(shape) if X is None else X for X in (m.A, m.B))
                yield HeatCoupling(
                    m.rows, m.columns, A, B, matrix_term(self.layout, [m], []))

    def _couples_heat(self, m: MatrixRecord) -> bool:
        """True for conduction or capacity (no inertia M) between temperature blocks, of one body or
        two."""
        return self.field(m.rows) is self.field(m.columns) is Quantity.TEMPERATURE and (
            m.M is None)

    # ------------------------------------------------------------------ one body

    def mechanics(self, body: BodyRecord) -> MovingBody | None:
        """Mechanical equations of one body: constant matrices, and a kernel for its floating frame
        of reference, which `body.kernel` makes of all contributions to it; None if the body neither
        moves nor deforms. Raises InputError for a force or joint that cannot act on a body with
        prescribed motion (`body.guide`)."""
        frames = [f for f in self.records.frames if f.body == body.name and acts(self.layout, f)]
        if not frames:
            return None
        elastic, thermal = (self.layout.name_of(body.name, q) for q in (
            Quantity.DISPLACEMENT, Quantity.TEMPERATURE))
        inertia = next((f for f in frames if f.generators), None)  # only inertia has generators
        at_rest = not body.moves and body.guide is None
        if at_rest:  # nothing of the mass but M u''
            frames = [f for f in frames if f is not inertia]
        if not body.moves:
            _check_pushing(body, frames)
        operators, last = None, list[FrameItem]()
        if elastic and inertia is not None:
            operators = self._elastic(body, elastic, thermal, frames, inertia)
            if body.stiffened is not None:  # by its loads: a further item and generators
                own = operators.generators
                item, more = body.stiffened(operators.directions, len(own))
                operators, last = replace(operators, generators=(*own, *more)), [item]
        frame = body.kernel((*(f.item for f in frames), *last))
        origin = np.zeros(frame.border)
        if at_rest:
            origin[: len(body.pose)] = body.pose
        return MovingBody(
            body.name, frame, self._to_border(body, frames), origin,
            elastic, thermal, operators, body.guide)

    def _to_border(self, body: BodyRecord, frames: Sequence[FrameRecord]) -> FloatArray:
        """Matrix (b, N) from all N rigid coordinates and multipliers of the model to the b inputs
        of a body's frame kernel: its own rigid coordinates, those of other bodies that its forces
        depend on, and the joint forces on it."""
        layout, shift = self.layout, self.rigid - self.layout.algebraic.start
        # rows of the result in the order of the kernel's inputs; columns: the `rigid` rigid
        # coordinates of the model (numbered as in the state vector), then multipliers (`shift`
        # leads to their columns), `border` = N in all
        own = np.zeros((len(body.pose), self.border))
        rigid_numbers = layout.numbers(layout.name_of(body.name, Quantity.POSE))
        own[np.arange(len(rigid_numbers)), rigid_numbers] = 1.0
        others, forces = [], []
        for f in frames:
            kernel, read = body.kernel((f.item,)), layout.numbers(f.reads)
            T = np.zeros((kernel.rigid_size - len(own), self.border))
            T[np.arange(len(read)), read] = 1.0
            others.append(T)
            T = np.zeros((kernel.border - kernel.rigid_size, self.border))
            if f.C is not None:  # forces = C^T multipliers
                T[:, layout.numbers(f.multipliers) + shift] = f.C.T
            forces.append(T)
        return np.concatenate([own, *others, *forces])

    def _elastic(
        self, body: BodyRecord, block: str, thermal: str, frames: Sequence[FrameRecord],
        inertia: FrameRecord,
    ) -> ElasticOperators:
        """Operators of the elastic block `block` of a body, from all contributions to its n
        displacements u; thermal: its temperature block, "" if it has none.

        frames: what acts on u through the floating frame of reference (its inertia, forces,
        attachments of joints), with their directions side by side. inertia: the record with the
        mass; it is among `frames` unless the frame is at rest, where only M u'' is left of it.
        """
        n, n_temperatures = (len(self.layout.numbers(b)) for b in (block, thermal))
        # the directions of an attachment are those of unknown joint forces
        columns = tuple(LoadColumn(name, joint=f.item.forces > 0)
                        for f in frames for name in f.item.names(f.origin.part))
        elastic_rows = [m for m in self.records.matrices if m.rows == block and self._has_slot(m)]
        own = [m for m in elastic_rows if m.columns == block]
        added_masses = [m.M for m in own if m.M is not None]
        mass = sum(added_masses, start=inertia.generators[0])  # the first generator is the mass
        # records have A T on the left-hand side, operators `coupling` T on the right-hand side
        coupling = [-m.A for m in elastic_rows if m.columns == thermal and m.A is not None]
        constant, loads, timed_records = self._loads(block)
        local = [self._elastic_local(t, block, thermal) for t in self._local(block)]
        return ElasticOperators(
            mass=mass, damping=_sum([m.B for m in own], (n, n)),
            stiffness=_sum([m.A for m in own], (n, n)),
            generators=inertia.generators if inertia in frames else (),
            directions=np.concatenate([np.zeros((n, 0)), *(f.directions for f in frames)], axis=1),
            coupling=_sum(coupling, (n, n_temperatures)) if n_temperatures else None,
            constant=constant, loads=loads, amplitudes=_amplitudes(timed_records), columns=columns,
            load_names=tuple(r.name for r in timed_records), integrals=body.elastic_integrals,
            tables=self._tables(block), stress_stiffness=body.stress_stiffness,
            local=tuple(part for part in local if not part.term.damps),
            damps=tuple(part for part in local if part.term.damps))

    def heat(self, of: Block) -> HeatBody:
        """Heat equation of the temperature block `of`, from all contributions to it."""
        block = of.name
        integrals = next((b.heat_integrals for b in self.records.bodies if b.name == of.owner),
                         None)
        n = len(self.layout.numbers(block))
        own = [m for m in self.records.matrices if m.rows == m.columns == block]
        constant, loads, timed = self._loads(block)
        columns = tuple(LoadColumn(r.name, prescribed=r.kind == "prescribed") for r in timed)
        # A x + B x': B is the capacity, A the conductivity
        return HeatBody(
            of.owner, block, _sum([m.B for m in own], (n, n)), _sum([m.A for m in own], (n, n)),
            constant, loads, _amplitudes(timed), self._local(block), columns, integrals,
            self._tables(block))

    def _loads(self, block: str) -> tuple[FloatArray, FloatArray, list[VectorRecord]]:
        """Constant right-hand side (n,), time-dependent load columns (n, j), and the source of each
        column."""
        here = [r for r in self.records.vectors if r.rows == block]
        constant, loads, _ = right_hand_side(here, len(self.layout.numbers(block)))
        return constant, loads, [r for r in here if r.amplitude is not None]

    def _tables(self, block: str) -> tuple[LoadTable, ...]:
        return tuple(t.load for t in self.records.tables if t.rows == block)


def _amplitudes(records: Sequence[VectorRecord]) -> tuple[Amplitude, ...]:
    """Functions of time of those load vectors that have one."""
    return tuple(r.amplitude for r in records if r.amplitude is not None)


def _check_pushing(body: BodyRecord, frames: Sequence[FrameRecord]) -> None:
    """Raises InputError for forces and constraints that cannot be evaluated on a body with
    prescribed motion."""
    faults = [
        Fault(f.origin.key,
              f"its item {type(item).__name__} has no method `push`, which is how items act on a "
              f"body whose frame is prescribed or at rest ({body.name!r} is one): give it that "
              "method (bodies/frames/frame_items.py, `Pushing`)")
        for f in frames for item in body.kernel((f.item,)).without_push]
    if faults:
        raise InputError(faults)


def _sum(matrices: Sequence[Csr | None], shape: tuple[int, int]) -> Csr:
    """Sum of the matrices that are not None; zero matrix of the shape if all are."""
    given = [m for m in matrices if m is not None]
    total = given[0] if given else csr_array(shape)
    for m in given[1:]:
        total = total + m
    return csr_array(total)
