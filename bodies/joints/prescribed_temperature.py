"""Prescribed temperature: the nodes of a set follow a function of time, and cost no unknowns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from sparsemor.bodies.any_body import AnyBody
from sparsemor.bodies.loads.amplitude import Quantity
from sparsemor.bodies.targets import find_target, need_field
from sparsemor.core.errors import InputError
from sparsemor.core.layout import Block, Layout
from sparsemor.core.plugin import Plugin
from sparsemor.core.protocols import Part, Term
from sparsemor.core.separable import Amplitude


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """Stands in the scene for nodes whose temperatures are given; `adjusted` are its bodies."""

    name: str
    adjusted: Mapping[str, AnyBody]
    localized: bool = True
    surroundings: Amplitude | None = None

    def blocks(self) -> Sequence[Block]:
        return ()

    def terms(self, layout: Layout, parts: Mapping[str, Part]) -> Sequence[Term]:
        return ()


class PrescribedTemperature(Plugin):
    """T = T(t) on sets of nodes: eliminated, its rate enters the rows beside it."""

    acts_on: ClassVar[str] = "thermal"

    on: list[str]
    """Sets `body:set`."""
    temperature: Quantity
    """Temperature, K, a number or a function of time."""

    def build(self, name: str, parts: Mapping[str, Part]) -> Held:
        bodies: dict[str, AnyBody] = {}
        for i, text in enumerate(self.on):
            target = find_target({**parts, **bodies}, text, f"on.{i}")
            need_field(target, "thermal", f"on.{i}")
            heat = target.body.heat
            assert heat is not None
            taken = np.setdiff1d(target.nodes, heat.free)
            if len(taken):
                raise InputError(f"{len(taken)} nodes of {text!r} have a prescribed temperature "
                                 "already", f"on.{i}")
            free = np.setdiff1d(heat.free, target.nodes)
            if not len(free):
                raise InputError(f"with {text!r} the temperature of every node of "
                                 f"{target.body.name!r} is prescribed, so that none is left to "
                                 "solve for: prescribe fewer nodes, or refine the mesh", f"on.{i}")
            bodies[target.body.name] = replace(target.body, heat=replace(
                heat, free=free, prescribed=(*heat.prescribed, (target.nodes, self.temperature))))
        return Held(name, bodies, surroundings=self.temperature.value)
