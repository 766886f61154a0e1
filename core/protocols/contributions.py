"""Contributions: what the parts of a scene write into the equations, by the names of blocks.

    sum of M x'' + B x' + A x  +  frame items  +  local terms  =  sum of w f(t)  +  tables(t)

A part names the blocks that it acts on ("link1.thermal", "hinge.multiplier") and gives matrices and
vectors over the unknowns of these blocks. Nothing is summed here: the records are closed into
operators of each block, couplings between blocks and the general form
(core/model/contributions.py).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from scipy.sparse import csr_array

from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.errors import InputError
from sparsemor.core.protocols.element_integrals import ElasticIntegrals, HeatIntegrals
from sparsemor.core.protocols.layout import Layout, Quantity
from sparsemor.core.protocols.load_tables import LoadTable
from sparsemor.core.protocols.prescribed_motion import FrameHistory
from sparsemor.core.protocols.separable import Amplitude, BodyFrame, FrameItem
from sparsemor.core.protocols.term import NamesSource, Term

Kind = Literal["load", "prescribed"]
"""What a vector is: a load, or the effect of prescribed values on the rows next to them."""
NO_NUMBERS = np.zeros(0, np.int64)


@dataclass(frozen=True, slots=True)
class Origin:
    """The part of a scene that a record comes from: its group ("loads") and its name."""

    group: str
    part: str

    @property
    def key(self) -> str:
        """The dotted key of the part in the scene."""
        return f"{self.group}.{self.part}"


@dataclass(frozen=True, slots=True, eq=False)
class MatrixRecord:
    """A x + B x' + M x'' in the rows of one block, x the unknowns of another or of the same."""

    origin: Origin
    rows: str
    columns: str
    A: Csr | None
    B: Csr | None
    M: Csr | None


@dataclass(frozen=True, slots=True, eq=False)
class VectorRecord:
    """w f(t) on the right-hand side of one block; amplitude None: constant."""

    origin: Origin
    rows: str
    w: FloatArray
    amplitude: Amplitude | None
    kind: Kind

    @property
    def name(self) -> str:
        """The load as bases and reports name it."""
        if self.kind == "load":
            return self.origin.part
        own = "prescribed temperature"
        return own if self.origin.group == "bodies" else f"{self.origin.part}, {own}"


@dataclass(frozen=True, slots=True, eq=False)
class TableRecord:
    """A load on one block that is tabled over time."""

    origin: Origin
    rows: str
    load: LoadTable


@dataclass(frozen=True, slots=True, eq=False)
class FrameRecord:
    """One item of a body's frame kernel: inertia, a force, an attachment.

    directions (n, p): columns by which it acts on the body's elastic block, p as many as the item
    has; multipliers, C (l, forces): its forces are C^T times the l multipliers of that block, and
    C times its attachment rows enter their rows; reads: rigid block of another body that it reads;
    generators: g matrices (n, n) of an inertia, the first is the mass.
    """

    origin: Origin
    body: str
    item: FrameItem
    directions: FloatArray
    multipliers: str = ""
    C: FloatArray | None = None
    reads: str = ""
    generators: tuple[Csr, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class LocalRecord:
    """A term that is evaluated element by element; blocks: all that its rows and columns are in;
    together: whether all unknowns of the model are to be solved for at once."""

    origin: Origin
    blocks: tuple[str, ...]
    term: Term
    together: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class ConstraintRecord:
    """Row i of a block of multipliers equals targets[i](t)."""

    origin: Origin
    block: str
    targets: tuple[Amplitude, ...]


@dataclass(frozen=True, slots=True, eq=False)
class BodyRecord:
    """A body and its frame.

    kernel: frame kernel of some items; pose (b,): rigid coordinates at the start; moves: whether
    they are unknowns; guide: a prescribed motion of the frame; elastic_integrals, heat_integrals:
    balances by elements, where the body can give them.
    """

    origin: Origin
    kernel: Callable[[Sequence[FrameItem]], BodyFrame]
    pose: FloatArray
    moves: bool
    guide: FrameHistory | None = None
    elastic_integrals: Callable[[], ElasticIntegrals] | None = None
    heat_integrals: Callable[[], HeatIntegrals] | None = None

    @property
    def name(self) -> str:
        return self.origin.part


@dataclass(slots=True, eq=False)
class Records:
    """All records of a scene, in the order in which they were written."""

    bodies: list[BodyRecord] = field(default_factory=list)
    matrices: list[MatrixRecord] = field(default_factory=list)
    vectors: list[VectorRecord] = field(default_factory=list)
    tables: list[TableRecord] = field(default_factory=list)
    frames: list[FrameRecord] = field(default_factory=list)
    local: list[LocalRecord] = field(default_factory=list)
    constraints: list[ConstraintRecord] = field(default_factory=list)


class Equations:
    """The equations as one part of a scene writes into them.

    A block is named `owner.kind`, such as `link1.thermal`. Writing into a block that the scene does
    not have, or with arrays of another size, raises InputError that names the part.
    """

    def __init__(self, layout: Layout, origin: Origin, records: Records) -> None:
        self.layout, self.origin, self._records = layout, origin, records

    def size(self, block: str) -> int:
        """Number of unknowns of a block, 0 where the scene does not have it."""
        return len(self.layout.numbers(block))

    def numbers(self, block: str) -> IntArray:
        """Positions of a block's unknowns in the state vector, for the rows and columns of local
        terms; none where the scene does not have it."""
        return self.layout.numbers(block)

    def body(
        self, kernel: Callable[[Sequence[FrameItem]], BodyFrame], pose: FloatArray, *,
        moves: bool, guide: FrameHistory | None = None,
        elastic_integrals: Callable[[], ElasticIntegrals] | None = None,
        heat_integrals: Callable[[], HeatIntegrals] | None = None,
    ) -> None:
        """A body and its frame, as `BodyRecord` has them."""
        self._records.bodies.append(BodyRecord(
            self.origin, kernel, pose, moves, guide, elastic_integrals, heat_integrals))

    def matrix(
        self, rows: str, columns: str, *, A: Csr | None = None, B: Csr | None = None,
        M: Csr | None = None,
    ) -> None:
        """A x + B x' + M x'' in the rows of one block, constant matrices (m, n), x the unknowns of
        the block `columns`."""
        m, n = self._checked(rows), self._checked(columns)
        made = [None if X is None else csr_array(X) for X in (A, B, M)]
        for name, X in zip("ABM", made, strict=True):
            if X is not None and X.shape != (m, n):
                raise self._fault(f"{name} on ({rows}, {columns}) has shape {X.shape}, and the "
                                  f"blocks have ({m}, {n}) unknowns")
        self._records.matrices.append(MatrixRecord(self.origin, rows, columns, *made))

    def vector(
        self, rows: str, w: FloatArray, amplitude: Amplitude | None = None, kind: Kind = "load"
    ) -> None:
        """w f(t) on the right-hand side, w (m,); amplitude None: constant in time."""
        m = self._checked(rows)
        if w.shape != (m,):
            raise self._fault(f"a vector on {rows} has shape {w.shape}, and the block has {m} "
                              "unknowns")
        self._records.vectors.append(VectorRecord(self.origin, rows, w, amplitude, kind))

    def table(self, rows: str, load: LoadTable) -> None:
        """A load (m,) on the right-hand side that is tabled over time, load.columns (m, j)."""
        m = self._checked(rows)
        if load.columns.shape[0] != m:
            raise self._fault(f"a table on {rows} has {load.columns.shape[0]} rows, and the block "
                              f"has {m} unknowns")
        load = replace(load, source=self.origin.part)
        self._records.tables.append(TableRecord(self.origin, rows, load))

    def frame(
        self, body: str, item: FrameItem, directions: FloatArray | None = None, *,
        multipliers: str = "", C: FloatArray | None = None, reads: str = "",
        generators: Sequence[Csr] = (),
    ) -> None:
        """An item of a body's frame, as `FrameRecord` has it; directions None: it does not act on
        displacements."""
        block = self.layout.of(body, Quantity.DISPLACEMENT)
        n = 0 if block is None else block.size
        P = np.zeros((n, 0)) if directions is None else directions
        self._records.frames.append(FrameRecord(
            self.origin, body, item, P, multipliers, C, reads, tuple(generators)))

    def local(self, blocks: Sequence[str], term: Term, *, together: bool = False) -> None:
        """A term whose rows and columns, positions in the state vector, are in these blocks.

        A term on one thermal block, or on one elastic block with the temperatures of its body, is
        iterated inside the step of that block; on displacements it must not depend on
        accelerations. together: solve for all unknowns at once instead, by Newton's method with
        the exact Jacobian, as for a stiff contact.
        """
        for block in blocks:
            self._checked(block)
        inside = np.concatenate([NO_NUMBERS, *map(self.numbers, blocks)])
        for what, at in (("rows", term.rows), ("columns", term.columns)):
            if not np.isin(at, inside).all():
                raise self._fault(f"{what} of its term {type(term).__name__} are outside of the "
                                  f"blocks {', '.join(blocks)} that it names")
        if isinstance(term, NamesSource):
            named: Any = term
            term = replace(named, source=self.origin.part)
        self._records.local.append(LocalRecord(self.origin, tuple(blocks), term, together))

    def constraint(self, block: str, targets: Sequence[Amplitude]) -> None:
        """Constraint: the sum of contributions to the rows of multipliers equals targets (l,)."""
        if self._checked(block) != len(targets):
            raise self._fault(f"{len(targets)} targets for the {self.size(block)} rows of {block}")
        self._records.constraints.append(ConstraintRecord(self.origin, block, tuple(targets)))

    def _checked(self, block: str) -> int:
        if block not in self.layout:
            names = ", ".join(b.name for b in self.layout)
            raise self._fault(f"it writes into the block {block!r}, which the scene does not have: "
                              f"{names}")
        return self.size(block)

    def _fault(self, text: str) -> InputError:
        return InputError(text, self.origin.key)
