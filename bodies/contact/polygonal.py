"""Polygonal contact: two surfaces made of facets, pressure and friction per area between them."""

from collections.abc import Mapping
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from sparsemor.bodies.any_body import AnyBody
from sparsemor.bodies.body_part import PlanarBody
from sparsemor.bodies.contact.near import Near
from sparsemor.bodies.contact.planar_part import PlanarContact
from sparsemor.bodies.contact.quadrature import enough_points, gauss
from sparsemor.bodies.contact.spatial import quadrature as triangles
from sparsemor.bodies.contact.spatial import start as spatial_start
from sparsemor.bodies.contact.spatial.part import SpatialContact
from sparsemor.bodies.contact.spatial.surface import Surface as SpatialSurface
from sparsemor.bodies.contact.start import check_start, deepest
from sparsemor.bodies.contact.surface import Surface
from sparsemor.bodies.contact.tractions import Interface
from sparsemor.bodies.spatial.body import SpatialBody
from sparsemor.bodies.targets import find_target
from sparsemor.core.arrays import FloatArray, IntArray
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
    the second. Both bodies need a mesh, both in the plane or both in space: a rigid one is a
    flexible body with `fields: []`.
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

    def build(self, name: str, parts: Mapping[str, Part]) -> PlanarContact | SpatialContact:
        first, second = self._bodies(parts)
        if first[0].name == second[0].name:
            raise InputError(f"both surfaces are on body {first[0].name!r}: contact of a body "
                             "with itself is not looked for", "between")
        self._check_motion(first[0], second[0])
        if isinstance(first[0], PlanarBody) and isinstance(second[0], PlanarBody):
            return self._planar(name, Surface.of(first[0], first[1]),
                                Surface.of(second[0], second[1]))
        if isinstance(first[0], SpatialBody) and isinstance(second[0], SpatialBody):
            return self._spatial(name, SpatialSurface.of(first[0], first[1]),
                                 SpatialSurface.of(second[0], second[1]))
        flat, solid = (b.name for b in sorted(
            (first[0], second[0]), key=lambda b: isinstance(b, SpatialBody)))
        raise InputError(f"body {flat!r} is in the plane and body {solid!r} in space: give both "
                         "in the plane or both in space", "between")

    def _planar(self, name: str, first: Surface, second: Surface) -> PlanarContact:
        check_start(first, second, deepest)
        rule = gauss(enough_points(self.normal, self.friction, self.tolerance))
        face = self._face(first.body, second.body, rule)
        # half a facet: farther in, the nearest facet is not the one that was crossed
        reach = 0.5 * float(min(first.sizes.min(), second.sizes.min()))
        return PlanarContact(name, first, second, face, Near.of(first, second, reach), reach,
                           self.surfaces == "deformed", self.heat is not None)

    def _spatial(
        self, name: str, first: SpatialSurface, second: SpatialSurface
    ) -> SpatialContact:
        check_start(first, second, spatial_start.deepest)
        rule = triangles.triangle_rule(
            triangles.enough_points(self.normal, self.friction, self.tolerance))
        face = self._face(first.body, second.body, rule)
        reach = 0.5 * float(min(first.sizes.min(), second.sizes.min()))
        return SpatialContact(name, first, second, face, Near.of(first, second, reach), reach,
                              self.surfaces == "deformed", self.heat is not None)

    def _face(
        self, first: AnyBody, second: AnyBody, rule: tuple[FloatArray, FloatArray]
    ) -> Interface:
        width = min(first.thickness, second.thickness)
        conductance = 0.0 if self.heat is None else self.heat.conductance
        return Interface(self.normal, self.friction, width, self._share(first, second),
                         conductance, *rule)

    def _bodies(
        self, parts: Mapping[str, Part]
    ) -> tuple[tuple[AnyBody, IntArray], tuple[AnyBody, IntArray]]:
        """Both bodies with the facets of their surfaces."""
        def find(text: str, key: str) -> tuple[AnyBody, IntArray]:
            target = find_target(parts, text, key)
            body = target.body
            if body.mesh is None:
                raise InputError(
                    f"{text!r}: body {body.name!r} has no mesh, so it has no surface that "
                    "could touch; give its shape as a flexible body with `fields: []`", key)
            return body, target.facets(key)

        gather = Gather()
        found = [gather("", find, text, f"between.{i}") for i, text in enumerate(self.between)]
        gather.check()
        first, second = (f for f in found if f is not None)
        return first, second

    def _check_motion(self, first: AnyBody, second: AnyBody) -> None:
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

    def _share(self, first: AnyBody, second: AnyBody) -> float:
        if self.heat is None:
            return 0.0
        if self.heat.share != "effusivity":
            return self.heat.share
        if first.heat is None or second.heat is None:
            return 0.5  # a stage without temperatures: no heat enters
        a, b = (effusivity(body) for body in (first, second))
        return a / (a + b)


def effusivity(body: AnyBody) -> float:
    """sqrt(k rho c), W s^(1/2) / (m2 K)."""
    assert body.heat is not None and body.heat.constants is not None
    stored, conducted = body.heat.constants
    return float(np.sqrt(stored * conducted)) / body.thickness
