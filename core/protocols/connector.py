"""Common contracts of joints, contacts and loads, and those of loads."""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Literal

from sparsemor.core.protocols.body import Body, Part
from sparsemor.core.protocols.plugin import Plugin

Effect = Literal["motion", "temperature"]
"""Fields that a load or joint acts on: "motion" (and so temperatures too, if they are coupled), or
"temperature" alone."""


class Connector(Part):
    """A built joint, contact or load."""

    __slots__ = ()

    @property
    def localized(self) -> bool:
        """True if it acts on few rows only, which are then always kept when rows are sampled."""
        return True

    @property
    def moving(self) -> bool:
        """True if its point of application moves over the body during the run: samplers with
        `required: ring` then keep all rows of the elements along its path."""
        return False

    @property
    def adjusted(self) -> Mapping[str, Body]:
        """Body name -> modified body that replaces it, such as one with prescribed temperatures."""
        return {}

    @property
    def surroundings(self) -> Callable[[float], float] | None:
        """Ambient temperature, K, to which it ties a body, as a function of time t, s; None if
        there is none."""
        return None


class ConnectorPlugin(Plugin):
    """Options of a joint, contact or load."""

    @abstractmethod
    def build(self, name: str, parts: Mapping[str, Part]) -> Connector:
        """Joint, contact or load `name`, once the bodies `parts` are built, by name. InputError
        keys are relative to its own input entry (`on`, `between`)."""

    @property
    def acts_on(self) -> Effect:
        """Fields that it acts on. A rigid-body pre-simulation leaves out what acts on temperatures
        alone."""
        return "motion"


class Load(Connector):
    """A built load: terms of the equations without unknowns of its own; `blocks` is empty."""

    __slots__ = ()


class LoadPlugin(ConnectorPlugin):
    """Options of a load, from which `build` makes the load once the bodies are built."""

    @abstractmethod
    def build(self, name: str, parts: Mapping[str, Part]) -> Load: ...

    @property
    def levels(self) -> tuple[str, ...]:
        """Options whose function of time is a level, such as an ambient temperature, and not an
        amplitude that is 0 where the load does not act."""
        return ()

