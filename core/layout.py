"""Which unknown sits where in the one flat state vector."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

FieldName = Literal["rigid", "elastic", "thermal", "multiplier"]
FIELDS: tuple[FieldName, ...] = ("rigid", "elastic", "thermal", "multiplier")
ORDER: dict[FieldName, int] = {"rigid": 2, "elastic": 2, "thermal": 1, "multiplier": 0}
"""Order in time of the equations of a field: 0 means algebraic."""


@dataclass(frozen=True, slots=True)
class Block:
    """The unknowns of one field of one owner (a body or a joint)."""

    owner: str
    field: FieldName
    size: int

    @property
    def name(self) -> str:
        return f"{self.owner}.{self.field}"


class Layout:
    """Blocks in the order rigid, elastic, thermal, multiplier (stable within a field).

    The fields are contiguous, so an integrator treats second-order, first-order and algebraic
    unknowns as three slices.
    """

    def __init__(self, blocks: Iterable[Block]) -> None:
        given = [b for b in blocks if b.size > 0]
        self.blocks = tuple(b for f in FIELDS for b in given if b.field == f)
        self._slices: dict[str, slice] = {}
        start = 0
        for b in self.blocks:
            if b.name in self._slices:
                raise ValueError(f"two blocks are named {b.name}")
            self._slices[b.name] = slice(start, start + b.size)
            start += b.size
        self.size = start
        n2 = sum(b.size for b in self.blocks if ORDER[b.field] == 2)
        n1 = sum(b.size for b in self.blocks if ORDER[b.field] == 1)
        self.second, self.first = slice(0, n2), slice(n2, n2 + n1)
        self.algebraic = slice(n2 + n1, start)

    def __getitem__(self, name: str) -> slice:
        return self._slices[name]

    def __contains__(self, name: object) -> bool:
        return name in self._slices

    def __iter__(self) -> Iterator[Block]:
        return iter(self.blocks)

    def resized(self, sizes: dict[str, int]) -> "Layout":
        """The same blocks with other sizes: a reduced model's layout."""
        return Layout(Block(b.owner, b.field, sizes.get(b.name, b.size)) for b in self.blocks)
