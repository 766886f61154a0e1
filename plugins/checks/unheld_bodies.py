"""Note on bodies that nothing holds: no joint, contact or prescribed motion leads to the ground."""

import numpy as np

from sparsemor.core import Check, Model, Note, Plugin, Quantity, Scene, information
from sparsemor.core.model.assembly import mentioned
from sparsemor.plugins.checks import place

GROUND = ""


class UnheldBodies(Check):
    """Bodies that nothing holds."""

    order = place("unheld_bodies")

    def on_model(self, scene: Scene, model: Model | None) -> tuple[Note, ...]:
        return () if model is None else unheld_bodies(scene, model)


def unheld_bodies(scene: Scene, model: Model) -> tuple[Note, ...]:
    """Warning about bodies that are free although others are held, as with a joint that is missing;
    information where no body is held, and the free ones start at rest under loads.

    Connections are the names of bodies in the options of joints and contacts; one that names a
    single body holds it. A body whose frame is no unknown is held.
    """
    frames = {b.owner: b for b in model.layout if b.kind.quantity is Quantity.POSE}
    bodies = [name for name in scene.bodies if name in frames]
    group = {name: name for name in bodies} | {GROUND: GROUND}
    connectors = [*scene.joints.values(), *scene.contacts.values()]
    for connector in connectors:
        if connector.acts_on == "temperature":
            continue
        named = mentioned(connector, scene.bodies)
        ends = {name if name in frames else GROUND for name in named}
        ends |= {GROUND} if len(named) == 1 else set()
        joined = {group[e] for e in ends}
        group = {name: min(joined) if g in joined else g for name, g in group.items()}
    free = [name for name in bodies if group[name] != group[GROUND]]
    if not free:
        return ()
    names, many = " and ".join(free), len(free) > 1
    if len(free) < len(bodies):
        return (Note(
            f"{names} {'hang' if many else 'hangs'} on nothing: no joint, contact or prescribed "
            f"motion connects {'them' if many else 'it'} with the ground, as the other bodies "
            "are; is a joint missing?", "unheld_body"),)
    v = model.v0
    moves = any(np.any(v[model.layout[frames[n].name]]) for n in free)
    pushed = any(mentioned(load, scene.bodies) or not _names_bodies(load)
                 for load in scene.loads.values()
                 if load.acts_on == "motion")
    if connectors or moves or not pushed:
        return ()
    return (information(
        f"no joint, contact or prescribed motion holds {names}, at rest at the start: the loads "
        "will drive it away; a body that is to stay in its place takes `frame: fixed`",
        "unheld_body"),)


def _names_bodies(load: object) -> bool:
    """True if a load has an option for the sets or bodies on which it acts."""
    return isinstance(load, Plugin) and bool({"on", "of", "body", "between"} & set(
        type(load).model_fields))
