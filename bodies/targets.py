"""Resolution of `body:set` in a scene: the body and the points of the set."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sparsemor.bodies.body import Body
from sparsemor.bodies.fem.surface import boundary_facets
from sparsemor.bodies.frames import nodal
from sparsemor.bodies.mesh.centres import Centre
from sparsemor.bodies.mesh.patches import cut_measures
from sparsemor.core import (
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
class Target:
    """A named set of points of one body."""

    body: Body
    nodes: IntArray
    text: str

    @cached_property
    def centre(self) -> Centre:
        """Centre of the set, where joints, forces and probes act."""
        return self.body.centre_of(self.text.partition(":")[2], self.nodes)

    def mean(self) -> FloatArray:
        """(N,) weights of the displacement and position of the set's centre."""
        return self.centre.weights

    @property
    def flexible(self) -> bool:
        """True if displacements can move its nodes: False where reference conditions fix all of
        them."""
        e = self.body.elasticity
        return e is not None and bool(np.isin(self.nodes, e.free // self.body.d).any())

    def turning(self, key: str) -> FloatArray | None:
        """(d N, d) functionals of the displacements for the mean rotation of the set; None on a
        rigid body, or where all its nodes are fixed. InputError where it is undefined."""
        body = self.body
        if not self.flexible or body.elasticity is None:
            return None
        try:
            vectors = nodal.mean_turn(self.centre.even, body.X)
        except np.linalg.LinAlgError:
            where, what = ("are at one place", "two or more places") if body.d == 2 else (
                "lie on one line (or are one point)", "a set that spans a plane")
            raise InputError(
                f"the points of {self.text!r} {where}, so their mean rotation is undefined: "
                f"attach to {what}", key) from None
        return vectors if np.any(vectors[body.elasticity.free]) else None

    def facets(self, key: str) -> IntArray:
        """(F, d) boundary facets of the set; InputError for a body without a mesh."""
        if self.body.mesh is None:
            raise InputError(f"{self.text!r}: body {self.body.name!r} is rigid and has no surface "
                             "to integrate over; use point_force", key)
        try:
            return boundary_facets(self.body.mesh, self.nodes, self.text.partition(":")[2])
        except InputError as error:
            raise error.under(key) from None


def all_bodies(parts: Mapping[str, Part]) -> list[Body]:
    """Bodies of class `Body`; bodies of other classes have loads of their own."""
    return [p for p in parts.values() if isinstance(p, Body)]


def find_body(parts: Mapping[str, Part], name: str, key: str) -> Body:
    """The body called `name`; InputError with the names of the existing bodies."""
    bodies = {b.name: b for b in all_bodies(parts)}
    if name not in bodies:
        raise InputError(
            f"no body is called {name!r}: {suggestions(name, list(bodies), 'bodies')}", key)
    return bodies[name]


def find_target(parts: Mapping[str, Part], text: str, key: str) -> Target:
    """The set given as `body:set`; InputError with the names of the existing bodies or sets."""
    name, colon, which = text.partition(":")
    if not colon or not which:
        raise InputError(f"give it as body:set, such as link1:top (got {text!r})", key)
    body = find_body(parts, name, key)
    return Target(body, body.named(which, key), text)


def find_surfaces(
    parts: Mapping[str, Part], texts: Sequence[str], field: str
) -> list[tuple[Body, Mesh, IntArray]]:
    """Body, mesh and boundary facets (F, d) of each surface in a load's option `on`; field: the one
    on which the load acts.

    InputError with every fault, under `on.0`, `on.1`, ...
    """
    def find(text: str, key: str) -> tuple[Body, Mesh, IntArray]:
        target = find_target(parts, text, key)
        need_field(target, field, key)
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
    surfaces: Sequence[tuple[Body, Mesh, IntArray]]
) -> list[tuple[Body, IntArray]]:
    """Bodies with their boundary facets (F, d) in all surfaces, one entry for each body."""
    found: dict[str, tuple[Body, IntArray]] = {}
    for body, _, facets in surfaces:
        before = found[body.name][1] if body.name in found else facets[:0]
        found[body.name] = body, np.concatenate([before, facets])
    return list(found.values())


def need_field(target: Target, field: str, key: str) -> None:
    """InputError when the body does not have the field on which a load acts."""
    body = target.body
    if field == "thermal" and body.mesh is None:
        raise InputError(f"body {body.name!r} is rigid and has no temperature: make it flexible "
                         "with `fields: [thermal]`, or drop this load", key)
    if field == "thermal" and body.heat is None:
        raise InputError(f"body {body.name!r} has no thermal field: add `thermal` to its fields, "
                         "or drop this load", key)
    if field == "mechanical" and body.immobile:
        raise InputError(f"body {body.name!r} neither moves nor deforms, so a force on it does "
                         "nothing: add `elastic` to its fields, or drop this load", key)
