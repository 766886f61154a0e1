"""Polygonal contact: two surfaces made of facets, pressure and friction per area between them."""

from collections.abc import Mapping
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from sparsemor.bodies.body_part import PlanarBody
from sparsemor.bodies.contact.part import ContactPart
from sparsemor.bodies.contact.quadrature import enough_points, gauss
from sparsemor.bodies.contact.start import check_start
from sparsemor.bodies.contact.surface import Near, Surface
from sparsemor.bodies.contact.tractions import Interface
from sparsemor.bodies.targets import find_target
from sparsemor.core.errors import Fault, Gather, InputError
from sparsemor.core.plugin import Plugin
from sparsemor.core.protocols import FrictionLaw, NormalLaw, Part
from sparsemor.core.slot import Slot


class SurfaceHeat(Plugin):
    """Heat between the surfaces. What enters the bodies is the friction power, no more, no less."""

    share: Annotated[float, Field(ge=0, le=1)] | Literal["effusivity"] = "effusivity"
    """Part of the friction heat that enters the first body: a number, or by the effusivities
    sqrt(k rho c) of the two materials."""
    conductance: float = Field(default=0.0, ge=0)
    """Conductance between the surfaces where they touch, W/(m2 K)."""


class Polygonal(Plugin):
    """Surfaces that press on and rub against each other; all laws are per area (Pa, N/m3, W/m2).

    The first surface is integrated over. Penetration and slip are those along the nearest facet of
    the second. Both bodies need a mesh: a rigid one is a flexible body with `fields: []`.
    """

    between: tuple[str, str]
    """The two surfaces `body:set`, of different bodies."""
    normal: Annotated[NormalLaw, Slot("normal_law")]
    """Pressure as a function of penetration and its rate."""
    friction: Annotated[FrictionLaw, Slot("friction_law")] | None = None
    """Friction traction as a function of pressure and slip; none when not given."""
    heat: SurfaceHeat | None = None
    """Heat of friction and conduction, for bodies with a thermal field; none when not given."""
    surfaces: Literal["rigid", "deformed"] = "rigid"
    """Where the surfaces are: `rigid`, carried by the frames alone, or `deformed`, moved by the
    displacements too."""
    tolerance: float = Field(default=1e-6, gt=0, lt=0.1)
    """Part of the resultants that quadrature may leave open, Gauss points being added until twice
    as many change less."""

    def build(self, name: str, parts: Mapping[str, Part]) -> ContactPart:
        first, second = self._surfaces(parts)
        self._check_motion(first.body, second.body)
        check_start(first, second)
        points, weights = gauss(enough_points(self.normal, self.friction, self.tolerance))
        width = min(first.body.thickness, second.body.thickness)
        conductance = 0.0 if self.heat is None else self.heat.conductance
        face = Interface(self.normal, self.friction, width, self._share(first.body, second.body),
                         conductance, points, weights)
        # half a facet: farther in, the nearest facet is not the one that was crossed
        reach = 0.5 * float(min(first.sizes.min(), second.sizes.min()))
        return ContactPart(name, first, second, face, Near.of(first, second, reach), reach,
                           self.surfaces == "deformed", self.heat is not None)

    def _surfaces(self, parts: Mapping[str, Part]) -> tuple[Surface, Surface]:
        def find(text: str, key: str) -> Surface:
            target = find_target(parts, text, key)
            body = target.body
            if not isinstance(body, PlanarBody):
                raise InputError(f"{text!r}: body {body.name!r} is in space, and the surfaces of "
                                 "this contact are the outlines of plane bodies", key)
            if body.mesh is None:
                raise InputError(
                    f"{text!r}: body {body.name!r} has no mesh, so it has no surface that "
                    "could touch; give its shape as a flexible body with `fields: []`", key)
            return Surface.of(body, target.facets(key))

        gather = Gather()
        found = [gather("", find, text, f"between.{i}") for i, text in enumerate(self.between)]
        gather.check()
        first, second = (s for s in found if s is not None)
        if first.body.name == second.body.name:
            raise InputError(f"both surfaces are on body {first.body.name!r}: contact of a body "
                             "with itself is not looked for", "between")
        return first, second

    def _check_motion(self, first: PlanarBody, second: PlanarBody) -> None:
        bodies = (first, second)
        if self.surfaces == "deformed" and all(b.elasticity is None for b in bodies):
            raise InputError("neither body has an elastic field, so no surface deforms: take "
                             "`rigid`, or add `elastic` to the fields of a body", "surfaces")
        if self.heat is None or all(b.heat is None for b in bodies):
            return
        lacking = [b.name for b in bodies if b.heat is None]
        if not lacking:
            return
        faults = []
        if self.heat.share == "effusivity":
            faults.append(Fault("heat.share", f"body {lacking[0]!r} has no thermal field, so its "
                                "effusivity is not known: give the first body's share as a number, "
                                "or add `thermal` to its fields"))
        if self.heat.conductance > 0:
            faults.append(Fault("heat.conductance", f"body {lacking[0]!r} has no thermal field: "
                                "add `thermal` to its fields, or leave the conductance out"))
        if faults:
            raise InputError(faults)

    def _share(self, first: PlanarBody, second: PlanarBody) -> float:
        if self.heat is None:
            return 0.0
        if self.heat.share != "effusivity":
            return self.heat.share
        if first.heat is None or second.heat is None:
            return 0.5  # a stage without temperatures: no heat enters
        a, b = (effusivity(body) for body in (first, second))
        return a / (a + b)


def effusivity(body: PlanarBody) -> float:
    """sqrt(k rho c), W s^(1/2) / (m2 K)."""
    assert body.heat is not None and body.heat.constants is not None
    stored, conducted = body.heat.constants
    return float(np.sqrt(stored * conducted)) / body.thickness
