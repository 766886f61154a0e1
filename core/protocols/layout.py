"""Kinds of fields, blocks of unknowns, and their layout in the state vector."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from enum import Enum
from typing import Any, Literal

import numpy as np

from sparsemor.core.arrays import IntArray
from sparsemor.core.protocols.poses import FREE_POSE, QUATERNION


class Quantity(Enum):
    """Physical meaning of a block's unknowns.

    POSE: rigid coordinates of a body frame (`protocols/poses.py`); DISPLACEMENT: displacement
    components in body axes at mesh nodes, m; TEMPERATURE: temperatures at mesh nodes, K; OTHER: any
    other.
    """

    POSE = "pose"
    DISPLACEMENT = "displacement"
    TEMPERATURE = "temperature"
    OTHER = "other"


@dataclass(frozen=True, slots=True)
class FieldKind:
    """Kind of a field of unknowns, such as elastic displacements, temperatures or multipliers.

    name: last part of block names (`owner.name`), also used in options and error tables.
    order: order in time of its equations; 2: M x'' = f, 1: C x' = f, 0: algebraic (multipliers).
    unit: of the unknowns, separated by commas where they differ.
    quantity: physical meaning.
    reducible: True if the block can be replaced by a trial basis.
    title: name in figures; empty: `name`.
    scale: a large change, in `unit`; default reference of the error control of the time step.
    smallest: least magnitude of an unknown in finite differences, in `unit`.
    change: finite-difference step relative to the largest unknown of the block, of a pose relative
    to `smallest`.
    central: True for fourth-order central differences, False for one-sided ones.
    """

    name: str
    order: Literal[0, 1, 2]
    unit: str
    quantity: Quantity = Quantity.OTHER
    reducible: bool = False
    title: str = ""
    scale: float = 1.0
    smallest: float = 1.0
    change: float = 1e-4
    central: bool = False

    def __post_init__(self) -> None:
        if not self.name.isidentifier():
            raise ValueError(f"the name of a field must be one word (got {self.name!r})")
        if self.order not in (0, 1, 2):
            raise ValueError(f"field {self.name}: the order in time is 0, 1 or 2")
        if self.reducible and self.order == 0:
            raise ValueError(f"field {self.name}: algebraic unknowns cannot be reduced")

    @property
    def label(self) -> str:
        """Name in figures."""
        return self.title or self.name

    def plain(self) -> dict[str, object]:
        """Dictionary of plain data from which `of_plain` restores the kind."""
        return asdict(self) | {"quantity": self.quantity.value}

    @classmethod
    def of_plain(cls, data: Mapping[str, Any]) -> "FieldKind":
        return cls(**{**data, "quantity": Quantity(data["quantity"])})


def ordered(kinds: Iterable[FieldKind]) -> tuple[FieldKind, ...]:
    """Distinct kinds of fields by decreasing order in time; among equal orders, irreducible kinds
    first."""
    return tuple(sorted(dict.fromkeys(kinds), key=lambda k: (-k.order, k.reducible)))


@dataclass(frozen=True, slots=True)
class Block:
    """Block of `size` unknowns: one field of one owner (a body or a joint)."""

    owner: str
    kind: FieldKind
    size: int

    @property
    def field(self) -> str:
        """Name of the kind of field."""
        return self.kind.name

    @property
    def name(self) -> str:
        return f"{self.owner}.{self.kind.name}"

    def resized(self, size: int) -> "Block":
        """The same block with `size` unknowns."""
        return Block(self.owner, self.kind, size)


class Layout:
    """Layout of all blocks of unknowns in one state vector, by decreasing order in time.

    Second-order, first-order and algebraic unknowns are three contiguous slices `second`, `first`,
    `algebraic`; `frames` is the slice of the leading second-order unknowns that are never reduced,
    the rigid coordinates. kinds: kinds of fields of all blocks, including empty blocks, which are
    left out otherwise.
    """

    def __init__(self, blocks: Iterable[Block]) -> None:
        """Raises ValueError for two blocks, or two kinds of field, of one name."""
        given = list(blocks)
        self.kinds = ordered([b.kind for b in given])
        names = [k.name for k in self.kinds]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"two kinds of field are named {name}")
        self.blocks = tuple([b for kind in self.kinds for b in given
                             if b.kind == kind and b.size > 0])
        self._named: dict[str, Block] = {}
        self._slices: dict[str, slice] = {}
        self._first_of: dict[tuple[str, Quantity], Block] = {}
        start = 0
        for b in self.blocks:
            name = b.name
            if name in self._named:
                raise ValueError(f"two blocks are named {name}")
            self._named[name], self._slices[name] = b, slice(start, start + b.size)
            self._first_of.setdefault((b.owner, b.kind.quantity), b)
            start += b.size
        self.size = start
        n2 = sum([b.size for b in self.blocks if b.kind.order == 2])
        n1 = sum([b.size for b in self.blocks if b.kind.order == 1])
        self.second, self.first = slice(0, n2), slice(n2, n2 + n1)
        self.algebraic = slice(n2 + n1, start)
        self.reducible = tuple([b.name for b in self.blocks if b.kind.reducible])
        """Names of the blocks whose unknowns may be combinations of atoms."""
        self.quaternions = tuple([
            self._slices[name].stop - QUATERNION for name, b in self._named.items()
            if b.kind.quantity is Quantity.POSE and b.size == FREE_POSE])
        """First unknown of each unit quaternion, the last four coordinates of a free frame."""
        # they come first: `ordered` has irreducible kinds before others of the same order
        self.frames = slice(0, sum([
            b.size for b in self.blocks if b.kind.order == 2 and not b.kind.reducible]))

    def parts(self) -> tuple[list[Block]]:
        """Blocks from which `of_parts` makes an equal layout."""
        return ([*(Block("", kind, 0) for kind in self.kinds), *self.blocks],)

    @classmethod
    def of_parts(cls, blocks: Iterable[Block]) -> "Layout":
        return cls(blocks)

    def __getitem__(self, name: str) -> slice:
        return self._slices[name]

    def __contains__(self, name: object) -> bool:
        return name in self._slices

    def __iter__(self) -> Iterator[Block]:
        return iter(self.blocks)

    def containing(self, numbers: IntArray) -> tuple[str, ...]:
        """Names of the blocks that contain the given positions of the state vector, in layout
        order."""
        starts = [at.start for at in self._slices.values()]
        found = np.unique(np.searchsorted(starts, numbers, "right") - 1)
        names = [*self._named]
        return tuple([names[i] for i in found.tolist()])

    @property
    def differential(self) -> tuple[Block, ...]:
        """Blocks whose unknowns have time derivatives: all but the algebraic ones (multipliers)."""
        return tuple(b for b in self.blocks if b.kind.order > 0)

    def block(self, name: str) -> Block:
        """Block of this name; KeyError if there is none."""
        return self._named[name]

    def of(self, owner: str, quantity: Quantity) -> Block | None:
        """First block of an owner (body or joint) with this physical meaning, None if there is
        none."""
        return self._first_of.get((owner, quantity))

    def name_of(self, owner: str, quantity: Quantity) -> str:
        """Name of the first block of an owner with this physical meaning, "" if there is none."""
        block = self.of(owner, quantity)
        return "" if block is None else block.name

    def numbers(self, name: str) -> IntArray:
        """Positions of a block's unknowns in the state vector; empty if there is no such block."""
        at = self._slices.get(name, slice(0, 0))
        return np.arange(at.start, at.stop)

    def multipliers(self, owner: str) -> Block | None:
        """First algebraic block of an owner, the multipliers of a joint; None if there is none."""
        return next((b for b in self.blocks if b.owner == owner and b.kind.order == 0), None)

    def resized(self, sizes: Mapping[str, int]) -> "Layout":
        """Layout of a reduced model: the same blocks with new numbers of unknowns, `sizes` by block
        name."""
        return Layout([b.resized(sizes.get(b.name, b.size)) for b in self.parts()[0]])


def joints_with_forces(layout: Layout) -> tuple[str, ...]:
    """Names of the joints whose constraint forces (Lagrange multipliers) are unknowns. The
    multiplier that keeps a quaternion at unit length does not belong to a joint."""
    return tuple(b.owner for b in layout
                 if b.kind.order == 0 and layout.of(b.owner, Quantity.POSE) is None)
