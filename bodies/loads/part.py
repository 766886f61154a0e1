"""Built load: a name and a function that writes its contributions."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from sparsemor.core import Block, Equations, Note
from sparsemor.core.protocols.separable import Amplitude


@dataclass(frozen=True, slots=True, eq=False)
class LoadPart:
    """`write(equations)` contributes the load. localized: its rows are to be kept when rows
    are sampled; surroundings: the temperature (K) that it ties a body to, where it does; notes:
    warnings on its options."""

    name: str
    write: Callable[[Equations], None]
    localized: bool = True
    surroundings: Amplitude | None = None
    notes: tuple[Note, ...] = ()

    def blocks(self) -> Sequence[Block]:
        return ()

    def contribute(self, equations: Equations) -> None:
        self.write(equations)
