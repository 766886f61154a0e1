"""Common interface of bodies, joints, contacts and loads; interface of load plugins; optional
methods."""

from collections.abc import Callable, Mapping, Sequence
from typing import Literal, Protocol, runtime_checkable

from sparsemor.core.notes import Note
from sparsemor.core.protocols.contributions import Equations
from sparsemor.core.protocols.layout import Block

Effect = Literal["motion", "temperature"]
"""Fields that a load or joint acts on: "motion" (and so temperatures too, if they are coupled), or
"temperature" alone."""


class Part(Protocol):
    """A built body, joint, contact or load: the numerical object made from one entry of the input.

    name: key of the entry. blocks: its own unknowns, one block per field. contribute: adds its
    terms to the equations.
    """

    @property
    def name(self) -> str: ...
    def blocks(self) -> Sequence[Block]: ...
    def contribute(self, equations: Equations) -> None:
        """Adds matrices, loads, forces and constraints to the equations of named blocks of unknowns
        (see `core.protocols.contributions`)."""
        ...


class LoadPlugin(Protocol):
    """Options of a load, from which `build` makes the load once the bodies are built. parts: bodies
    by name. InputError keys are relative to the load's own input entry (`on`)."""

    def build(self, name: str, parts: Mapping[str, Part]) -> "Load": ...


class Load(Part, Protocol):
    """A built load: terms of the equations without unknowns of its own; `blocks` is empty."""


@runtime_checkable
class HasNotes(Protocol):
    """A built body, joint, contact or load with warnings on valid but suspicious options."""

    @property
    def notes(self) -> tuple[Note, ...]: ...


@runtime_checkable
class LocalizesRows(Protocol):
    """A built joint, contact or load that states whether it acts on few rows only.

    Rows of a localized joint or load are always kept when rows are sampled. Without this property
    it counts as localized.
    """

    @property
    def localized(self) -> bool: ...


@runtime_checkable
class MovesOverBody(Protocol):
    """A built contact or load whose point of application moves over the body during the run.

    If `moving` is True, samplers with `required: ring` keep all rows of the elements along its
    path.
    """

    @property
    def moving(self) -> bool: ...


@runtime_checkable
class DeclaresEffect(Protocol):
    """A load or joint plugin that states whether it acts on the motion or on temperatures; without
    it, "motion".

    A rigid-body pre-simulation leaves out loads and joints that act on temperatures alone.
    """

    @property
    def acts_on(self) -> Effect: ...


@runtime_checkable
class HasSurroundings(Protocol):
    """A built load or residual term that ties a body to an ambient temperature, such as
    convection."""

    @property
    def surroundings(self) -> Callable[[float], float] | None:
        """Ambient temperature, K, as a function of time t, s; None if there is none."""
        ...
