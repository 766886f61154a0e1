"""Resolution of `body:set` in a scene: the body and the points of the set."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sparsemor.bodies.fem.integrals import boundary_facets
from sparsemor.bodies.floating_body import FloatingBody
from sparsemor.bodies.mesh.point_sets import cut_measures
from sparsemor.bodies.mesh.set_centres import Centre
from sparsemor.core import (
    Body,
    FloatArray,
    Gather,
    InputError,
    IntArray,
    Mesh,
    Note,
    Part,
    suggestions,
)

GROUND = "ground"
CUT = 0.01
"""Smallest share of a surface outside the facets of its set that is noted."""


@dataclass(frozen=True, eq=False)
class Place:
    """A named set of points of one body, of whatever class, where joints and forces act: which,
    name of the set; text, `body:set` as in the scene.

    point (d,): reference position of its centre, m (body frame); displacement (n, d): derivatives
    of the displacement of the centre by the unknown displacements, None on a rigid body.
    """

    body: Body
    which: str
    text: str
    point: FloatArray

    @cached_property
    def displacement(self) -> FloatArray | None:
        return self.body.displacement_of(self.which)

    @property
    def flexible(self) -> bool:
        """True if displacements can move its points: False where reference conditions fix all of
        them."""
        return self.body.deforms_at(self.which)

    def turning(self, key: str) -> FloatArray | None:
        """(n, d) derivatives of the rotation of the set by the unknown displacements, in the plane
        followed by zeros, because functionals come in pairs there; None on a rigid body, or where
        all its points are fixed. InputError where it is undefined."""
        found = self.body.rotation_of(self.which, key) if self.flexible else None
        return None if found is None else np.pad(
            found, ((0, 0), (0, self.body.d - found.shape[1])))


@dataclass(frozen=True, eq=False)
class Target:
    """A named set of nodes (numbers) of a body with a mesh or points, for loads on its fields and
    surface; text: `body:set` as in the scene; key: input key of an InputError."""

    body: FloatingBody
    nodes: IntArray
    text: str

    @cached_property
    def centre(self) -> Centre:
        """Centre of the set."""
        return self.body.centre_of(self.text.partition(":")[2], self.nodes)

    def mean(self) -> FloatArray:
        """(N,) weights of the displacement and position of the set's centre."""
        return self.centre.weights

    def facets(self, key: str) -> IntArray:
        """(F, d) boundary facets of the set; InputError for a body without a mesh."""
        if self.body.mesh is None:
            raise InputError(f"{self.text!r}: body {self.body.name!r} has no mesh, and so no "
                             "surface to integrate over; use point_force, or load_vector", key)
        try:
            return boundary_facets(self.body.mesh, self.nodes, self.text.partition(":")[2])
        except InputError as error:
            raise error.under(key) from None


def all_bodies(parts: Mapping[str, Part]) -> list[Body]:
    """Bodies of a scene."""
    return [p for p in parts.values() if isinstance(p, Body)]


def find_body(parts: Mapping[str, Part], name: str, key: str) -> Body:
    """The body called `name`; InputError with the names of the existing bodies."""
    bodies = {b.name: b for b in all_bodies(parts)}
    if name not in bodies:
        raise InputError(
            f"no body is called {name!r}: {suggestions(name, list(bodies), 'bodies')}", key)
    return bodies[name]


def find_place(parts: Mapping[str, Part], text: str, key: str) -> Place:
    """The set given as `body:set`; InputError with the names of the existing bodies or sets."""
    body, which = _split(parts, text, key)
    return Place(body, which, text, body.point_of(which, key))


def find_target(parts: Mapping[str, Part], text: str, key: str) -> Target:
    """The nodes of the set given as `body:set`; InputError with the names of the existing bodies or
    sets, or for a body without nodes."""
    body, which = _split(parts, text, key)
    if not isinstance(body, FloatingBody):
        raise InputError(f"{text!r}: body {body.name!r} ({type(body).__name__}) has no nodes of a "
                         "mesh or points that this could act on", key)
    return Target(body, body.named(which, key), text)


def _split(parts: Mapping[str, Part], text: str, key: str) -> tuple[Body, str]:
    name, colon, which = text.partition(":")
    if not colon or not which:
        raise InputError(f"give it as body:set, such as link1:top (got {text!r})", key)
    return find_body(parts, name, key), which


def find_surfaces(
    parts: Mapping[str, Part], texts: Sequence[str], field: str
) -> list[tuple[FloatingBody, Mesh, IntArray]]:
    """Body, mesh and boundary facets (F, w), corner numbers, of each surface `body:set` (texts) in
    a load's option `on`; field: that on which the load acts, `mechanical` or `thermal`, which the
    body must have.

    InputError with every fault, under `on.0`, `on.1`, ...
    """
    def find(text: str, key: str) -> tuple[FloatingBody, Mesh, IntArray]:
        target = find_target(parts, text, key)
        need_field(target.body, field, key)
        facets = target.facets(key)
        assert target.body.mesh is not None
        return target.body, target.body.mesh, facets

    gather = Gather()
    found = [gather("", find, text, f"on.{i}") for i, text in enumerate(texts)]
    gather.check()
    return [f for f in found if f is not None]


def surface_notes(parts: Mapping[str, Part], load: str, texts: Sequence[str]) -> tuple[Note, ...]:
    """Warnings about surfaces of a load, in its option `on`, that it does not cover as they are
    described: their border cuts facets, or some of the facets that a file tags are inside."""
    notes = []
    for text in texts:
        target = find_target(parts, text, "on")
        mesh, name = target.body.mesh, text.partition(":")[2]
        assert mesh is not None
        facets = target.facets("on")
        tagged = mesh.facet_sets.get(name)
        if tagged is not None and len(facets) < len(tagged):
            kind = "edges" if mesh.dimension == 2 else "faces"
            notes.append(Note(
                f"loads.{load} acts on {len(facets)} of the {len(tagged)} {kind} of {text!r}: the "
                "others are not on the surface of the body", "inner_facets"))
        if name not in target.body.declared:
            continue
        covered, meant = cut_measures(mesh, target.body.declared[name], facets)
        if covered < (1 - CUT) * meant:
            unit = "m" if mesh.dimension == 2 else "m2"
            notes.append(Note(
                f"loads.{load} acts on {covered:.4g} {unit} of {text!r}, {covered / meant:.1%} of "
                f"the {meant:.4g} {unit} that its condition describes, because the border of the "
                "set cuts facets: let it pass through nodes, or refine the mesh", "cut_patch"))
    return tuple(notes)


def joined_surfaces(
    surfaces: Sequence[tuple[FloatingBody, Mesh, IntArray]]
) -> list[tuple[FloatingBody, IntArray]]:
    """Bodies with their boundary facets (F, d) in all surfaces, one entry for each body."""
    found: dict[str, tuple[FloatingBody, IntArray]] = {}
    for body, _, facets in surfaces:
        before = found[body.name][1] if body.name in found else facets[:0]
        found[body.name] = body, np.concatenate([before, facets])
    return list(found.values())


def need_motion(body: Body, key: str) -> None:
    """InputError when a force on the body has no effect."""
    if body.immobile:
        raise InputError(f"body {body.name!r} neither moves nor deforms, so a force on it does "
                         "nothing: add `elastic` to its fields, or drop this load", key)


def need_field(body: FloatingBody, field: str, key: str) -> None:
    """InputError when the body does not have the field on which a load acts."""
    if field == "mechanical":
        need_motion(body, key)
    if field == "thermal" and body.mesh is None and not (body.heat or body.elasticity):
        raise InputError(f"body {body.name!r} is rigid and has no temperature: make it flexible "
                         "with `fields: [thermal]`, or drop this load", key)
    if field == "thermal" and body.heat is None:
        raise InputError(f"body {body.name!r} has no thermal field: add `thermal` to its fields, "
                         "or drop this load", key)
