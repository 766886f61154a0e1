"""Prescribed temperature: the nodes of a set follow a function of time and are no unknowns."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from pydantic import model_validator

from sparsemor.bodies.body_set import find_body, find_target, need_field
from sparsemor.bodies.floating_body import FloatingBody
from sparsemor.bodies.loads.built_load import NumberOrFunction
from sparsemor.bodies.temperature_file import TemperatureFile
from sparsemor.core import (
    Amplitude,
    Body,
    Effect,
    Equations,
    FloatArray,
    InputError,
    IntArray,
    Joint,
    JointPlugin,
    Note,
    Part,
    TimeFunction,
    information,
)


@dataclass(frozen=True, slots=True, eq=False)
class HeldTemperature(Joint):
    """Prescribed temperature: adds nothing itself; the bodies that it replaces add its effect."""

    name: str
    adjusted: Mapping[str, Body]
    surroundings: Amplitude | None
    notes: tuple[Note, ...] = ()

    def contribute(self, equations: Equations) -> None:
        """No contribution: the bodies add the effect of their prescribed temperatures."""


class PrescribedTemperature(JointPlugin):
    """Prescribed temperature T(t) on sets of nodes or in whole bodies, imposed by elimination of
    these unknowns."""

    acts_on: ClassVar[Effect] = "temperature"

    on: list[str]
    """Sets `body:set`, or bodies with an elastic field."""
    temperature: NumberOrFunction | None = None
    """Temperature, K, a number or a function of time."""
    field: TemperatureFile | None = None
    """In place of `temperature`: temperatures of a file, at points (axes of the body) and times."""

    @model_validator(mode="after")
    def _one(self) -> Self:
        if (self.temperature is None) is (self.field is None):
            raise ValueError("give either a temperature, K, or the field of a file")
        return self

    def build(self, name: str, parts: Mapping[str, Part]) -> HeldTemperature:
        """Bodies without the unknowns of these nodes, whose temperature is given: copies with less
        `free` temperatures and more `prescribed` ones (nodes, function of time, values at the
        nodes), which replace those of the scene. Several sets of a body: each starts from the copy
        before."""
        bodies: dict[str, FloatingBody] = {}
        notes: list[Note] = []
        for i, text in enumerate(self.on):
            body, nodes = self._place({**parts, **bodies}, text, f"on.{i}")
            need_field(body, "thermal", f"on.{i}")
            heat = body.heat
            assert heat is not None
            taken = np.setdiff1d(nodes, heat.free)
            if len(taken):
                raise InputError(f"{len(taken)} nodes of {text!r} have a prescribed temperature "
                                 "already", f"on.{i}")
            free = np.setdiff1d(heat.free, nodes)
            if not len(free) and body.elasticity is None:
                raise InputError(f"with {text!r} the temperature of every node of "
                                 f"{body.name!r} is prescribed, so that none is left to "
                                 "solve for: prescribe fewer nodes, or refine the mesh", f"on.{i}")
            given = tuple((nodes, f, shape) for f, shape in self._given(name, body, nodes, notes))
            bodies[body.name] = replace(body, heat=replace(
                heat, free=free, prescribed=(*heat.prescribed, *given)))
        return HeldTemperature(name, bodies, None if self.temperature is None else (
            self.temperature.value), tuple(notes))

    def _place(
        self, parts: Mapping[str, Part], text: str, key: str
    ) -> tuple[FloatingBody, IntArray]:
        """The body, and the nodes of the set, all of them where there is no set."""
        if ":" in text:
            target = find_target(parts, text, key)
            return target.body, target.nodes
        body = find_body(parts, text, key)
        if not isinstance(body, FloatingBody):
            raise InputError(f"body {text!r} has no nodes: name a body with a mesh", key)
        return body, np.arange(len(body.X))

    def _given(
        self, name: str, body: FloatingBody, nodes: IntArray, notes: list[Note]
    ) -> list[tuple[TimeFunction, FloatArray]]:
        """Functions of time and their shapes (n,) at the n nodes, whose products add up to the
        temperatures there; adds a note on the distance from the points of a file to `notes`."""
        if self.temperature is not None:
            return [(self.temperature, np.ones(len(nodes)))]
        assert self.field is not None
        try:
            found = self.field.at(body.folder, body.X[nodes], body.extent)
        except InputError as error:
            raise error.under("field") from None
        notes.append(information(
            f"joints.{name}: nodes of {body.name} are up to {found.distance:.3g} m from the "
            f"nearest point of {self.field.path}", "temperature_file"))
        return found.separated()
