"""Kinds of fields, blocks of unknowns, and their places in the one flat state vector."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from enum import Enum
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np

from sparsemor.core.arrays import IntArray


class Quantity(Enum):
    """Meaning of a block's entries, for whoever places, draws or exports a body.

    POSE: frame of a body (`protocols/poses.py`); DISPLACEMENT: components of a vector in body axes
    at mesh nodes, m; TEMPERATURE: a scalar at mesh nodes, K; OTHER: nothing of these.
    """

    POSE = "pose"
    DISPLACEMENT = "displacement"
    TEMPERATURE = "temperature"
    OTHER = "other"


@dataclass(frozen=True, slots=True)
class FieldKind:
    """Kind of unknowns that make a block: name, order in time and unit of a field.

    name: last part of block names (`owner.name`), key of options and columns of errors.
    order: of the equations in time; 2: M x'' = f, 1: C x' = f, 0: algebraic (multipliers).
    unit: of the entries, separated by commas where they differ.
    quantity: meaning of the entries.
    reducible: whether a reducer may replace the block by a trial basis.
    title: name in pictures; the kind's name where it is empty.
    scale: change that counts as large, in `unit`: default of `time.control`.
    smallest: least size of an unknown in finite differences, in `unit`.
    change: difference step relative to the largest unknown of the block.
    central: whether differences are central ones of fourth order, else one-sided.
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
        """Name in pictures."""
        return self.title or self.name

    def plain(self) -> dict[str, object]:
        """Plain data that `of_plain` reads."""
        return asdict(self) | {"quantity": self.quantity.value}

    @classmethod
    def of_plain(cls, data: Mapping[str, Any]) -> "FieldKind":
        return cls(**{**data, "quantity": Quantity(data["quantity"])})


def ordered(kinds: Iterable[FieldKind]) -> tuple[FieldKind, ...]:
    """Kinds by falling order in time; of equal order those that are never reduced come first, then
    as given, each once."""
    return tuple(sorted(dict.fromkeys(kinds), key=lambda k: (-k.order, k.reducible)))


@runtime_checkable
class DeclaresFields(Protocol):
    """Optional ability of a body plugin: the kinds of field that its bodies may have, known before
    one is built. Tables of studies have columns for these."""

    @property
    def field_kinds(self) -> tuple[FieldKind, ...]: ...


def declared_kinds(plugins: Iterable[object]) -> tuple[FieldKind, ...]:
    """Kinds that these body plugins declare, as `ordered` has them."""
    return ordered(k for p in plugins if isinstance(p, DeclaresFields) for k in p.field_kinds)


@dataclass(frozen=True, slots=True)
class Block:
    """The unknowns of one field of one owner (a body or a joint)."""

    owner: str
    kind: FieldKind
    size: int

    @property
    def field(self) -> str:
        """Name of its kind."""
        return self.kind.name

    @property
    def name(self) -> str:
        return f"{self.owner}.{self.kind.name}"

    def resized(self, size: int) -> "Block":
        """The same block with `size` unknowns."""
        return Block(self.owner, self.kind, size)


class Layout:
    """Blocks in the order of their kinds (`ordered`), stable within a kind. `kinds` are those of
    all given blocks, of empty ones too, which are left out of the layout.

    Blocks of one order are contiguous, so an integrator treats second-order, first-order and
    algebraic unknowns as three slices. `frames` are the leading second-order unknowns that are
    never reduced: the poses of bodies.
    """

    def __init__(self, blocks: Iterable[Block]) -> None:
        given = list(blocks)
        self.kinds = ordered(b.kind for b in given)
        names = [k.name for k in self.kinds]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"two kinds of field are named {name}")
        self.blocks = tuple(b for kind in self.kinds for b in given
                            if b.kind == kind and b.size > 0)
        self._slices: dict[str, slice] = {}
        start = 0
        for b in self.blocks:
            if b.name in self._slices:
                raise ValueError(f"two blocks are named {b.name}")
            self._slices[b.name] = slice(start, start + b.size)
            start += b.size
        self.size = start
        n2 = sum(b.size for b in self.blocks if b.kind.order == 2)
        n1 = sum(b.size for b in self.blocks if b.kind.order == 1)
        self.second, self.first = slice(0, n2), slice(n2, n2 + n1)
        self.algebraic = slice(n2 + n1, start)
        self.frames = slice(0, sum(
            b.size for b in self.blocks if b.kind.order == 2 and not b.kind.reducible))

    def __getitem__(self, name: str) -> slice:
        return self._slices[name]

    def __contains__(self, name: object) -> bool:
        return name in self._slices

    def __iter__(self) -> Iterator[Block]:
        return iter(self.blocks)

    def containing(self, numbers: IntArray) -> tuple[str, ...]:
        """Names of the blocks that positions of the state vector are in, in their order."""
        starts = [self[b.name].start for b in self.blocks]
        found = np.unique(np.searchsorted(starts, numbers, "right") - 1)
        return tuple(self.blocks[i].name for i in found.tolist())

    @property
    def differential(self) -> tuple[Block, ...]:
        """Blocks with rates: all but the algebraic ones."""
        return tuple(b for b in self.blocks if b.kind.order > 0)

    def block(self, name: str) -> Block:
        """The block of this name. Raises KeyError."""
        for b in self.blocks:
            if b.name == name:
                return b
        raise KeyError(name)

    def of(self, owner: str, quantity: Quantity) -> Block | None:
        """The first block of an owner whose entries mean `quantity`; None where it has none."""
        return next((b for b in self.blocks
                     if b.owner == owner and b.kind.quantity is quantity), None)

    def name_of(self, owner: str, quantity: Quantity) -> str:
        """Name of that block, "" where it has none."""
        block = self.of(owner, quantity)
        return "" if block is None else block.name

    def numbers(self, name: str) -> IntArray:
        """Positions of a block's unknowns in the state vector, none where there is no such block.
        """
        at = self._slices.get(name, slice(0, 0))
        return np.arange(at.start, at.stop)

    def multipliers(self, owner: str) -> Block | None:
        """The first algebraic block of an owner, None where it has none."""
        return next((b for b in self.blocks if b.owner == owner and b.kind.order == 0), None)

    def resized(self, sizes: Mapping[str, int]) -> "Layout":
        """The same blocks with other sizes: a reduced model's layout."""
        return Layout([*(Block("", kind, 0) for kind in self.kinds),
                       *(b.resized(sizes.get(b.name, b.size)) for b in self.blocks)])
