"""Two-stage scenes: a rigid-body pre-simulation, whose motion and loads are prescribed in a
flexible model.

The pre-simulation (rigid stage) is the same scene with bodies without elastic and thermal fields,
so that contact is cheap to evaluate in every step. Full-order and reduced flexible runs use the
same tables of motion, joint forces and contact loads.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from sparsemor.core.arrays import Arrays, FloatArray, IntArray
from sparsemor.core.errors import Fault, InputError
from sparsemor.core.model.assembly import BodyCache, assemble
from sparsemor.core.model.initial_state import resolved_start
from sparsemor.core.model.model import Model
from sparsemor.core.model.prescribed_quantities import Followed, Immobile, loads_along
from sparsemor.core.protocols.body import BodyPlugin
from sparsemor.core.protocols.contact import Contact
from sparsemor.core.protocols.layout import Quantity
from sparsemor.core.protocols.prescribed_motion import FrameHistory, Stage, SurfaceLoads
from sparsemor.core.registry.hooks import Manager
from sparsemor.core.scene.default_plugins import FULL_ORDER
from sparsemor.core.scene.digest import digest
from sparsemor.core.scene.run_identity import IRRELEVANT, Identity
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.offline import Offline, full_run
from sparsemor.core.simulation.offline_cache import Products, mesh_content
from sparsemor.core.status import SolveFailed, Status

STAGE = "rigid stage"
"""Prefix of messages about failures of the rigid-body pre-simulation."""
_LABEL = "rigid_stage.overrides"
_OWN_STEPS = ("the stage follows how bodies swing on their contacts: raise time.control.rigid "
              "above that swing, or keep fixed steps there, "
              "rigid_stage: {overrides: {time.control: null}}")


def rigid_scene(scene: Scene) -> Scene:
    """Scene of the rigid-body pre-simulation: full order, no elastic and thermal fields.

    Loads and joints that act on temperatures alone are left out. Options that do
    not affect the motion are reset, so that all runs with this motion find the same cached
    pre-simulation.
    """
    assert scene.rigid_stage is not None
    tree = scene.source.tree
    kept: dict[str, Any] = {
        group: {n: tree[group][n] for n, plugin in plugins.items() if plugin.acts_on == "motion"}
        for group, plugins in (("joints", scene.joints), ("loads", scene.loads))
        if tree.get(group)}
    rigid_copy: dict[str, Any] = {f"bodies.{n}.fields": [] for n, body in scene.bodies.items()
                            if body.selected_fields is not None}
    plain = scene.using({
        **kept, **rigid_copy, **IRRELEVANT, "reducer": {"use": FULL_ORDER}, "training": {},
        "rigid_stage": None, "linear_solver": "auto", "linear_solvers": {}}, label="rigid_stage")
    return plain.using(scene.rigid_stage.overrides, label=_LABEL)


def stage_faults(scene: Scene) -> list[Fault]:
    """Input errors of contacts whose option `surfaces` does not suit the scene, and of a rigid-body
    pre-simulation that ends before the run."""
    faults = []
    elastic = {n for n, body in scene.bodies.items() if _deforms(body)}
    for name, contact in scene.contacts.items():
        key = f"contacts.{name}.surfaces"
        if scene.rigid_stage is not None and contact.deforms:
            faults.append(Fault(key, "a rigid stage knows no deformed surfaces: take `rigid`, or "
                                "drop rigid_stage to evaluate this contact inside the step"))
        touched = elastic & {side.partition(":")[0] for side in contact.sides}
        if scene.rigid_stage is None and not contact.deforms and touched:
            faults.append(Fault(
                key, f"{', '.join(sorted(touched))}: contact of rigid surfaces inside the step "
                "would not deform this body: add `rigid_stage: {}` to the scene, or "
                "take `deformed`"))
    if scene.rigid_stage is not None:
        if scene.initial is not None:
            faults.append(Fault("initial", "with a rigid stage the motion starts from the poses of "
                                "the bodies: drop it, or continue the run with --resume"))
        end = rigid_scene(scene).time.end
        if end < scene.time.end * (1 - 1e-9):
            faults.append(Fault(
                "rigid_stage.overrides", f"the rigid stage ends at {end:g} s, before the run at "
                f"{scene.time.end:g} s: extend its end"))
    return faults


def _deforms(body: BodyPlugin) -> bool:
    """True if the option `fields` of a body selects a displacement field."""
    kinds = {k.name for k in body.field_kinds if k.quantity is Quantity.DISPLACEMENT}
    return not kinds.isdisjoint(body.selected_fields or ())


def rigid_model(scene: Scene, body_cache: BodyCache) -> Model:
    """Model of the scene of a rigid-body pre-simulation, assembled once per `body_cache`."""
    key = scene.digest()
    if key not in body_cache.models:
        body_cache.models[key] = assemble(scene, Immobile(), body_cache)
    return body_cache.models[key]


def staged(scene: Scene, products: Products, manager: Manager, body_cache: BodyCache) -> Model:
    """Flexible model of a two-stage scene, with the motion and loads of its rigid-body
    pre-simulation, which is run here or read from the cache.

    Raises SolveFailed, with a detail that begins with "rigid stage", if the pre-simulation stops
    early.
    """
    rigid = rigid_scene(scene)
    model = rigid_model(rigid, body_cache)
    key = digest(rigid.digest(), Identity.from_scene(rigid).plain(), mesh_content(model))
    arrays = products.remember("rigid_stage", key, lambda: _run(rigid, model, manager))
    imported = _Imported(_stage(arrays), products, key, scene)
    flexible = assemble(scene, imported, body_cache)
    return replace(flexible, stage=replace(imported.stage, contacts=imported.histories))


class _Imported(Followed):
    """Prescribed motion, with surface loads of contacts computed through the cache. key: digest of
    the pre-simulation, bodies and contacts; histories: contact -> recorded contact quantities by
    name."""

    def __init__(self, stage: Stage, products: Products, key: str, scene: Scene) -> None:
        super().__init__(stage)
        self.products, self.key = products, digest(key, scene.digest("bodies", "contacts"))
        self.histories: dict[str, Mapping[str, FloatArray]] = {}

    def surface_loads(
        self, name: str, contact: Contact, motion: Mapping[str, FrameHistory]
    ) -> Mapping[str, SurfaceLoads]:
        """Contact loads on the surfaces of each body along the motion of the rigid stage, kept in
        the cache as arrays `nodes.BODY`, `force.BODY` and `heat.BODY` (`SurfaceLoads`); with them
        `history.QUANTITY`, its values at all times."""
        def make() -> Arrays:
            pressed = loads_along(contact, motion)
            made: dict[str, FloatArray | IntArray] = {
                f"history.{n}": np.asarray(h) for n, h in contact.history(motion).items()}
            for body, loads in pressed.items():
                made |= {f"nodes.{body}": loads.nodes, f"force.{body}": loads.force,
                         f"heat.{body}": loads.heat}
            return made

        arrays = self.products.remember("surface_loads", digest(self.key, name), make)
        self.histories[name] = _under("history", arrays)
        return {
            body: SurfaceLoads(nodes, arrays[f"force.{body}"], arrays[f"heat.{body}"])
            for body, nodes in _under("nodes", arrays).items()}


@np.errstate(all="ignore")  # overflow is a status of the step, not a warning
def _run(scene: Scene, model: Model, manager: Manager) -> Arrays:
    """Results of the rigid-body pre-simulation at T times: times (T,), s; per body pose, rate and
    acceleration (T, 3, n); per joint Lagrange multipliers (T, l), their names and units and, from
    `reactions_passed_on(times, multipliers, poses)`, the reaction forces for the flexible model."""
    layout = model.layout
    try:
        states = list(full_run(scene, model, Offline.from_snapshots(model, {}), manager, STAGE))
    except SolveFailed as failure:
        if failure.status is not Status.STEP_TOO_LONG:
            raise
        raise SolveFailed(failure.status, failure.time, failure.block,
                          f"{failure.detail}; {_OWN_STEPS}") from None
    times = np.array([s.t for s in states])
    components = model.multiplier_components
    frames = {b.owner: np.stack([np.stack([s.x, s.v, s.a])[:, layout[b.name]] for s in states])
              for b in layout if b.kind.quantity is Quantity.POSE}
    arrays: dict[str, Any] = {
        "times": times, "moves": np.array(sorted(frames)),
        "dropped": np.array(resolved_start(model, scene.integrator, scene.time.step).dropped)}
    for name, body in model.bodies.items():
        if name not in frames:
            pose = body.pose
            frames[name] = np.stack([pose, 0 * pose, 0 * pose])[None].repeat(len(times), axis=0)
    arrays |= {f"frame.{name}": values for name, values in frames.items()}
    poses = {name: values[:, 0] for name, values in frames.items()}
    joints = model.joints
    for b in layout:
        if b.kind.order == 0 and b.owner in scene.joints:
            reactions = np.stack([s.x[layout[b.name]] for s in states])
            arrays[f"reaction.{b.owner}"] = reactions
            if b.name in components:
                arrays[f"components.{b.owner}"] = np.array(components[b.name])
            arrays[f"handed.{b.owner}"] = joints[b.owner].reactions_passed_on(
                times, reactions, poses)
    return arrays


def _stage(arrays: Arrays) -> Stage:
    """Rigid-body pre-simulation from its cached arrays (`_run`)."""
    times = np.asarray(arrays["times"])
    frames = {n: FrameHistory(times, *(np.ascontiguousarray(m[:, i]) for i in range(3)))
              for n, m in _under("frame", arrays).items()}
    components = {name: tuple((str(what), str(unit)) for what, unit in kept)
                  for name, kept in _under("components", arrays).items()}
    return Stage(times, frames, moves=frozenset(str(n) for n in arrays["moves"]),
                 reactions=_under("reaction", arrays), contacts={},
                 reactions_passed_on=_under("handed", arrays), dropped=float(arrays["dropped"]),
                 components=components)


def _under(group: str, arrays: Arrays) -> Arrays:
    """Arrays whose names are `group.x`, by x."""
    return {n.partition(".")[2]: np.asarray(a) for n, a in arrays.items()
            if n.partition(".")[0] == group}


def check_rigid(scene: Scene, body_cache: BodyCache) -> None:
    """Checks that the model of the rigid-body pre-simulation can be built. Raises InputError with
    the keys of the scene where both have them, else with keys under `rigid_stage`."""
    try:
        rigid_model(rigid_scene(scene), body_cache)
    except InputError as error:
        raise InputError([Fault(f.key, f"in the rigid stage: {f.message}")
                          for f in error.faults]) from None
