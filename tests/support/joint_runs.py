"""Runs of bodies and joints alone."""

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
