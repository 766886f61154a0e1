"""Common contract of built bodies, joints, contacts and loads."""

from abc import ABC, abstractmethod
from collections.abc import Sequence

from sparsemor.core.notes import Note
from sparsemor.core.protocols.contributions import Equations
from sparsemor.core.protocols.layout import Block


class Part(ABC):
    """A built body, joint, contact or load: the numerical object made from one entry of the input.

    name: key of the entry. blocks: its own unknowns, one block per field. contribute: adds its
    terms to the equations.
    """

    __slots__ = ()
    name: str

    def blocks(self) -> Sequence[Block]:
        """Its own unknowns, one block per field; by default none."""
        return ()

    @abstractmethod
    def contribute(self, equations: Equations) -> None:
        """Adds matrices, loads, forces and constraints to the equations of named blocks of unknowns
        (see `core.protocols.contributions`)."""

    @property
    def notes(self) -> tuple[Note, ...]:
        """Warnings on valid but suspicious options."""
        return ()
