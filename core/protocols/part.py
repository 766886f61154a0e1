"""Parts of a scene: loads, and what bodies, joints and contacts have in common with them."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Literal, Protocol, runtime_checkable

from sparsemor.core.notes import Note
from sparsemor.core.protocols.contributions import Equations
from sparsemor.core.protocols.layout import Block

Effect = Literal["motion", "temperature"]
"""What a load or joint acts on: the motion (and so the temperatures too, where they are coupled),
or temperatures alone."""


class Part(Protocol):
    """A built body, joint, contact or load: the numbers behind one entry of the scene.

    name: that of the entry. blocks: its own unknowns. contribute: its share of the equations.
    """

    @property
    def name(self) -> str: ...
    def blocks(self) -> Sequence[Block]: ...
    def contribute(self, equations: Equations) -> None:
        """Write the part's equations by the names of blocks (`core.protocols.contributions`)."""
        ...


class LoadPlugin(Protocol):
    """A load of the scene, built once its bodies are. InputError keys are relative to its own
    entry (`on`)."""

    def build(self, name: str, parts: Mapping[str, Part]) -> "Load": ...


class Load(Part, Protocol):
    """A built load: terms without unknowns of its own; `blocks` is empty."""


@runtime_checkable
class HasNotes(Protocol):
    """A built part with warnings on options that are legal and most likely a mistake."""

    @property
    def notes(self) -> tuple[Note, ...]: ...


@runtime_checkable
class LocalizesRows(Protocol):
    """A built joint, contact or load that states whether it acts on few rows.

    Rows of a localized part are kept when rows are sampled. Without this, a part is localized.
    """

    @property
    def localized(self) -> bool: ...


@runtime_checkable
class MovesOverBody(Protocol):
    """A built contact or load whose place on the body changes during the run.

    With moving = True, the elements along its path are kept with `required: ring`.
    """

    @property
    def moving(self) -> bool: ...


@runtime_checkable
class DeclaresEffect(Protocol):
    """A load or joint plugin that states what it acts on; without it, "motion".

    The rigid stage of a two-stage scene leaves out what acts on temperatures alone.
    """

    @property
    def acts_on(self) -> Effect: ...


@runtime_checkable
class HasSurroundings(Protocol):
    """A built part or local term that ties a body to a temperature, such as a film."""

    @property
    def surroundings(self) -> Callable[[float], float] | None:
        """That temperature, K, at time t, s; None for a part that has none."""
        ...


@runtime_checkable
class ReadsFiles(Protocol):
    """A plugin whose parts depend on files that its options name."""

    def files(self, base: Path) -> Sequence[Path]:
        """The files; base: folder of the scene."""
        ...
