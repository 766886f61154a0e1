"""Runs of bodies and joints alone; two flexible links with a torque, a motor and springs."""

from typing import Any

from sparsemor.core.testing.in_memory_run import March, march, scene_of

ALPHA = {"use": "generalized_alpha", "rho_inf": 0.8}


def run(
    bodies: dict[str, Any], joints: dict[str, Any], end: float, h: float,
    loads: dict[str, Any] | None = None, integrator: Any = ALPHA,
) -> March:
    """Steps of h to the end, s."""
    return march(scene_of({"bodies": bodies, "joints": joints, "loads": loads or {},
                           "time": {"end": end, "step": h}, "integrator": integrator}))


BAR = {"use": "flexible", "thickness": 0.02, "fields": ["elastic"], "reference": {"clamp": "left"},
       "mesh": {"use": "rectangle", "lower": [0.0, -0.05], "size": [0.5, 0.1],
                "divisions": [8, 2]},
       "material": {"E": 5e8, "nu": 0.3, "rho": 1100}}


def moved(body: dict[str, Any], x: float, y: float, **more: Any) -> dict[str, Any]:
    """The body at a position in the plane."""
    return {**body, "pose": {"position": [x, y], **more}}


def driven(reducer: Any = "full", h: float = 1e-3) -> dict[str, Any]:
    """Two flexible links, a torque, a motor between them, and springs from and between them."""
    links = {"one": BAR, "two": moved(BAR, 0.5, 0.0)}
    return {
        "bodies": links, "reducer": reducer, "time": {"end": 0.04, "step": h},
        "joints": {
            "pin": {"use": "revolute", "between": ["ground", "one:left"]},
            "elbow": {"use": "revolute", "between": ["one:right", "two:left"]},
            "motor": {"use": "rotational_spring", "between": ["one:right", "two:left"],
                      "stiffness": 20.0, "damping": 0.1, "angle": {
                          "use": "smooth_step", "end": 0.03, "final": 0.4}},
            "tie": {"use": "spring_damper", "between": ["one:top", "two:top_right"],
                    "stiffness": 2e3, "damping": 5.0},
            "base": {"use": "spring_damper", "between": ["two:right", "ground"],
                     "stiffness": 1e3, "ground": [1.0, -0.5]}},
        "loads": {"crank": {"use": "torque", "on": "one:left", "torque": 40.0,
                            "factor": {"use": "sine", "amplitude": 1.0, "frequency": 30.0}}}}
