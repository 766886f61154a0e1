"""Base class of joints between two sides."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

from pydantic import Field

from sparsemor.bodies.joints.conditions import Conditions, conditions_between
from sparsemor.bodies.joints.heat import heat_exchange
from sparsemor.bodies.joints.part import JointPart
from sparsemor.core import JointPlugin, Part


class Between(JointPlugin):
    """Base class of joints between two of `body:set` and `ground`.

    dimensions: dimensions in which the joint exists, 2 in the plane and 3 in space; relative:
    dimensions in which it constrains directions or lines, for which two flexible sides need an
    intermediate massless frame.
    """

    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    relative: ClassVar[tuple[int, ...]] = ()

    between: tuple[str, str]
    """The two sides of the joint: each a set `body:set`, or `ground`."""
    conductance: float | None = Field(default=None, ge=0.0)
    """Thermal conductance G, W/K, of a joint of two bodies with temperatures: the heat flow is
    G (T_1 - T_2), T_i the mean temperatures of the sets. No heat flows for 0, or when not given,
    which is noted."""

    def build(self, name: str, parts: Mapping[str, Part]) -> JointPart:
        conditions = conditions_between(name, self.between, parts, dimensions=self.dimensions,
                                        relative=self.relative)
        self.constrain(conditions)
        exchange, notes = heat_exchange(name, conditions.ends, self.conductance, parts)
        return replace(conditions.joint(), exchange=exchange, notes=notes)

    @abstractmethod
    def constrain(self, sides: Conditions) -> None:
        """Adds the constraints of the joint."""
