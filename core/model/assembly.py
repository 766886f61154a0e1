"""Assembly of a model from validated input: bodies, joints, contacts, loads, and the layout of the
unknowns."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray, union
from sparsemor.core.errors import Gather, InputError
from sparsemor.core.model.block_operators import block_operators, stiffness_terms
from sparsemor.core.model.factorizations import BlockSolvers
from sparsemor.core.model.general_terms import Touched, general_terms, touched
from sparsemor.core.model.model import Model
from sparsemor.core.model.optional_features import (
    PRESCRIBED_MOTION,
    PRESCRIBED_REACTIONS,
    PROBES,
    SURFACE_LOADS,
)
from sparsemor.core.model.prescribed_quantities import NOTHING, PrescribedQuantities
from sparsemor.core.model.redundancy import redundant_joints
from sparsemor.core.protocols.body import Body, BodyPlugin, Part, ProbePlace
from sparsemor.core.protocols.connector import Connector, ConnectorPlugin
from sparsemor.core.protocols.contact import Contact
from sparsemor.core.protocols.contributions import Equations, Origin, Records
from sparsemor.core.protocols.joint import Joint
from sparsemor.core.protocols.layout import Layout
from sparsemor.core.protocols.prescribed_motion import FrameHistory
from sparsemor.core.protocols.step_amplitude import Stepping
from sparsemor.core.protocols.term import Term
from sparsemor.core.registry.boundary import guard
from sparsemor.core.registry.contracts import PARTS
from sparsemor.core.registry.returned_values import complete
from sparsemor.core.scene.digest import digest
from sparsemor.core.scene.option_tree import nested
from sparsemor.core.scene.scene import Scene
from sparsemor.core.scene.sections import Probe


@dataclass(slots=True)
class BodyCache:
    """Cache of built bodies, keyed by name, options and folder, and of assembled models, keyed by
    the digest of their scene. _bodies: name and folder -> options and body of each that was built.

    Meshing and element integrals dominate the cost of assembly and do not depend on a prescribed
    motion. A rigid copy of a body, as the rigid-body pre-simulation uses, is made from the cached
    flexible body if that has one (`Body.rigid_copy`).
    """

    _bodies: dict[tuple[str, Path], list[tuple[BodyPlugin, Body]]] = field(default_factory=dict)
    models: dict[str, Model] = field(default_factory=dict)

    def body(self, plugin: BodyPlugin, name: str, base: Path) -> Body:
        """The body that `plugin.build(name, base)` returns, from the cache if possible. Raises the
        InputError of `build`."""
        known = self._bodies.setdefault((name, base), [])
        for options, body in known:
            if options == plugin:
                return body
        # the flexible body of a rigid copy: the same options but for `fields`
        whole = next((b for options, b in known if without_fields(options) == plugin), None)
        body = (None if whole is None else whole.rigid_copy()) or plugin.build(name, base)
        known.append((plugin, body))
        return body

    def of_bodies(self) -> "BodyCache":
        """Cache with the same bodies, and without the models."""
        return BodyCache(self._bodies)


def without_fields(plugin: BodyPlugin) -> BodyPlugin | None:
    """Options of the same body without elastic and thermal fields (`fields: []`); None for a body
    without this option, or without fields."""
    if not plugin.selected_fields:
        return None
    return plugin.model_copy(update={"fields": []})


_PARTS = ("bodies", "joints", "contacts", "loads", "probes")
"""Sections of the input that the assembled model depends on."""


def assemble(
    scene: Scene, prescribed: PrescribedQuantities = NOTHING, body_cache: BodyCache | None = None
) -> Model:
    """Assembled model of a simulation input (scene), with all bodies, joints, contacts and loads
    built.

    prescribed: motion, reactions and surface loads that are not solved for; body_cache: bodies, and
    models without prescribed motion, built earlier. Raises InputError with all faults found,
    located by dotted input keys (`joints.A.between.0`).
    """
    # only models without prescribed motion are kept: the key does not describe that motion
    shared = body_cache is not None and prescribed is NOTHING
    models, key = (body_cache or BodyCache()).models, ""
    if shared:
        key = digest(str(scene.folder), scene.digest(*_PARTS), repr(_stepping(scene)))
    if not shared or key not in models:
        bodies, connected, probes = _build(scene, prescribed, body_cache or BodyCache())
        model = _model(scene, prescribed, bodies, connected, probes)
        # joints with redundant constraints are made compliant, and the model is assembled again
        joints = {n: j for n, j in connected["joints"].items() if isinstance(j, Joint)}
        # softer: compliance of each constraint, and a note
        softened = {n: made for n, softer in redundant_joints(model, scene.time.step).items()
                   if (made := joints[n].compliant(*softer)) is not None}
        if softened:
            connected["joints"] |= softened
            model = _model(scene, prescribed, bodies, connected, probes)
        if not shared:
            return model
        models[key] = model
    # a copy, so that its solvers log this run alone and its initial state is computed anew
    return replace(models[key], solvers=BlockSolvers(scene.linear_solver, scene.linear_solvers))


def with_joints(scene: Scene, model: Model, changed: Mapping[str, Joint]) -> Model:
    """The model of a scene, without prescribed motion, with other joints of the same unknowns."""
    parts = {**model.parts, **changed}
    bodies = {n: b for n in scene.bodies if isinstance(b := parts[n], Body)}
    connected = {group: {n: c for n in getattr(scene, group)
                         if isinstance(c := parts.get(n), Connector)}
                 for group in ("joints", "contacts", "loads")}
    return replace(_model(scene, NOTHING, bodies, connected, model.probes), solvers=model.solvers)


def _model(
    scene: Scene, prescribed: PrescribedQuantities, bodies: dict[str, Body],
    connected: Mapping[str, Mapping[str, Connector]], probes: tuple[ProbePlace, ...],
) -> Model:
    """The model from built parts: layout of their blocks, then what each contributes. connected:
    "joints", "contacts" and "loads" -> name -> built part. Along a prescribed motion, contacts
    contribute the loads of that motion instead of themselves."""
    groups: dict[str, Mapping[str, Part]] = {"bodies": bodies, **connected}
    connectors = {n: part for named in connected.values() for n, part in named.items()}
    parts = {**bodies, **connectors}
    layout = Layout([b for part in parts.values() for b in part.blocks()])
    if not layout.size:
        raise InputError("nothing in this scene can change: no body moves, deforms or has heat",
                         "bodies")
    records, stepping = Records(), _stepping(scene)
    motion = prescribed.motion(bodies)
    for group, named in groups.items():
        for name, part in named.items():
            equations = Equations(layout, Origin(group, name), records, stepping)
            if motion is None or group != "contacts":
                part.contribute(equations)
            elif isinstance(part, Contact):
                _along(equations, bodies, name, part, prescribed, motion)
    for local in records.local:  # whose values are checked, as they may be of plugins
        guard(Term, type(local.term))
    terms = general_terms(layout, records)
    for name, term in stiffness_terms(layout, records).items():
        terms.setdefault(name, []).append(term)
    x0, v0 = _start(layout, bodies)
    # block -> joint or localized load -> rows that it acts on; `required`: those of all of them
    loaded = _loaded(layout, connectors, touched(layout, records))
    return Model(
        layout=layout, parts=parts, by_part={n: tuple(terms.get(n, ())) for n in parts},
        separated=block_operators(layout, records, scene.time.step), x0=x0, v0=v0,
        required={name: union(rows.values()) for name, rows in loaded.items()}, loaded=loaded,
        probes=probes,
        geometry={k: g for b in bodies.values() for k, g in b.geometry().items()},
        solvers=BlockSolvers(scene.linear_solver, scene.linear_solvers),
    )


def _stepping(scene: Scene) -> Stepping:
    """Steps of a run, over which loads are averaged."""
    return Stepping.of(scene.integrator, scene.time.step)


def _build(
    scene: Scene, prescribed: PrescribedQuantities, body_cache: BodyCache
) -> tuple[dict[str, Body], dict[str, dict[str, Connector]], tuple[ProbePlace, ...]]:
    """All bodies; joints, contacts and loads by group; probes. Joints, contacts and loads on a body
    that failed to build are skipped, since their faults would only repeat those of the body."""
    gather = Gather()  # gather(key, f, ..): f(..), or None, with its InputErrors kept under the key
    base = scene.file_folder or Path()
    bodies: dict[str, Body] = {}
    for name, plugin in scene.bodies.items():
        body = gather(f"bodies.{name}", _body, body_cache, plugin, name, base, prescribed)
        if body is not None:
            bodies[name] = body
    failed = set(scene.bodies) - set(bodies)
    groups: dict[str, Mapping[str, ConnectorPlugin]] = {
        "joints": scene.joints, "contacts": scene.contacts, "loads": scene.loads}
    connectors: dict[str, dict[str, Connector]] = {group: {} for group in groups}
    for group, built in connectors.items():  # loads see what joints made of the bodies
        for name, connector in groups[group].items():
            if mentioned(connector, failed):
                continue
            with gather.under(f"{group}.{name}"):
                part = _connector(connector, name, bodies, prescribed,
                                  PARTS[group.removesuffix("s")])
                built[name] = part
                bodies.update(part.adjusted)
    probes = [gather(f"probes.{name}", _probe, bodies[probe.body], name, probe)
              for name, probe in scene.probes.items() if probe.body in bodies]
    gather.check()
    return bodies, connectors, tuple(p for p in probes if p)


def _probe(body: Body, name: str, probe: Probe) -> ProbePlace:
    """Material point of a body whose motion, temperature and, if wanted, stress are recorded.
    Raises InputError if the body has no such point or no such stress."""
    made = PROBES.checked(body.probe(name, probe.at), body, "body")
    if not probe.stress:
        return made
    found = body.stress_at(probe.at)
    if found is None:
        raise InputError(f"body {body.name!r} has no stress that is linear in its displacements "
                         "and temperatures: it needs a mesh (of no body of revolution), unknown "
                         "displacements, linear strains and isotropic constants", "stress")
    return replace(made, stress=found)


def _body(
    body_cache: BodyCache, plugin: BodyPlugin, name: str, base: Path,
    prescribed: PrescribedQuantities,
) -> Body:
    """One built body, from the cache if possible; its frame follows a prescribed motion if there is
    one."""
    body = body_cache.body(plugin, name, base)
    complete(body, Body, plugin, "build")
    motion = prescribed.frame(name, body)
    return body if motion is None else PRESCRIBED_MOTION.checked(body.with_motion(motion), body)


def _connector(
    plugin: ConnectorPlugin, name: str, bodies: Mapping[str, Body],
    prescribed: PrescribedQuantities, contract: type,
) -> Connector:
    """One built joint, contact or load, checked to have the methods of its contract; a joint whose
    reactions are prescribed is replaced by one with these known forces and without multipliers.
    Raises InputError if it cannot take them."""
    part = plugin.build(name, bodies)
    complete(part, contract, plugin, "build")
    reactions = prescribed.reactions(name, part) if isinstance(part, Joint) else None
    if reactions is None or not isinstance(part, Joint):
        return part
    return PRESCRIBED_REACTIONS.checked(part.known(reactions), part)


def _along(
    equations: Equations, bodies: Mapping[str, Body], name: str, contact: Contact,
    prescribed: PrescribedQuantities, motion: Mapping[str, FrameHistory],
) -> None:
    """Adds a contact evaluated along a prescribed motion to the equations: time-tabulated loads
    on each surface, and heat conduction."""
    times = next(iter(motion.values())).times
    for body, resultant_sources in prescribed.surface_loads(name, contact, motion).items():
        if not bodies[body].surface_loads(equations, resultant_sources, times):
            raise SURFACE_LOADS.refusal(bodies[body], f"bodies.{body}")
    contact.conduction(equations, motion)


def mentioned(plugin: object, bodies: Iterable[str]) -> set[str]:
    """Bodies that an option names, as `body` or as a set `body:set`."""
    return {text.partition(":")[0] for _, text in nested(plugin, str)} & set(bodies)


def _start(layout: Layout, bodies: Mapping[str, Body]) -> tuple[FloatArray, FloatArray]:
    """Initial values x (n,) and rates v (n,) of all unknowns; zero where a body gives none, as for
    multipliers."""
    x, v = np.zeros(layout.size), np.zeros(layout.size)
    for body in bodies.values():
        for name, (value, rate) in body.initial().items():
            if name in layout:
                x[layout[name]], v[layout[name]] = value, rate
    return x, v


def _loaded(
    layout: Layout, connectors: Mapping[str, Connector], acts: Touched
) -> dict[str, dict[str, IntArray]]:
    """Row numbers of each elastic or thermal block that each joint and localized load acts on."""
    return {b.name: {name: acts[name][b.name] for name, part in connectors.items()
                     if part.localized and b.name in acts.get(name, {})}
            for b in layout if b.kind.reducible}
