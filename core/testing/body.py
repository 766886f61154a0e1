"""Law kit of a body."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.assembly import assemble
from sparsemor.core.protocols.body import Body, BodyPlugin
from sparsemor.core.protocols.layout import Quantity
from sparsemor.core.protocols.poses import KNOWN
from sparsemor.core.protocols.prescribed_motion import FrameHistory
from sparsemor.core.testing.joints_contacts_loads import check_parts, derivative, runs, small_scene
from sparsemor.core.testing.random_inputs import law


def check_body(
    plugin: BodyPlugin, folder: Path | None = None, seed: int = 0, points: Sequence[str] = ()
) -> None:
    """Laws of a body: equal results of two builds; consistent blocks, initial values and geometry;
    terms that satisfy the laws of a term (`check_term`); symmetric positive semidefinite mass and
    capacity matrices; no rigid unknowns under a prescribed motion of its frame, if the body
    supports that; positions and motions of named points that fit its unknowns; a short run.

    The body is free and without loads, so it needs unknowns of its own. folder: that of the scene
    file, for relative paths; points: names of sets on which joints and forces may act.
    """
    base = Path.cwd() if folder is None else folder
    one, other = (plugin.build("body", base) for _ in range(2))
    law(one.name == "body", f"it was built as 'body' and calls itself {one.name!r}")
    _blocks(one)
    for name, values in one.initial().items():
        again = other.initial()[name]
        law(all(np.array_equal(a, b) for a, b in zip(values, again, strict=True)),
            f"two builds start {name} differently")
    _follows(one)
    for which in points:
        _point(one, which)
    scene = small_scene({"body": plugin})
    check_parts(scene, seed)
    model = assemble(scene)
    _definite(derivative(model, 2)[model.layout.second, model.layout.second], "mass")
    _definite(derivative(model, 1)[model.layout.first, model.layout.first], "capacity")
    runs(scene)


def _blocks(body: Body) -> None:
    """Checks names, owners and sizes of a body's blocks, their initial values and their
    positions."""
    blocks = {b.name: b for b in body.blocks()}
    law(len(blocks) == len(body.blocks()), "two of its blocks have one name")
    law(any(b.size for b in blocks.values()), "it has no unknowns")
    for name, b in blocks.items():
        law(b.owner == body.name, f"{name} is owned by {b.owner!r}, not by the body")
    for name, (x, v) in body.initial().items():
        law(name in blocks, f"`initial` has {name}, which is none of its blocks")
        n = blocks[name].size
        law(not n or x.shape == v.shape == (n,),
            f"`initial` of {name} has shapes {x.shape} and {v.shape}, not ({n},)")
    geometry = body.geometry()
    for name, b in blocks.items():
        if not (b.kind.reducible and b.size):
            continue
        law(name in geometry, f"`geometry` lacks {name}, which is reducible")
        points, component = geometry[name]
        law(points.ndim == 2 and len(points) == b.size and component.shape == (b.size,),
            f"`geometry` of {name} does not fit its {b.size} unknowns")


def _follows(body: Body) -> None:
    law(len(body.pose) in KNOWN, f"its pose has {len(body.pose)} coordinates, not 3, 4 or 7")
    with_motion = body.with_motion(FrameHistory.standing(body.pose))
    if with_motion is not None:
        held = [b.name for b in with_motion.blocks() if b.kind.quantity is Quantity.POSE and b.size]
        law(not held, f"its frame follows a motion and still has the unknowns {held}")
    rigid = body.rigid_copy()
    if rigid is not None:
        left = [b.name for b in rigid.blocks() if b.kind.reducible and b.size]
        law(not left, f"its rigid copy still has the fields {left}")


def _point(body: Body, which: str) -> None:
    """Position, displacement and rotation of the centre of a set."""
    d, n = body.d, sum(b.size for b in body.blocks() if b.kind.quantity is Quantity.DISPLACEMENT)
    X, u = body.point_of(which, "points"), body.displacement_of(which)
    law(X.shape == (d,), f"the position of {which!r} has the shape {X.shape}, not ({d},)")
    law((u is None) is (n == 0), f"`displacement_of` {which!r} is None for a rigid body alone")
    law(u is None or u.shape == (n, d), f"`displacement_of` {which!r} has not the shape ({n}, {d})")
    turns = body.rotation_of(which, "points") if u is not None else None
    law(turns is None or turns.shape == (n, 2 * d - 3),
        f"`rotation_of` {which!r} has not the shape ({n}, {2 * d - 3})")
    law(u is None or bool(u.any()) <= body.deforms_at(which),
        f"{which!r} has a displacement, and `deforms_at` denies it")
    probe = body.probe("probe", which)
    if probe is not None:
        law(np.array_equal(probe.point, X), f"a probe of {which!r} is at another position")
        law(u is None or np.array_equal(u, np.asarray(probe.displacement)),
            f"a probe of {which!r} has another displacement")


def _definite(M: FloatArray, what: str) -> None:
    if not M.size:
        return
    size = float(np.abs(M).max())
    law(float(np.abs(M - M.T).max()) <= 1e-9 * size, f"its {what} matrix is not symmetric")
    least = float(np.linalg.eigvalsh(0.5 * (M + M.T))[0])
    law(size > 0.0 and least >= -1e-9 * size, f"its {what} matrix has the eigenvalue {least:.3g}")
