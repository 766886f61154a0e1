"""Load of a scene: a name and a function that adds its contributions to the equations."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from sparsemor.core import Amplitude, Body, Equations, Load, Note


@dataclass(frozen=True, slots=True, eq=False)
class LoadPart(Load):
    """Load of a scene; `write(equations)` adds it to the equations.

    localized: hyper-reduction keeps its rows; surroundings: temperature (K) of a heat exchange, or
    prescribed temperature, if any; notes: warnings on its options; adjusted: bodies that it
    replaces by modified ones.
    """

    name: str
    write: Callable[[Equations], None]
    localized: bool = True
    surroundings: Amplitude | None = None
    notes: tuple[Note, ...] = ()
    adjusted: Mapping[str, Body] = field(default_factory=dict)

    def contribute(self, equations: Equations) -> None:
        self.write(equations)
