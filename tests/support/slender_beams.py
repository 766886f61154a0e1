"""Slender beams: columns under axial force or heat, and beams that turn about their end."""

from functools import cache
from typing import Any

import numpy as np

from sparsemor import simulate
from sparsemor.core.arrays import FloatArray
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.scene import Scene
from sparsemor.core.testing.in_memory_run import scene_of

E, L, H, ALPHA = 7e10, 1.0, 0.02, 1.2e-5
EULER = np.pi**2 * E * H**4 / 12.0
"""Euler load of a bar of square section, pinned at both ends, N."""
STILL = {"time": {"end": 1e4, "step": 1e3}, "integrator": "bdf1"}
"""Long damped steps, which end at rest."""


def beam(n: int = 10, space: bool = False, height: float = H, **more: Any) -> dict[str, Any]:
    """A beam of square section along x."""
    mesh = {"use": "block", "lower": [0.0, -height / 2, -height / 2], "size": [L, height, height],
            "divisions": [n, 1, 1]} if space else {
        "use": "rectangle", "lower": [0.0, -height / 2], "size": [L, height], "divisions": [n, 1]}
    return {"use": "flexible", "mesh": mesh, "order": 2, "fields": ["elastic"],
            "strains": "nonlinear", "material": {"E": E, "nu": 0.0, "rho": 2700.0},
            "reference": {"clamp": "left"}, **({} if space else {"thickness": height}), **more}


def column(
    strains: str, push: float, rise: float = 0.0, fields: Any = ("elastic",), modulus: Any = E
) -> Scene:
    """A bar pinned at both ends under a small pressure from above, pushed by a force, or heated
    between walls."""
    heat = {"k": 200.0, "c": 900.0, "alpha": ALPHA if modulus == E else 0.0}
    body = beam(20, strains=strains, fields=list(fields), initial_temperature=293.15 + rise,
                sets={"a": {"nearest": [0.0, 0.0]}, "e": {"nearest": [L, 0.0]}},
                reference={"chord": ["a", "e"]},
                material={"E": modulus, "nu": 0.0, "rho": 2700.0, **heat})
    wall = {} if push or not rise else {"x": 0.0}
    return scene_of({
        "bodies": {"b": body}, **STILL, "joints": {
            "pin": {"use": "revolute", "between": ["ground", "b:left"]},
            "roll": {"use": "prescribed_motion", "of": "b:right", "y": 0.0, **wall}},
        "loads": {"pushed": {"use": "point_force", "on": "b:right", "force": [-push, 0.0]},
                  "pressed": {"use": "traction", "on": ["b:top"], "traction": [0.0, -300.0]}}})


def middle(run: RunResult) -> float:
    """Deflection of the middle below the ends."""
    X, y = run.points("b"), run.nodal_displacement("b", -1)[:, 1]
    ends = [y[X[:, 0] == x].mean() for x in (0.0, L)]
    return float(y[np.abs(X - [L / 2, 0.0]).sum(axis=1).argmin()] - np.mean(ends))


def tip(run: RunResult) -> FloatArray:
    """Displacement of the mean of the right end."""
    return np.asarray(run.nodal_displacement("b", -1)[run.points("b")[:, 0] == L].mean(axis=0))


@cache
def plain() -> float:
    """Deflection without axial force, with linear strains."""
    return middle(simulate(column("linear", 0.0)))


def spinning(ratio: float, strains: str, **more: Any) -> Scene:
    """A beam that turns about its end, with `ratio` of its lowest natural frequency, under a force
    that turns with it."""
    spin = ratio * 3.51602 * H * np.sqrt(E / (12.0 * 2700.0)) / L**2
    return scene_of({
        "bodies": {"b": beam(20, strains=strains, damping={"mass": 30.0}, pose={"spin": spin})},
        "joints": {"j": {"use": "prescribed_motion", "of": "b:left", "x": 0.0, "y": 0.0, "angle": {
            "use": "ramp", "start": 0.0, "end": 100.0, "final": 100.0 * spin}}},
        "loads": {"f": {"use": "traction", "on": ["b:right"], "traction": [0.0, 2500.0],
                        "axes": "body",
                        "factor": {"use": "smooth_step", "end": 0.3, "final": 1.0}}},
        "time": {"end": 1.0, "step": 2e-3},
        "integrator": {"use": "generalized_alpha", "rho_inf": 0.8}, "output": {"every": 50},
        **more})
