"""Law kits of the parts of an assembled scene: bodies, joints, contacts and loads."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.assembly import assemble, mentioned
from sparsemor.core.model.equations import system_jacobian, system_residual
from sparsemor.core.model.model import Model
from sparsemor.core.protocols.body import Part
from sparsemor.core.protocols.connector import Load, LoadPlugin
from sparsemor.core.protocols.contact import ContactPlugin
from sparsemor.core.protocols.joint import JointPlugin
from sparsemor.core.protocols.layout import Quantity
from sparsemor.core.protocols.poses import PLANAR_POSE
from sparsemor.core.protocols.term import Term
from sparsemor.core.scene.scene import Scene
from sparsemor.core.status import SolveFailed
from sparsemor.core.testing.in_memory_run import March, march
from sparsemor.core.testing.random_inputs import law, refused
from sparsemor.core.testing.term import check_term


def check_parts(scene: Scene, seed: int = 0, trials: int = 2) -> None:
    """Laws of every part (body, joint, contact, load) of a scene: its blocks are in the layout
    (order of all unknowns), its terms satisfy the laws of a term (`check_term`) and use rows and
    columns of the layout, and a second assembly gives the same model."""
    model, again = assemble(scene), assemble(scene)
    law([b.name for b in model.layout] == [b.name for b in again.layout]
        and np.array_equal(model.x0, again.x0) and np.array_equal(model.v0, again.v0),
        "two assemblies of one scene differ")
    finite = np.isfinite(model.x0).all() and np.isfinite(model.v0).all()
    law(bool(finite), "the start is not finite")
    for number, (name, part) in enumerate(model.parts.items()):
        _check_blocks(name, part, model)
        for term in terms_of(model, name):
            _check_term_in_layout(name, term, model, np.random.default_rng([seed, number]), trials)
    _check_required_rows(model.required, model)


def terms_of(model: Model, name: str) -> Sequence[Term]:
    """Terms that the body, joint, contact or load `name` adds to the equations."""
    return model.by_part[name]


def _check_blocks(name: str, part: Part, model: Model) -> None:
    """Checks that the layout has the blocks of a part, with the sizes that it states."""
    law(part.name == name, f"{name} calls itself {part.name}")
    for block in part.blocks():
        if block.size:
            law(block.name in model.layout, f"{name}: block {block.name} is not in the layout")
            at = model.layout[block.name]
            law(at.stop - at.start == block.size, f"{name}: {block.name} has another size there")


def _check_term_in_layout(
    name: str, term: Term, model: Model, rng: np.random.Generator, trials: int
) -> None:
    """Checks that rows and columns of a term of part `name` are in the layout, and the laws of a
    term near the start."""
    layout, n = model.layout, model.layout.size
    inside = all(0 <= i.min(initial=0) and i.max(initial=0) < n for i in (term.rows, term.columns))
    law(inside, f"{name}: rows or columns outside the layout")
    first = layout.first
    # a term of temperatures alone is tried 1 K around the start, another one 1e-3 (m, rad) around
    warm = bool(np.all((term.columns >= first.start) & (term.columns < first.stop)))
    one_order = bool(np.all(term.columns < layout.second.stop)) or warm
    try:
        check_term(term, rng, base=model.x0[term.columns], scale=1.0 if warm else 1e-3,
                   trials=trials, same_rates=one_order)
    except AssertionError as error:
        raise AssertionError(f"{name}: {type(term).__name__}: {error}") from error


def _check_required_rows(required: Mapping[str, object], model: Model) -> None:
    """Checks that the rows of each block that every sample contains are sorted and in the block."""
    for name, rows in required.items():
        at, own = model.layout[name], np.asarray(rows)
        law(bool(np.all(np.diff(own) > 0)), f"the required rows of {name} are not sorted")
        law(own.size == 0 or (own[0] >= 0 and own[-1] < at.stop - at.start),
            f"a required row of {name} is outside the block")


Entries = Mapping[str, Any]
"""Entries of a scene by name: plugins, or mappings as in a scene file."""
STEP, STEPS = 1e-3, 3


def small_scene(bodies: Entries, **others: Entries) -> Scene:
    """A scene of a few full-order steps of 1 ms. others: `joints`, `contacts`, `loads`."""
    return Scene.model_validate({
        "format": 1, "bodies": dict(bodies), "time": {"end": STEPS * STEP, "step": STEP}, **others})


def derivative(model: Model, rate: int) -> FloatArray:
    """Derivative (n, n) of the residual at the start by x (rate 0), v (1) or a (2)."""
    n, large = model.layout.size, 1e10
    at = (model.x0, model.v0, np.zeros(n), 0.0)
    of = partial(system_jacobian, model.layout, model.terms, *at)
    c = np.zeros((3, n))
    K = np.asarray(of(c[1], c[2]).toarray())
    if rate == 0:
        return K
    c[rate] = large
    return np.asarray(of(c[1], c[2]).toarray() - K) / large


def start_residual(model: Model) -> FloatArray:
    """Residual (n,) at the start, with zero accelerations."""
    zero = np.zeros(model.layout.size)
    return system_residual(model.layout, model.terms, model.x0, model.v0, zero, 0.0)


def runs(scene: Scene) -> March:
    """Short run of a small scene. Raises AssertionError if a step fails or a value is not
    finite."""
    try:
        done = march(scene)
    except SolveFailed as error:
        raise AssertionError(f"a run of {STEPS} steps failed: {error}") from error
    law(np.isfinite(done.x).all(), f"values of a run of {STEPS} steps are not finite")
    return done


def refuses_absent_bodies(
    plugin: JointPlugin | ContactPlugin | LoadPlugin, bodies: Entries
) -> None:
    """Checks that a joint, contact or load on bodies that the scene does not have raises
    InputError; one whose options name none of them, such as gravity, may be built."""
    refused("a scene without the bodies that it names", lambda: plugin.build("part", {}),
            optional=not mentioned(plugin, bodies))


def scene_with_only(
    kind: str, plugin: JointPlugin | ContactPlugin | LoadPlugin, bodies: Entries, seed: int
) -> tuple[Scene, Model]:
    """Scene with these bodies and one joint, contact or load, called after its kind, and its model:
    it refuses bodies that are absent, and its parts satisfy their laws (`check_parts`)."""
    refuses_absent_bodies(plugin, bodies)
    scene = small_scene(bodies, **{f"{kind}s": {kind: plugin}})
    check_parts(scene, seed)
    return scene, assemble(scene)


def check_joint(plugin: JointPlugin, bodies: Entries, seed: int = 0) -> None:
    """Laws of a joint: terms that satisfy the laws of a term (`check_term`, called by
    `scene_with_only` as for all parts); constraint rows that are independent and satisfied at the
    start; reaction forces that do no work along the constraint (their matrix is the transpose of
    the constraint rows); one name per Lagrange multiplier, if the joint names them; a short run. A
    force element, such as a spring, has no constraint rows.

    bodies: those that the joint connects, as entries of a scene.
    """
    scene, model = scene_with_only("joint", plugin, bodies, seed)
    joint = model.joints["joint"]
    block = model.layout.multipliers("joint")
    if block is None:
        forces = any(len(term.rows) for term in terms_of(model, "joint"))
        law(forces or bool(joint.adjusted),
            "it has no multipliers, adds no forces and changes no body")
    else:
        law(not joint.components or len(joint.components) == block.size,
            f"{len(joint.components)} named multipliers of {block.size}")
        _check_constraint_rows(model, model.layout[block.name])  # the slice of its unknowns
    runs(scene)


def _check_constraint_rows(model: Model, rows: slice) -> None:
    """Checks that constraint rows depend on motion, independently of each other, are satisfied at
    the start, and that reactions do no work: their matrix is that of the rows transposed."""
    K, second = derivative(model, 0), model.layout.second
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
    return max((float(np.abs(model.x0[model.layout[b.name]]).max()) for b in model.layout
                if b.kind.quantity is Quantity.POSE), default=0.0)


def check_load(plugin: LoadPlugin, bodies: Entries, seed: int = 0) -> None:
    """Laws of a load: no unknowns of its own; terms that satisfy the laws of a term (`check_term`)
    and enter equations of motion or heat, those of heat alone if the plugin declares so; a short
    run.

    bodies: those that the load acts on, as entries of a scene.
    """
    scene, model = scene_with_only("load", plugin, bodies, seed)
    part, layout = model.parts["load"], model.layout
    law(not any(b.size for b in part.blocks()), "a load has no unknowns of its own")
    rows = np.concatenate([t.rows for t in terms_of(model, "load")] or [np.zeros(0, np.int64)])
    law(rows.size > 0, "it acts on none of the bodies")
    law(bool((rows < layout.algebraic.start).all()), "it acts on rows of multipliers")
    if plugin.acts_on == "temperature":
        law(bool((rows >= layout.first.start).all()),
            "it states that it acts on temperatures, and acts on motion too")
    if isinstance(part, Load) and part.surroundings is not None:
        law(np.isfinite(part.surroundings(0.0)), "its surroundings have no finite temperature")
    runs(scene)


TRIALS = 20


def check_contact(
    plugin: ContactPlugin, bodies: Entries, seed: int = 0, scale: float = 1e-3
) -> None:
    """Laws of a contact: terms that satisfy the laws of a term (`check_term`); forces on both
    bodies that sum to zero, in the plane also their moments; a short run.

    bodies: two that touch at the start, as entries of a scene. scale: standard deviation of the
    random changes of their poses and rates (m, rad, per s).
    """
    scene, model = scene_with_only("contact", plugin, bodies, seed)
    rng, met = np.random.default_rng(seed), False
    for trial in range(TRIALS):
        x, v = (s + scale * rng.standard_normal(s.size) for s in (model.x0, model.v0))
        f = np.zeros(model.layout.size)
        for term in terms_of(model, "contact"):
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
        F, R = (s[model.layout[b.name]] for s in (f, x))
        if b.size == PLANAR_POSE:
            found.append(np.array([F[0], F[1], F[2] + R[0] * F[1] - R[1] * F[0]]))
        else:
            found.append(F[:3])
    law(len(found) > 1 and len({len(F) for F in found}) == 1,
        "give two bodies that move, both in the plane or both in space")
    return np.sum(found, axis=0), float(np.abs(found).max())
