"""A block in contact with a plate, in the plane and in space, for the laws of contact terms."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sparsemor.bodies.contact.contact_term import ContactTerm
from sparsemor.bodies.frames.attitude import attitude
from sparsemor.bodies.frames.rotation import about, product
from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.model import Model
from sparsemor.core.testing.in_memory_run import scene_of

MATERIAL = {"E": 7e8, "nu": 0.3, "rho": 2700, "alpha": 2e-5, "k": 150, "c": 900}
NORMAL = {"use": "elastic_foundation", "stiffness": 1e9, "damping": 1e5, "damping_depth": 1e-3}
FRICTION = {"use": "coulomb", "coefficient": 0.3, "critical_velocity": 0.05}
STICK = {"use": "stick", "coefficient": 0.3, "displacement": 1e-3, "static": 0.4,
         "decay_velocity": 0.1}
CASES = ("flat", "open", "bent", "wedge")
"""A block that stands on a plate, over its end, on an edge of it, or with an edge in it."""
KINDS: list[tuple[str, tuple[str, ...], dict[str, Any]]] = [
    ("rigid", (), {}),
    ("rigid", ("thermal",), {"conductance": 3e3}),
    ("deformed", ("elastic",), {}),
    ("deformed", ("elastic", "thermal"), {"share": 0.7, "conductance": 3e3}),
]
"""surfaces, fields, heat"""


def body(
    lower: list[float], size: list[float], divisions: list[int], fields: list[str], clamp: str,
    **options: Any,
) -> dict[str, Any]:
    """A box in as many dimensions as `lower` has; its set `skirt` is its base and one side."""
    flat = len(lower) == 2
    reference = {"reference": {"clamp": clamp}} if "elastic" in fields else {}
    mesh = {"use": "rectangle" if flat else "block", "lower": lower, "size": size,
            "divisions": divisions}
    skirt = f"{'y' if flat else 'z'} < {lower[-1] + 1e-9} or x > {lower[0] + size[0] - 1e-9}"
    return {"use": "flexible", "material": MATERIAL, "fields": fields, "mesh": mesh, **reference,
            "sets": {"skirt": {"where": skirt}}, **({"thickness": 0.02} if flat else {}), **options}


def scene(
    block: dict[str, Any], plate: dict[str, Any], heat: dict[str, Any], **contact: Any
) -> Any:
    """Both bodies and the contact `sole`."""
    sole = {"use": "polygonal", "normal": NORMAL, "friction": FRICTION, **contact}
    return scene_of({
        "bodies": {"block": block, "plate": plate}, "time": {"end": 1e-3, "step": 1e-4},
        "contacts": {"sole": sole | ({"heat": heat} if heat else {})}})


def in_plane(
    case: str, surfaces: str = "rigid", fields: tuple[str, ...] = (),
    normal: dict[str, Any] = NORMAL, friction: dict[str, Any] = FRICTION, **heat: Any,
) -> Model:
    x, angle, tilt, between = {
        "flat": (0.0, 0.02, 0.0, ["block:bottom", "plate:top"]),
        "open": (0.19, 0.02, 0.0, ["block:bottom", "plate:top"]),
        "bent": (0.0, 0.0, 0.8, ["plate:top", "block:skirt"]),
        "wedge": (0.0, 0.0, 0.8, ["block:skirt", "plate:top"]),
    }[case]
    of = list(fields)
    block = body([-0.05, 0.0], [0.1, 0.05], [4, 2], of, "top", pose={
        "position": [x, 0.0], "angle": angle - tilt, "velocity": [0.1, -0.01], "spin": 0.1})
    if tilt:  # its lower right corner is at the origin
        corner = np.exp(1j * (angle - tilt)) * 0.05
        block["pose"]["position"] = [-corner.real, -corner.imag]
    plate = body([-0.2, -0.1], [0.4, 0.1], [7, 2], of, "bottom",
                 pose={"angle": 0.001, "spin": 0.03})
    return assemble(scene(block, plate, heat, between=between, surfaces=surfaces, normal=normal,
                          friction=friction))


def turned(*parts: tuple[list[float], float]) -> FloatArray:
    """Quaternion of turns about axes, the first one last."""
    q = np.array([1.0, 0.0, 0.0, 0.0])
    for axis, angle in parts:
        q = product(q, about(axis, angle))
    return q


def in_space(
    case: str, surfaces: str = "rigid", fields: tuple[str, ...] = (), plate: str | None = None,
    normal: dict[str, Any] = NORMAL, friction: dict[str, Any] = FRICTION, **heat: Any,
) -> Model:
    x, tilt, between = {
        "flat": (0.0, 0.0, ["block:bottom", "plate:top"]),
        "open": (0.19, 0.0, ["block:bottom", "plate:top"]),
        "bent": (0.0, 0.8, ["plate:top", "block:skirt"]),
        "wedge": (0.0, 0.8, ["block:skirt", "plate:top"]),
    }[case]
    of = list(fields)
    q = turned(([0, 0, 1], 0.3), ([0, 1, 0], tilt or 0.02))
    block = body([-0.05, -0.03, 0.0], [0.1, 0.06, 0.05], [2, 1, 1], of, "top", pose={
        "position": [x, 0.0, 0.0], "quaternion": q.tolist(), "velocity": [0.1, 0.05, -0.01],
        "spin": [0.1, 0.2, -0.3]})
    if tilt:  # its lower right edge is at the height of the origin
        corner = attitude(q).A @ [0.05, 0.0, 0.0]
        block["pose"]["position"] = (-corner).tolist()
    still: dict[str, Any] = {"frame": plate} if plate else {
        "pose": {"quaternion": turned(([1, 1, 0], 0.001)).tolist(), "spin": [0.0, 0.1, 0.03]}}
    base = body([-0.2, -0.1, -0.1], [0.4, 0.2, 0.1], [4, 2, 1], of, "bottom", **still)
    return assemble(scene(block, base, heat, between=between, surfaces=surfaces, normal=normal,
                          friction=friction, tolerance=1e-3))


def on_a_rigid_plate(d: int) -> Any:
    """The scene of a coarse block with both fields on a plate that stays."""
    lower, size = [-0.05, -0.03, 0.0], [0.1, 0.06, 0.05]
    low, wide = [-0.2, -0.1, -0.1], [0.4, 0.2, 0.1]
    divisions = {2: ([2, 1], [3, 1]), 3: ([1, 1, 1], [2, 1, 1])}[d]
    axes = [0, 2] if d == 2 else [0, 1, 2]
    block, plate = ([[v[i] for i in axes] for v in given]
                    for given in ((lower, size), (low, wide)))
    return scene(body(*block, divisions[0], ["elastic", "thermal"], "top"),
                 body(*plate, divisions[1], [], "bottom", frame="fixed"), {"share": 0.5},
                 between=["block:bottom", "plate:top"], surfaces="deformed")


@dataclass(frozen=True)
class World:
    """Contact in d dimensions; most facets that a node of the block touches; width (m) of the
    smaller body in the plane, of the plate in space."""

    d: int
    model: Callable[..., Model]
    most: int
    width: float

    def term(self, model: Model) -> Any:
        (term,) = model.by_part["sole"]
        assert isinstance(term, ContactTerm)
        return term

    def state(self, m: Model, term: Any, seed: int = 3) -> tuple[FloatArray, FloatArray]:
        """Unknowns and rates at the term's columns, in contact; quaternions keep their length."""
        rng, n = np.random.default_rng(seed), m.layout.second.stop
        x, v = m.x0.copy(), m.v0.copy()
        x[:n] += 1e-4 * rng.standard_normal(n)
        x[self.d - 1] -= 1e-3
        v[:n] += 0.05 * rng.standard_normal(n)
        if self.d == 3:
            for name in ("block", "plate"):
                at = np.arange(3, 7) + m.layout[f"{name}.rigid"].start
                x[at] /= np.linalg.norm(x[at])
                v[at] -= x[at] * (x[at] @ v[at])
        return x[term.columns], v[term.columns]

    def wrench(
        self, pose: FloatArray, rows: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(3,) force in a body's rows, where it acts, and torque about that point, space axes."""
        if self.d == 2:
            return np.array([*rows[:2], 0.0]), np.array([*pose[:2], 0.0]), rows[2] * np.eye(3)[2]
        size = np.linalg.norm(pose[3:])
        turn = attitude(pose[3:] / size)
        # rows of the quaternion are lever @ torque, and lever.T @ lever = 4
        return rows[:3], pose[:3], turn.A @ (turn.lever().T @ rows[3:]) / 4.0 * size


PLANE, SPACE = World(2, in_plane, 2, 0.1), World(3, in_space, 3, 0.2)
