"""Built load: a name and a function that writes its contributions."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from sparsemor.core import Amplitude, Block, Equations, Note, Part


@dataclass(frozen=True, slots=True, eq=False)
class LoadPart:
    """`write(equations)` contributes the load. localized: its rows are to be kept when rows
    are sampled; surroundings: the temperature (K) that it ties a body to, where it does; notes:
    warnings on its options; adjusted: bodies that it replaces."""

    name: str
    write: Callable[[Equations], None]
    localized: bool = True
    surroundings: Amplitude | None = None
    notes: tuple[Note, ...] = ()
    adjusted: Mapping[str, Part] = field(default_factory=dict)

    def blocks(self) -> Sequence[Block]:
        return ()

    def contribute(self, equations: Equations) -> None:
        self.write(equations)
