"""Law kit of a contact."""

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.model import Model
from sparsemor.core.protocols import ContactPlugin, Quantity
from sparsemor.core.protocols.poses import PLANAR_POSE
from sparsemor.core.testing.assembled import (
    Entries,
    refuses_absent_bodies,
    runs,
    small_scene,
    without_unknowns,
)
from sparsemor.core.testing.parts import check_parts, terms_of
from sparsemor.core.testing.random_inputs import law

NAME = "contact"
TRIALS = 20


def check_contact(
    plugin: ContactPlugin, bodies: Entries, seed: int = 0, scale: float = 1e-3
) -> None:
    """Laws of a contact: no unknowns of its own; terms that satisfy the laws of a term
    (`check_term`); forces on both bodies that sum to zero, in the plane also their moments; a short
    run.

    bodies: two that touch at the start, as entries of a scene. scale: standard deviation of the
    random changes of their poses and rates (m, rad, per s).
    """
    refuses_absent_bodies(plugin)
    scene = small_scene(bodies, contacts={NAME: plugin})
    model = assemble(scene)
    without_unknowns(model.parts[NAME])
    check_parts(scene, seed)
    rng, met = np.random.default_rng(seed), False
    for trial in range(TRIALS):
        x, v = (s + scale * rng.standard_normal(s.size) for s in (model.x0, model.v0))
        f = np.zeros(model.layout.size)
        for term in terms_of(model, NAME):
            c = term.columns
            np.add.at(f, term.rows, term.residual(x[c], v[c], np.zeros(len(c)), 0.0))
        total, size = _resultant(model, x, f)
        met = met or size > 0.0
        law(float(np.abs(total).max(initial=0.0)) <= 1e-9 * size,
            f"action and reaction differ by {np.abs(total).max(initial=0.0):.3g} of {size:.3g} N "
            f"(seed {seed}, trial {trial})")
    law(met, f"the bodies do not touch in {TRIALS} states near the start")
    runs(scene)


def _resultant(model: Model, x: FloatArray, f: FloatArray) -> tuple[FloatArray, float]:
    """Sum of the forces on all body frames (d,), in the plane with their moments about the origin,
    and the largest absolute component; for bodies whose frames have unknowns."""
    found = []
    for b in model.layout:
        if b.kind.quantity is not Quantity.POSE:
            continue
        at = model.layout[b.name]
        F, R = f[at], x[at]
        if b.size == PLANAR_POSE:
            found.append(np.array([F[0], F[1], F[2] + R[0] * F[1] - R[1] * F[0]]))
        else:
            found.append(F[:3])
    law(len(found) > 1 and len({len(F) for F in found}) == 1,
        "give two bodies that move, both in the plane or both in space")
    return np.sum(found, axis=0), float(np.abs(found).max())
