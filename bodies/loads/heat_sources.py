"""Prescribed heat: flux into a surface that moves with the body, or produced inside a body."""

from collections.abc import Mapping
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from sparsemor.bodies.body_set import (
    find_body,
    find_surfaces,
    find_target,
    need_field,
    surface_notes,
)
from sparsemor.bodies.fem.integrals import scalar_mass, surface_load
from sparsemor.bodies.floating_body import FloatingBody
from sparsemor.bodies.loads.built_load import LoadPart, NumberOrFunction
from sparsemor.bodies.material import cells_of_set
from sparsemor.core import Effect, Equations, FloatArray, Gather, InputError, LoadPlugin, Part


class HeatFlux(LoadPlugin):
    """Heat flux: prescribed q into the body over the boundary facets of each set."""

    acts_on: ClassVar[Effect] = "temperature"  # a rigid-body pre-simulation leaves it out

    on: Annotated[list[str], Field(min_length=1)]
    """Surfaces `body:set`."""
    flux: NumberOrFunction
    """Heat flux, W/m^2, a number or a function of time; positive heats the body."""

    def build(self, name: str, parts: Mapping[str, Part]) -> LoadPart:
        loads = [(body, surface_load(mesh, facets, body.thickness))
                 for body, mesh, facets in find_surfaces(parts, self.on, "thermal")]

        def write(equations: Equations) -> None:
            for b, w in loads:
                b.heat_load(equations, w, self.flux.value)

        return LoadPart(name, write, notes=surface_notes(parts, name, self.on))


class HeatSource(LoadPlugin):
    """Heat source: heat produced in the volume of bodies or of their sets of cells, such as that of
    a current or a reaction: nodal heats, integral of q phi_i."""

    acts_on: ClassVar[Effect] = "temperature"  # a rigid-body pre-simulation leaves it out

    on: Annotated[list[str], Field(min_length=1)]
    """Bodies, or sets of cells `body:set`."""
    density: NumberOrFunction | None = None
    """Heat per volume q, W/m^3, a number or a function of time; positive heats the body."""
    power: NumberOrFunction | None = None
    """In place of `density`: total heat, W, spread evenly over the volume of all that is named."""

    def build(self, name: str, parts: Mapping[str, Part]) -> LoadPart:
        """Nodal heat of a density, W/m3, or of a total power, W, shared by volume: volumes of the
        nodes, m3, times the density, or times the power over the whole volume."""
        source = self.density or self.power
        if source is None or self.density is not None and self.power is not None:
            raise InputError("give either a density, W/m^3, or the total power, W",
                             "density" if source is None else "power")
        gather = Gather()
        found = [gather("", _volume, parts, text, f"on.{i}") for i, text in enumerate(self.on)]
        gather.check()
        volumes = [v for v in found if v is not None]
        whole = 1.0 if self.power is None else sum(float(w.sum()) for _, w in volumes)

        def write(equations: Equations) -> None:
            for body, weights in volumes:
                body.heat_load(equations, weights / whole, source.value)

        return LoadPart(name, write, localized=False)


def _volume(parts: Mapping[str, Part], text: str, key: str) -> tuple[FloatingBody, FloatArray]:
    """The body of `body` or `body:set`, and the volume (N,), m^3, that belongs to each of its nodes
    in all cells or in those of the set: row sums of the mass matrix of density 1."""
    name, _, which = text.partition(":")
    body = find_body(parts, name, key)
    if not isinstance(body, FloatingBody) or body.mesh is None:
        raise InputError(f"body {name!r} has no mesh, and so no volume to integrate over", key)
    need_field(body, "thermal", key)
    cells = None
    if which:
        find_target(parts, text, key)
        cells = np.flatnonzero(cells_of_set(body.mesh, which))
        if not len(cells):
            raise InputError(f"{text!r} has no cells", key)
    return body, np.asarray(scalar_mass(body.mesh, body.thickness, cells).sum(axis=1)).ravel()
