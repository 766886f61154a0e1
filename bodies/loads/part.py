"""What every built load is: a name and a recipe for its terms."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from sparsemor.core.layout import Block, Layout
from sparsemor.core.notes import Note
from sparsemor.core.protocols import Part, Term
from sparsemor.core.separable import Amplitude


@dataclass(frozen=True, slots=True, eq=False)
class LoadPart:
    """`make(layout)` gives the terms. localized: its rows are to be kept when rows are sampled;
    surroundings: the temperature (K) that it ties a body to, where it does; notes: warnings on
    its options."""

    name: str
    make: Callable[[Layout], Sequence[Term]]
    localized: bool = True
    surroundings: Amplitude | None = None
    notes: tuple[Note, ...] = ()

    def blocks(self) -> Sequence[Block]:
        return ()

    def terms(self, layout: Layout, parts: Mapping[str, Part]) -> Sequence[Term]:
        return self.make(layout)
