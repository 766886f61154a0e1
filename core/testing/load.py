"""Law kit of a load."""

import numpy as np

from sparsemor.core.model.assembly import assemble
from sparsemor.core.protocols import Load, LoadPlugin
from sparsemor.core.testing.assembled import (
    Entries,
    refuses_absent_bodies,
    runs,
    small_scene,
    without_unknowns,
)
from sparsemor.core.testing.parts import check_parts, terms_of
from sparsemor.core.testing.random_inputs import law

NAME = "load"


def check_load(plugin: LoadPlugin, bodies: Entries, seed: int = 0) -> None:
    """Laws of a load: no unknowns of its own; terms that satisfy the laws of a term (`check_term`)
    and enter equations of motion or heat, those of heat alone if the plugin declares so; a short
    run.

    bodies: those that the load acts on, as entries of a scene.
    """
    refuses_absent_bodies(plugin)
    scene = small_scene(bodies, loads={NAME: plugin})
    check_parts(scene, seed)
    model = assemble(scene)
    part, layout = model.parts[NAME], model.layout
    without_unknowns(part)
    rows = np.concatenate([t.rows for t in terms_of(model, NAME)] or [np.zeros(0, np.int64)])
    law(rows.size > 0, "it acts on none of the bodies")
    law(bool((rows < layout.algebraic.start).all()), "it acts on rows of multipliers")
    if plugin.acts_on == "temperature":
        law(bool((rows >= layout.first.start).all()),
            "it states that it acts on temperatures, and acts on motion too")
    if isinstance(part, Load) and part.surroundings is not None:
        law(np.isfinite(part.surroundings(0.0)), "its surroundings have no finite temperature")
    runs(scene)
