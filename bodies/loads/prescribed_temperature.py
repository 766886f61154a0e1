"""Prescribed temperature: the nodes of a set follow a function of time and are no unknowns."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from sparsemor.bodies.body import FloatingBody
from sparsemor.bodies.loads.part import NumberOrFunction
from sparsemor.bodies.targets import find_target, need_field
from sparsemor.core import (
    Amplitude,
    Body,
    Effect,
    Equations,
    InputError,
    Joint,
    JointPlugin,
    Part,
)


@dataclass(frozen=True, slots=True, eq=False)
class HeldTemperature(Joint):
    """Prescribed temperature: adds nothing itself; the bodies that it replaces add its effect."""

    name: str
    adjusted: Mapping[str, Body]
    surroundings: Amplitude

    def contribute(self, equations: Equations) -> None:
        """No contribution: the bodies add the effect of their prescribed temperatures."""


class PrescribedTemperature(JointPlugin):
    """Prescribed temperature T(t) on sets of nodes, imposed by elimination of these unknowns."""

    acts_on: ClassVar[Effect] = "temperature"

    on: list[str]
    """Sets `body:set`."""
    temperature: NumberOrFunction
    """Temperature, K, a number or a function of time."""

    def build(self, name: str, parts: Mapping[str, Part]) -> HeldTemperature:
        bodies: dict[str, FloatingBody] = {}
        for i, text in enumerate(self.on):
            target = find_target({**parts, **bodies}, text, f"on.{i}")
            need_field(target.body, "thermal", f"on.{i}")
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
        return HeldTemperature(name, bodies, self.temperature.value)
