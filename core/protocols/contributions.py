"""Contributions of bodies, joints, contacts and loads to the equations.

    sum of M x'' + B x' + A x  +  frame items  +  local terms  =  sum of w f(t)  +  tables(t)

Each contributes matrices and vectors over named blocks of unknowns ("link1.thermal",
"hinge.multiplier"). Frame items are inertia, forces and attachments on a floating frame; local
terms are evaluated element by element. The contributions are recorded here and assembled in
core/model: operators of blocks in block_operators.py, residual terms in general_terms.py.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any, Literal, TypeVar

import numpy as np
from scipy.sparse import csr_array

from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.errors import InputError
from sparsemor.core.protocols.body_frame import BodyFrame, FrameItem
from sparsemor.core.protocols.layout import Layout, Quantity
from sparsemor.core.protocols.load_tables import LoadTable
from sparsemor.core.protocols.prescribed_motion import FrameHistory
from sparsemor.core.protocols.separable import (
    Amplitude,
    ElasticIntegrals,
    HeatIntegrals,
    StressStiffness,
)
from sparsemor.core.protocols.step_amplitude import Stepping
from sparsemor.core.protocols.term import Term

T = TypeVar("T")
Kind = Literal["load", "prescribed"]
"""Kind of a right-hand side vector: a load, or the effect of prescribed values on neighbouring
rows."""
NO_NUMBERS = np.zeros(0, np.int64)


@dataclass(frozen=True, slots=True)
class Origin:
    """Source of a contribution: group ("loads") and name of a body, joint, contact or load."""

    group: str
    part: str

    @property
    def key(self) -> str:
        """Dotted input key of the source, such as "loads.gravity"."""
        return f"{self.group}.{self.part}"


@dataclass(frozen=True, slots=True, eq=False)
class MatrixRecord:
    """Linear contribution A x + B x' + M x'' to the rows of one block; x: unknowns of the same or
    another block."""

    origin: Origin
    rows: str
    columns: str
    A: Csr | None
    B: Csr | None
    M: Csr | None


@dataclass(frozen=True, slots=True, eq=False)
class VectorRecord:
    """Load w f(t) on the right-hand side of the block `rows`, w (n,); amplitude: f, None: constant
    in time. kind: "load", or "prescribed" for the effect of prescribed temperatures."""

    origin: Origin
    rows: str
    w: FloatArray
    amplitude: Amplitude | None
    kind: Kind

    @property
    def name(self) -> str:
        """Name of the load in trial bases and reports."""
        if self.kind == "load":
            return self.origin.part
        own = "prescribed temperature"
        return own if self.origin.group == "bodies" else f"{self.origin.part}, {own}"


@dataclass(frozen=True, slots=True, eq=False)
class TableRecord:
    """Time-tabulated load on one block of unknowns."""

    origin: Origin
    rows: str
    load: LoadTable


@dataclass(frozen=True, slots=True, eq=False)
class FrameRecord:
    """One contribution to a body's floating frame: inertia, a force, or an attachment of a joint.

    body: name of the body. item: equations of the contribution. directions (n, p): vectors by which
    it acts on the body's elastic displacements u, of which it reads directions^T u. multipliers:
    name of a joint's multipliers (l,); C (l, forces): forces = C^T multipliers, and C times the
    attachment positions enter the constraint rows. reads: rigid coordinates of another body that it
    depends on. generators: g matrices (n, n) of an inertia, the first is the mass.
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
    """A term evaluated element by element. blocks: all blocks of its rows and columns; together:
    True if it requires all unknowns of the model to be solved for simultaneously."""

    origin: Origin
    blocks: tuple[str, ...]
    term: Term
    together: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class ConstraintRecord:
    """Prescribed values targets[i](t) of the constraint equations of one joint."""

    origin: Origin
    block: str
    targets: tuple[Amplitude, ...]


Stiffened = Callable[[FloatArray, int], tuple[FrameItem, tuple[Csr, ...]]]
"""As in `BodyRecord`."""


@dataclass(frozen=True, slots=True, eq=False)
class BodyRecord:
    """A body and its floating frame of reference.

    kernel: function from contributions (inertia, forces, attachments) to the frame's equations;
    pose (b,): initial rigid coordinates; moves: True if they are unknowns; guide: prescribed motion
    of the frame; elastic_integrals, heat_integrals: element integrals, and stress_stiffness:
    geometric stiffness, if the body offers them. stiffened: of a body that its loads stiffen, a
    function from all directions (n, p) and the number of generators of its inertia to the last
    contribution to its frame, and the further generators that have their factors from it.
    """

    origin: Origin
    kernel: Callable[[Sequence[FrameItem]], BodyFrame]
    pose: FloatArray
    moves: bool
    guide: FrameHistory | None = None
    elastic_integrals: Callable[[], ElasticIntegrals] | None = None
    heat_integrals: Callable[[], HeatIntegrals] | None = None
    stress_stiffness: StressStiffness | None = None
    stiffened: Stiffened | None = None

    @property
    def name(self) -> str:
        return self.origin.part


@dataclass(slots=True, eq=False)
class Records:
    """Contributions of all bodies, joints, contacts and loads, in the order of assembly."""

    bodies: list[BodyRecord] = field(default_factory=list)
    matrices: list[MatrixRecord] = field(default_factory=list)
    vectors: list[VectorRecord] = field(default_factory=list)
    tables: list[TableRecord] = field(default_factory=list)
    frames: list[FrameRecord] = field(default_factory=list)
    local: list[LocalRecord] = field(default_factory=list)
    constraints: list[ConstraintRecord] = field(default_factory=list)


class Equations:
    """Recorder through which one body, joint, contact or load adds its contributions to the
    equations.

    A block of unknowns is named `owner.field`, such as `link1.thermal`. Raises InputError with the
    name of the contributor for a block that the model does not have and for arrays of wrong size.
    """

    def __init__(
        self, layout: Layout, origin: Origin, records: Records, stepping: Stepping | None = None
    ) -> None:
        self.layout, self.origin, self._records = layout, origin, records
        self.stepping = stepping
        """Steps of the run, None where they are not known."""

    def over_steps(self, part: T) -> T:
        """A law, an item of a frame or an amplitude, with the mean values of its functions of time
        in the steps of the run (`Stepping`)."""
        made: Any = part if self.stepping is None else self.stepping.over(part)
        kept: T = made
        return kept

    def size(self, block: str) -> int:
        """Number of unknowns of a block, 0 if the model does not have it."""
        return len(self.layout.numbers(block))

    def numbers(self, block: str) -> IntArray:
        """Positions of a block's unknowns in the state vector, for rows and columns of terms; empty
        if the model does not have the block."""
        return self.layout.numbers(block)

    def body(
        self, kernel: Callable[[Sequence[FrameItem]], BodyFrame], pose: FloatArray, *,
        moves: bool, guide: FrameHistory | None = None,
        elastic_integrals: Callable[[], ElasticIntegrals] | None = None,
        heat_integrals: Callable[[], HeatIntegrals] | None = None,
        stress_stiffness: StressStiffness | None = None, stiffened: Stiffened | None = None,
    ) -> None:
        """Adds a body and its floating frame; arguments as the fields of `BodyRecord`."""
        self._records.bodies.append(BodyRecord(
            self.origin, kernel, pose, moves, guide, elastic_integrals, heat_integrals,
            stress_stiffness, stiffened))

    def matrix(
        self, rows: str, columns: str, *, A: Csr | None = None, B: Csr | None = None,
        M: Csr | None = None,
    ) -> None:
        """Adds A x + B x' + M x'' to the rows of block `rows`; constant matrices (m, n), x:
        unknowns of block `columns`."""
        m, n = self._checked(rows), self._checked(columns)
        made = [None if X is None else csr_array(X) for X in (A, B, M)]
        for name, X in zip("ABM", made, strict=True):
            if X is not None and X.shape != (m, n):
                raise self._fault(f"{name} on ({rows}, {columns}) has shape {X.shape}, and the "
                                  f"blocks have ({m}, {n}) unknowns")
            if X is not None:
                self._check_numbers(X.data, f"{name} on ({rows}, {columns})")
        self._records.matrices.append(MatrixRecord(self.origin, rows, columns, *made))

    def vector(
        self, rows: str, w: FloatArray, amplitude: Amplitude | None = None, kind: Kind = "load"
    ) -> None:
        """Adds a load w f(t), w (m,), to the right-hand side; amplitude None: constant in time."""
        m = self._checked(rows)
        if w.shape != (m,):
            raise self._fault(f"a vector on {rows} has shape {w.shape}, and the block has {m} "
                              "unknowns")
        self._check_numbers(w, f"a vector on {rows}")
        load = self.over_steps(amplitude) if kind == "load" else amplitude
        self._records.vectors.append(VectorRecord(self.origin, rows, w, load, kind))

    def table(self, rows: str, load: LoadTable) -> None:
        """Adds a time-tabulated load to the right-hand side; load.columns (m, j)."""
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
        """Adds inertia, a force or an attachment to a body's floating frame. item: its equations;
        directions (n, p): vectors by which it acts on the n displacements, None: on none; C:
        forces = C^T multipliers of the block `multipliers`; reads: block of another body's rigid
        coordinates; generators: matrices of an inertia (`FrameRecord`)."""
        block = self.layout.of(body, Quantity.DISPLACEMENT)
        n = 0 if block is None else block.size
        P = np.zeros((n, 0)) if directions is None else directions
        self._records.frames.append(FrameRecord(  # over_steps: loads are means over the steps
            self.origin, body, self.over_steps(item), P, multipliers, C, reads,
            tuple(generators)))

    def local(self, blocks: Sequence[str], term: Term, *, together: bool = False) -> None:
        """Adds a term evaluated element by element, with rows and columns (positions in the state
        vector) in these blocks.

        A term on one temperature block, or on one elastic block and the temperatures of its body,
        is iterated within the step of that block; on displacements it must not depend on
        accelerations. together: solve for all unknowns simultaneously by Newton's method with the
        exact Jacobian instead, as for a stiff contact.
        """
        for block in blocks:
            self._checked(block)
        if not isinstance(term, Term):
            raise self._fault(f"its term {type(term).__name__} does not derive from "
                              "sparsemor.core.Term")
        inside = np.concatenate([NO_NUMBERS, *map(self.numbers, blocks)])
        for what, at in (("rows", term.rows), ("columns", term.columns)):
            if not np.isin(at, inside).all():
                raise self._fault(f"{what} of its term {type(term).__name__} are outside of the "
                                  f"blocks {', '.join(blocks)} that it names")
        if is_dataclass(term) and any(f.name == "source" for f in fields(term)):
            term = replace(term, source=self.origin.part)
        self._records.local.append(LocalRecord(self.origin, tuple(blocks), term, together))

    def constraint(self, block: str, targets: Sequence[Amplitude]) -> None:
        """Prescribes the values of a joint's constraint equations: sum of the contributions to its
        multiplier rows = targets(t), (l,)."""
        if self._checked(block) != len(targets):
            raise self._fault(f"{len(targets)} targets for the {self.size(block)} rows of {block}")
        self._records.constraints.append(ConstraintRecord(self.origin, block, tuple(targets)))

    def _checked(self, block: str) -> int:
        """Number of unknowns of a block. Raises InputError if the model does not have it."""
        if block not in self.layout:
            names = ", ".join(b.name for b in self.layout)
            raise self._fault(f"it writes into the block {block!r}, which the scene does not have: "
                              f"{names}")
        return self.size(block)

    def _check_numbers(self, values: FloatArray, what: str) -> None:
        """Raises InputError unless all values are finite real numbers."""
        if values.dtype.kind not in "fiub" or not np.isfinite(values).all():
            raise self._fault(f"{what} holds values that are not finite real numbers "
                              f"({values.dtype})")

    def _fault(self, text: str) -> InputError:
        return InputError(text, self.origin.key)
