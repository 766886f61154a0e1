"""Modes with their static derivatives where bending stretches a body that is held along its
edges."""

from typing import Any

import numpy as np
import pytest

from analysed import NU, RHO, E
from sparsemor import Scene, load, solve


def beam_between_walls() -> Scene:
    """1 m long, 20 mm thick."""
    return _scene({"use": "rectangle", "size": [1.0, 0.02], "divisions": [20, 1]},
                  {"left": "xy", "right": "xy"}, "top", [0.5, 0.0], 6.5e5, thickness=0.02)


def clamped_plate() -> Scene:
    """0.4 by 0.2 m, 10 mm thick."""
    return _scene({"use": "block", "size": [0.4, 0.2, 0.01], "divisions": [12, 6, 1]},
                  {name: "xyz" for name in ("left", "right", "front", "back")}, "top",
                  [0.2, 0.1, 0.0], 3.0e7)


def _scene(mesh: Any, held: Any, side: str, middle: Any, pressure: float, **more: Any) -> Scene:
    return load({
        "format": 1, "time": {"end": 1.0, "step": 0.5},
        "bodies": {"b": {"use": "flexible", "order": 2, "mesh": mesh, "fields": ["elastic"],
                         "material": {"E": E, "nu": NU, "rho": RHO}, "strains": "nonlinear",
                         "frame": "fixed", "reference": {"hold": held}, **more}},
        "loads": {"p": {"use": "pressure", "on": [f"b:{side}"], "pressure": pressure}},
        "probes": {"middle": {"body": "b", "at": middle}}})


def sag(scene: Scene, basis: Any = None) -> float:
    """Deflection of the middle, m."""
    reduced = scene if basis is None else scene.using(
        {"reducer": {"use": "galerkin", "basis": basis}})
    found = solve(reduced, "static").result
    assert found is not None
    return float(np.linalg.norm(found.nodal_displacement("b", 0), axis=1).max())


@pytest.mark.full
@pytest.mark.parametrize("scene, thick", [(beam_between_walls, 0.02), (clamped_plate, 0.01)])
def test_derivatives_let_the_membrane_follow(scene: Any, thick: float) -> None:
    body = scene()
    full = sag(body)
    assert full / thick == pytest.approx(0.5, abs=0.05)
    assert sag(body, {"use": "modal", "count": 20}) < 0.95 * full
    assert sag(body, {"use": "modal_derivatives", "count": 5}) == pytest.approx(full, rel=0.01)


@pytest.mark.full
def test_without_nonlinear_terms_the_modes_remain() -> None:
    linear = beam_between_walls().using({"bodies.b.strains": "linear"})
    found, modes = (sag(linear, {"use": name, "count": 3}) for name in (
        "modal_derivatives", "modal"))
    assert found == pytest.approx(modes, rel=1e-9)
