"""Prescribed temperature: the nodes of a set follow a function of time and are no unknowns."""

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np

from sparsemor.bodies.body import Body
from sparsemor.bodies.loads.amplitude import NumberOrFunction
from sparsemor.bodies.loads.part import LoadPart
from sparsemor.bodies.targets import find_target, need_field
from sparsemor.core import Effect, Equations, InputError, Part, Plugin


class PrescribedTemperature(Plugin):
    """Prescribed temperature T(t) on sets of nodes, imposed by elimination of these unknowns."""

    acts_on: ClassVar[Effect] = "temperature"

    on: list[str]
    """Sets `body:set`."""
    temperature: NumberOrFunction
    """Temperature, K, a number or a function of time."""

    def build(self, name: str, parts: Mapping[str, Part]) -> LoadPart:
        bodies: dict[str, Body] = {}
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
        return LoadPart(name, _nothing, adjusted=bodies, surroundings=self.temperature.value)


def _nothing(equations: Equations) -> None:
    """No contribution: the bodies add the effect of their prescribed temperatures."""
