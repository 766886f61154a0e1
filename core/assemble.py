"""From a validated scene to a model: build the parts, lay out the unknowns, collect the terms."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.block_solvers import BlockSolvers
from sparsemor.core.cache import digest
from sparsemor.core.errors import Gather, InputError
from sparsemor.core.layout import Layout
from sparsemor.core.model import Model, ProbePlace
from sparsemor.core.protocols import BodyPart, Part, ProbedBody, Term
from sparsemor.core.returned import complete
from sparsemor.core.scene import Scene
from sparsemor.core.scene_fields import Probe
from sparsemor.core.separable import Separated
from sparsemor.core.stage import NOTHING, FrameHistory, Given
from sparsemor.core.workshop import Workshop

_PARTS = ("bodies", "joints", "contacts", "loads", "probes")
"""What of a scene a model depends on."""


def assemble(scene: Scene, given: Given = NOTHING, shop: Workshop | None = None) -> Model:
    """Builds every body, joint, contact and load. Raises InputError with all faults found, as
    dotted keys of the scene (`joints.A.between.0`). given: motion, reactions and surface loads that
    are not solved for. shop: where bodies, and models without given motion, are that were built
    before."""
    if shop is None or given is not NOTHING:
        return _assembled(scene, given, shop or Workshop())
    key = digest(str(scene.folder), scene.digest(*_PARTS))
    model = shop.model(key, lambda: _assembled(scene, given, shop))
    # with a log of its own, and a start of its own
    return replace(model, solvers=BlockSolvers(scene.linear_solver, scene.linear_solvers))


def _assembled(scene: Scene, given: Given, shop: Workshop) -> Model:
    bodies, joints, contacts, loads, probes = _build(scene, given, shop)
    connectors = {**joints, **contacts, **loads}
    parts = {**bodies, **connectors}
    layout = Layout([b for part in parts.values() for b in part.blocks()])
    if not layout.size:
        raise InputError("nothing in this scene can change: no body moves, deforms or has heat",
                         "bodies")
    terms: list[Term] = []
    by_part: dict[str, Sequence[Term]] = {}
    motion = given.motion(bodies)
    for name, part in parts.items():
        made = part.terms(layout, parts) if motion is None or name not in contacts else (
            _along(layout, bodies, name, part, given, motion))
        # a force on a given frame without an elastic field has no row to act on
        by_part[name] = [_signed(t, name) for t in made if len(t.rows)]
        terms += by_part[name]
    x0, v0 = _start(layout, bodies)
    required, loaded = _required(layout, connectors, by_part)
    return Model(
        layout=layout, parts=parts, terms=tuple(terms),
        separated=_separate(layout, bodies, joints, terms, scene.time.step), x0=x0, v0=v0,
        required=required, loaded=loaded, probes=probes,
        geometry={k: g for b in bodies.values() for k, g in b.geometry().items()},
        solvers=BlockSolvers(scene.linear_solver, scene.linear_solvers),
    )


def _build(
    scene: Scene, given: Given, shop: Workshop
) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any], dict[str, Any], tuple[ProbePlace, ...]]:
    """Bodies, joints, contacts, loads and probes. What mentions a body that failed is not tried:
    its own faults would only repeat those of the body."""
    gather = Gather()
    base = scene.source.folder or Path()
    bodies: dict[str, Any] = {}
    for name, plugin in scene.bodies.items():
        body = gather(f"bodies.{name}", _body, shop, plugin, name, base, given)
        if body is not None:
            bodies[name] = body
    failed = set(scene.bodies) - set(bodies)
    connectors: dict[str, dict[str, Any]] = {"joints": {}, "contacts": {}, "loads": {}}
    for group, built in connectors.items():  # loads see what joints made of the bodies
        for name, plugin in getattr(scene, group).items():
            if _mentioned(plugin, failed):
                continue
            part = gather(f"{group}.{name}", _connector, plugin, name, bodies,
                          given if group == "joints" else NOTHING)
            if part is not None:
                built[name] = part
                bodies.update(getattr(part, "adjusted", {}))
    probes = [gather(f"probes.{name}", _probe, bodies[probe.body], name, probe)
              for name, probe in scene.probes.items() if probe.body in bodies]
    gather.check()
    return (bodies, connectors["joints"], connectors["contacts"], connectors["loads"],
            tuple(p for p in probes if p))


def _probe(body: Any, name: str, probe: Probe) -> ProbePlace:
    if not isinstance(body, ProbedBody):
        raise InputError(f"{type(body).__name__} has no method probe(name, at): this kind of body "
                         "takes no probes", "body")
    place: ProbePlace = body.probe(name, probe.at)
    return place


def _body(shop: Workshop, plugin: Any, name: str, base: Path, given: Given) -> Any:
    """A body, guided where its motion is given."""
    body = shop.body(plugin, name, base)
    complete(body, BodyPart, plugin, "build")
    motion = given.frame(name, body)
    return body if motion is None else body.guided(motion)


def _connector(plugin: Any, name: str, bodies: Mapping[str, Any], given: Given) -> Any:
    """A joint, contact or load; a joint has known multipliers where they are given."""
    part = plugin.build(name, bodies)
    complete(part, Part, plugin, "build")
    forces = given.reactions(name, part)
    return part if forces is None else part.known(forces)


def _along(
    layout: Layout, bodies: Mapping[str, Any], name: str, contact: Any, given: Given,
    motion: Mapping[str, FrameHistory],
) -> list[Term]:
    """The terms of a contact that follows a given motion: tabled loads on each surface, and what
    depends on temperatures, if a contact has a method `conduction(layout, motion)`."""
    times = next(iter(motion.values())).times
    made = [t for body, acting in given.surface_loads(name, contact, motion).items()
            for t in bodies[body].surface_loads(layout, name, acting, times)]
    conduction = getattr(contact, "conduction", None)
    return made if conduction is None else [*made, *conduction(layout, motion)]


def _signed(term: Any, part: str) -> Any:
    """A term with a field `source` learns which part of the scene it comes from: loads keep
    their names that way."""
    return replace(term, source=part) if hasattr(term, "source") else term


def _mentioned(plugin: Any, names: set[str]) -> bool:
    """Whether an option of a connector is one of these bodies, or `body:set` of one."""
    pending = list(plugin.model_dump().values()) if names else []
    while pending:
        value = pending.pop()
        if isinstance(value, str) and value.partition(":")[0] in names:
            return True
        if isinstance(value, Mapping):
            pending += value.values()
        elif isinstance(value, list | tuple):
            pending += value
    return False


def _start(layout: Layout, bodies: Mapping[str, Any]) -> tuple[FloatArray, FloatArray]:
    x, v = np.zeros(layout.size), np.zeros(layout.size)
    for body in bodies.values():
        for name, (value, rate) in body.initial().items():
            if name in layout:
                x[layout[name]], v[layout[name]] = value, rate
    return x, v


def _required(
    layout: Layout, connectors: Mapping[str, Any], by_part: Mapping[str, Sequence[Term]]
) -> tuple[dict[str, IntArray], dict[str, dict[str, IntArray]]]:
    """Local rows of each block that a joint or a localized load acts on, and on whose account."""
    loaded: dict[str, dict[str, IntArray]] = {}
    for b in layout:
        if b.field not in ("elastic", "thermal"):
            continue
        at, found = layout[b.name], {}
        for name, part in connectors.items():
            if not getattr(part, "localized", True):
                continue
            rows = [t.rows[(t.rows >= at.start) & (t.rows < at.stop)] for t in by_part[name]]
            local = np.unique(np.concatenate([*rows, np.zeros(0, np.int64)])) - at.start
            if len(local):
                found[name] = local.astype(np.int64)
        loaded[b.name] = found
    required = {
        name: np.unique(np.concatenate([*found.values(), np.zeros(0, np.int64)])).astype(np.int64)
        for name, found in loaded.items()
    }
    return required, loaded


def _separate(
    layout: Layout, bodies: Mapping[str, Any], joints: Mapping[str, Any], terms: Sequence[Term],
    step: float,
) -> Separated:
    """Ask each body for its share of the terms; what nobody claims is `other`."""
    n_rigid = sum(b.size for b in layout if b.field == "rigid")
    start = layout.algebraic.start
    moving, heat, targets = [], [], []
    claimed: set[int] = set()
    for body in bodies.values():
        mine = [t for t in terms if body.claims(layout, t)]
        claimed |= {id(t) for t in mine}
        mechanics, thermal = body.mechanics(layout, mine), body.heat_equations(layout, mine)
        moving += [] if mechanics is None else [mechanics]
        heat += [] if thermal is None else [thermal]
    for name, joint in joints.items():
        if f"{name}.multiplier" not in layout:
            continue
        first = layout[f"{name}.multiplier"].start - start + n_rigid
        targets += [(first + i, f) for i, f in enumerate(getattr(joint, "targets", ()))]
        claimed |= {id(t) for t in terms if getattr(t, "body", "") == name}
    return Separated(
        tuple(moving), tuple(heat), n_rigid + layout.size - start, tuple(targets),
        tuple(t for t in terms if id(t) not in claimed), step)
