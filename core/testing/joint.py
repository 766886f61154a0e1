"""Law kit of a joint."""

import numpy as np

from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.model import Model
from sparsemor.core.protocols import JointPlugin, Quantity
from sparsemor.core.testing.assembled import (
    Entries,
    derivative,
    refuses_absent_bodies,
    runs,
    small_scene,
    start_residual,
)
from sparsemor.core.testing.parts import check_parts, terms_of
from sparsemor.core.testing.random_inputs import law

NAME = "joint"


def check_joint(plugin: JointPlugin, bodies: Entries, seed: int = 0) -> None:
    """Laws of a joint: terms that satisfy the laws of a term (`check_term`); constraint rows that
    are independent and satisfied at the start; reaction forces that do no work along the constraint
    (their matrix is the transpose of the constraint rows); one name per Lagrange multiplier, if the
    joint names them; a short run. A force element, such as a spring, has no constraint rows.

    bodies: those that the joint connects, as entries of a scene.
    """
    refuses_absent_bodies(plugin)
    scene = small_scene(bodies, joints={NAME: plugin})
    check_parts(scene, seed)
    model = assemble(scene)
    joint = model.joints[NAME]
    block = model.layout.multipliers(NAME)
    if block is None:
        forces = any(len(term.rows) for term in terms_of(model, NAME))
        law(forces or bool(joint.adjusted),
            "it has no multipliers, adds no forces and changes no body")
    else:
        law(not joint.components or len(joint.components) == block.size,
            f"{len(joint.components)} named multipliers of {block.size}")
        _constraint(model, model.layout[block.name])
    runs(scene)


def _constraint(model: Model, rows: slice) -> None:
    K = derivative(model, 0)
    second = model.layout.second
    G, reactions = K[rows, second], K[second, rows]
    size = float(np.abs(G).max(initial=0.0))
    law(size > 0.0, "its constraint rows do not depend on any motion")
    law(float(np.abs(G - reactions.T).max()) <= 1e-9 * size,
        "its reaction forces do work: their matrix is not the transposed one of the constraint "
        "rows")
    lengths = np.linalg.norm(G, axis=1)
    law(bool((lengths > 0).all()), "a constraint row does not depend on any motion")
    least = float(np.linalg.svd(G / lengths[:, None], compute_uv=False)[-1])
    law(least > 1e-9, "its constraint rows depend on each other")
    away = float(np.abs(start_residual(model)[rows]).max())
    law(away <= 1e-8 * max(1.0, _extent(model)),
        f"its constraint has an error of {away:.3g} at the start")


def _extent(model: Model) -> float:
    """Largest absolute coordinate of the body frames at the start, m or rad."""
    poses = [model.x0[model.layout[b.name]] for b in model.layout
             if b.kind.quantity is Quantity.POSE]
    return float(np.abs(np.concatenate([np.zeros(1), *poses])).max())
