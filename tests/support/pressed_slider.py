"""The paper's slider pressed on a plate and pushed along, on coarse meshes, inside the step."""

from functools import cache
from typing import Any

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.model import Model
from sparsemor.core.scene.scene import Scene
from sparsemor.core.testing.in_memory_run import March, march, scene_of

SIDE, STEP = 1.25e-3, 3.75e-6
LOAD = 10e6 * SIDE**2
"""N on the slider."""
BOTH = ["elastic", "thermal"]


def scene(
    fields: list[str], *, stiffer: float = 1.0, plate: tuple[int, int] = (18, 4), steps: int = 40,
    conductance: float = 0.0, surfaces: str = "deformed", slider: dict[str, Any] | None = None,
    reducer: Any = "full",
) -> Scene:
    """The paper's slider and plate on coarse meshes; friction drags, so the slider tilts."""
    material = {"E": 70e9 * stiffer, "nu": 0.3, "rho": 2700, "alpha": 2.38e-5, "k": 150, "c": 900}
    body = {"use": "flexible", "thickness": SIDE, "material": material, "model": "plane_strain",
            "fields": fields, "reference_temperature": 0.0}
    holds = "elastic" in fields
    contact: dict[str, Any] = {
        "use": "polygonal", "between": ["slider:bottom", "plate:top"], "surfaces": surfaces,
        "normal": {"use": "elastic_foundation", "stiffness": 6.11e13, "damping": 6.1214e4,
                   "damping_depth": 1e-9},
        "friction": {"use": "coulomb", "coefficient": 0.2, "critical_velocity": 0.05}}
    if "thermal" in fields:
        contact["heat"] = {"share": "effusivity", "conductance": conductance}
    return scene_of({
        "bodies": {
            "slider": {**body, "pose": {"velocity": [1.0, 0.0]}, **(slider or {}),
                       "mesh": {"use": "rectangle", "size": [SIDE, SIDE], "divisions": [6, 6]},
                       "sets": {"drive": {"nearest": [SIDE / 2, SIDE]}},
                       **({"reference": {"chord": ["top_left", "top_right"]}} if holds else {})},
            "plate": {**body, "frame": "fixed",
                      "mesh": {"use": "rectangle", "lower": [0.0, -SIDE],
                               "size": [plate[0] / 18 * 4 * SIDE, SIDE], "divisions": list(plate)},
                      **({"reference": {"clamp": "bottom"}} if holds else {})}},
        "joints": {"drive": {"use": "prescribed_motion", "of": "slider:drive",
                             "x": {"use": "ramp", "end": 1.0, "final": 1.0}}},
        "contacts": {"sole": contact},
        "loads": {"press": {"use": "traction", "on": ["slider:top"], "axes": "space",
                            "traction": [0.0, -10e6]}},
        "time": {"end": steps * STEP, "step": STEP}, "integrator": "bdf1",
        "reducer": reducer})


@cache
def full() -> March:
    return march(scene(BOTH))


def forces(run: March) -> FloatArray:
    """(n,) what the contact adds to the forces and heats of all unknowns at the end."""
    term, end = run.model.separated.other[0], run.end
    j, out = term.columns, np.zeros(run.model.layout.size)
    out[term.rows] = -term.residual(end.x[j], end.v[j], end.a[j], end.t)
    return out


def stored(model: Model, x: FloatArray) -> FloatArray:
    """(M,) heat in all bodies above 0, J, for states in rows."""
    return np.asarray(sum(x[:, model.layout[h.thermal]] @ h.capacity.sum(axis=0)
                          for h in model.separated.heat))
