"""Small scenes for analyses: a beam, a fin, and their closed forms."""

from typing import Any

from sparsemor import Scene, load

E, RHO, NU = 2.1e11, 7800.0, 0.3


def beam(
    length: float = 1.0, height: float = 0.05, width: float = 0.02,
    cells: tuple[int, int] = (16, 2), loads: Any = None, joints: Any = None,
    reducer: Any = "full", **options: Any,
) -> Scene:
    """A beam in the plane, clamped at its left end in a fixed frame unless told otherwise."""
    body = {"use": "flexible", "order": 2, "thickness": width, "fields": ["elastic"],
            "mesh": {"use": "rectangle", "size": [length, height], "divisions": list(cells)},
            "material": {"E": E, "nu": NU, "rho": RHO}, "reference": {"clamp": "left"},
            "frame": "fixed", **options}
    return load({"format": 1, "bodies": {"beam": body}, "loads": loads or {},
                 "joints": joints or {}, "time": {"end": 0.01, "step": 1e-3}, "reducer": reducer,
                 "probes": {"tip": {"body": "beam", "at": "right"}}})


def fin(loads: Any, joints: Any, reducer: Any = "full", **material: Any) -> Scene:
    """A bar in the plane that conducts along x."""
    body = {"use": "flexible", "order": 2, "thickness": 0.05, "fields": ["thermal"],
            "mesh": {"use": "rectangle", "size": [0.1, 0.002], "divisions": [30, 1]},
            "material": {"rho": 2700, "k": 200.0, "c": 900, **material}, "frame": "fixed"}
    return load({"format": 1, "bodies": {"fin": body}, "loads": loads, "joints": joints,
                 "time": {"end": 10.0, "step": 1.0}, "reducer": reducer,
                 "probes": {"tip": {"body": "fin", "at": "right"}}})


def value(solution: Any, quantity: str) -> float:
    """One value of the table of a static state."""
    return next(float(r["value"]) for r in solution.rows if r["quantity"] == quantity)
