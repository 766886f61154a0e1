"""Polygonal contact: two surfaces made of facets, pressure and friction per area between them."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from sparsemor.bodies.body_set import find_target
from sparsemor.bodies.contact.bristles import Bristles, Slip
from sparsemor.bodies.contact.built_contact import ContactPart
from sparsemor.bodies.contact.closest_points import check_start
from sparsemor.bodies.contact.quadrature import enough_points, rule
from sparsemor.bodies.contact.surface import BroadPhase, Surface
from sparsemor.bodies.contact.tractions import Interface
from sparsemor.bodies.fem.integrals import divided
from sparsemor.bodies.floating_body import FloatingBody
from sparsemor.core import (
    ContactPlugin,
    Fault,
    FloatArray,
    FrictionLaw,
    Gather,
    InputError,
    IntArray,
    NormalLaw,
    Part,
    Plugin,
    Slot,
)


class SurfaceHeat(Plugin):
    """Heat exchange between the surfaces: all friction power enters the two bodies as heat."""

    share: Annotated[float, Field(ge=0, le=1)] | Literal["effusivity"] = "effusivity"
    """Fraction of the friction heat that enters the first body: a number, or `effusivity`: in
    proportion to the effusivities sqrt(k rho c) of the two materials."""
    conductance: float = Field(default=0.0, ge=0)
    """Thermal contact conductance where the surfaces touch, W/(m2 K)."""


class Polygonal(ContactPlugin):
    """Polygonal contact: pressure, friction and frictional heat per area of overlapping facets.

    Integration is over the first surface. Penetration and slip are relative to the nearest facet of
    the second surface. Both bodies need a mesh, both in the plane or both in space: a rigid one is
    a flexible body with `fields: []`.
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
    """Configuration in which contact is evaluated: `rigid`: undeformed surfaces that move with the
    body frames; `deformed`: with the elastic displacements of the nodes."""
    tolerance: float = Field(default=1e-6, gt=0, lt=0.1)
    """Relative quadrature error of the resultants; Gauss points are added until doubling them
    changes less."""

    @property
    def deforms(self) -> bool:
        """True if contact is evaluated with deformed surfaces."""
        return self.surfaces == "deformed"

    @property
    def sides(self) -> Sequence[str]:
        """The two surfaces `body:set`."""
        return self.between

    def build(self, name: str, parts: Mapping[str, Part]) -> ContactPart:
        """The contact of two surfaces that do not overlap at the start. Raises InputError for
        surfaces without facets and for options that the bodies do not support.

        bristles: of a law of static friction, whose integrals are of the slip (`Slip`), which
        determines the number of quadrature points; reach: largest admissible penetration, m.
        """
        bodies = self._bodies(parts)
        (one, _), (other, _) = bodies
        if one.name == other.name:
            raise InputError(f"both surfaces are on body {one.name!r}: contact of a body "
                             "with itself is not looked for", "between")
        self._check_motion(one, other)
        d = _dimension(one, other)
        first, second = (Surface.from_facets(*found) for found in bodies)
        check_start(first, second)
        bristles = Bristles.on_nodes(self.friction, first.X)
        friction = self.friction if bristles is None else Slip()
        face = self._face(one, other, rule(d, enough_points(
            d, self.normal, friction, self.tolerance)))
        # half a facet: farther in, the nearest facet is not the one that was crossed
        reach = 0.5 * float(min(first.sizes.min(), second.sizes.min()))
        return ContactPart(
            name, first, second, face, near=BroadPhase.between(first, second, reach), reach=reach,
            deforms=self.deforms, heats=self.heat is not None, bristles=bristles)

    def _face(
        self, first: FloatingBody, second: FloatingBody, points: tuple[FloatArray, FloatArray]
    ) -> Interface:
        """Laws and heat of the contact, with the points and weights of a quadrature rule."""
        width = min(first.thickness, second.thickness)
        conductance = 0.0 if self.heat is None else self.heat.conductance
        return Interface(
            self.normal, self.friction, width, share=self._share(first, second),
            conductance=conductance, points=points[0], weights=points[1])

    def _bodies(
        self, parts: Mapping[str, Part]
    ) -> tuple[tuple[FloatingBody, IntArray], tuple[FloatingBody, IntArray]]:
        """Both bodies, each with the facets (F, d), node numbers, of its contact surface.
        InputError with the faults of both."""
        def find(text: str, key: str) -> tuple[FloatingBody, IntArray]:
            """Body of a surface and its facets, straight segments or triangles."""
            target = find_target(parts, text, key)
            body = target.body
            if body.mesh is None:
                raise InputError(
                    f"{text!r}: body {body.name!r} has no mesh, so it has no surface that "
                    "could touch; give its shape as a flexible body with `fields: []`", key)
            if body.revolved:
                raise InputError(f"{text!r}: body {body.name!r} is axisymmetric, and touches no "
                                 "other: drop this contact", key)
            return body, divided(body.mesh, target.facets(key))

        gather = Gather()
        found = [gather("", find, text, f"between.{i}") for i, text in enumerate(self.between)]
        gather.check()
        first, second = (f for f in found if f is not None)
        return first, second

    def _check_motion(self, first: FloatingBody, second: FloatingBody) -> None:
        """Raises InputError where options ask for deformation or heat of bodies without such a
        field: deformation needs an elastic one on one side; the effusivity of both, and conduction,
        a thermal one on both, unless neither has one, as in a rigid-body pre-simulation."""
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
                                "effusivity is undefined: give the first body's share as a number, "
                                "or add `thermal` to its fields"))
        if self.heat.conductance > 0:
            faults.append(Fault("heat.conductance", f"body {lacking[0]!r} has no thermal field: "
                                "add `thermal` to its fields, or leave the conductance out"))
        if faults:
            raise InputError(faults)

    def _share(self, first: FloatingBody, second: FloatingBody) -> float:
        """Fraction of the friction heat that enters the first body, 0 without heat."""
        if self.heat is None:
            return 0.0
        if self.heat.share != "effusivity":
            return self.heat.share
        if first.heat is None or second.heat is None:
            return 0.5  # a stage without temperatures: no heat enters
        a, b = (effusivity(body) for body in (first, second))
        return a / (a + b)


def _dimension(first: FloatingBody, second: FloatingBody) -> int:
    """Common dimension of two bodies, 2 or 3; InputError where one is in the plane and the other in
    space."""
    d = [b.d for b in (first, second)]
    if d[0] != d[1]:
        flat, solid = (b.name for _, b in sorted(zip(d, (first, second), strict=True),
                                                 key=lambda found: found[0]))
        raise InputError(f"body {flat!r} is in the plane and body {solid!r} in space: give both "
                         "in the plane or both in space", "between")
    return int(d[0])


def effusivity(body: FloatingBody) -> float:
    """Thermal effusivity sqrt(k rho c), W s^(1/2) / (m2 K), at the reference temperature;
    InputError for a body of several materials."""
    assert body.heat is not None
    found = {float(np.sqrt(stored * conducted)) / body.thickness
             for _, (stored, conducted) in body.heat.regions}
    if len(found) > 1:
        raise InputError(f"body {body.name!r} has several materials, so its effusivity differs "
                         "from place to place: give the first body's share as a number",
                         "heat.share")
    return found.pop()
