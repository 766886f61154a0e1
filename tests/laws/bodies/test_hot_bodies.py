"""Bodies whose stiffness, expansion, conductivity and heat capacity depend on temperature: every
reducer follows the textbook's Newton method for all unknowns together."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from reduced_runs import decoded, learnt
from sparsemor.core.scene.scene import Scene
from sparsemor.core.testing.in_memory_run import March, march, scene_of

BASIS = {"basis": {"use": "pod", "count": 16}}
REDUCERS: dict[str, dict[str, Any]] = {
    "galerkin": BASIS, "lspg": BASIS, "deim": BASIS, "gnat": BASIS, "ecsw": BASIS,
    "sparse": {**BASIS, "sampler": "deim", "budgets": {"*": {"rows": 36}}, "tau": 1e-8}}
STEEL = {"rho": 7850, "nu": 0.3,
         "E": {"temperatures": [250, 500, 1000], "values": [2.1e10, 1.8e10, 0.4e10]},
         "alpha": {"polynomial": [1.2e-5, 4e-9], "origin": 293.15, "range": [200, 1200]},
         "k": {"temperatures": [250, 1000], "values": [54, 27]},
         "c": {"polynomial": [440, 0.4], "origin": 293.15, "range": [200, 1200]}}
BLOCKS = ("bar.elastic", "bar.thermal")


def hot(moves: bool, reducer: Any) -> Scene:
    """A bar that a pulsed flux heats from above: clamped, or swinging from a hinge."""
    lamp = {"use": "sine", "amplitude": 4e6, "frequency": 1.0, "offset": 4e6}
    moving: dict[str, Any] = {
        "joints": {"hinge": {"use": "revolute", "between": ["ground", "bar:left"]}},
        "time": {"end": 0.08, "step": 2e-3}}
    return scene_of({
        "bodies": {"bar": {
            "use": "flexible", "fields": ["elastic", "thermal"], "thickness": 0.02,
            "frame": "floating" if moves else "fixed", "damping": {"stiffness": 1e-4},
            "mesh": {"use": "rectangle", "size": [0.4, 0.04], "divisions": [12, 3]},
            "material": STEEL, "reference": {"clamp": "left"}}},
        "loads": {
            "glow": {"use": "radiation", "on": ["bar:top"], "emissivity": 0.6,
                     "surroundings": 290.0},
            "lamp": {"use": "heat_flux", "on": ["bar:top"], "flux": lamp},
            **({"weight": {"use": "gravity", "g": [0, -9.81]}} if moves else {})},
        "time": {"end": 0.6, "step": 0.03}, **(moving if moves else {}), "integrator": "bdf1",
        "reducer": reducer})


@cache
def textbook(moves: bool) -> March:
    return march(hot(moves, {"use": "full", "method": "newton"}))


def error(run: March, reference: March, name: str) -> float:
    """Largest error over the largest change."""
    x, want = decoded(run, name), decoded(reference, name)
    return float(np.abs(x - want).max() / np.abs(want - want[0]).max())


@pytest.mark.full
@pytest.mark.parametrize("moves", [False, True], ids=["clamped", "swinging"])
def test_full_order_is_the_textbook(moves: bool) -> None:
    run, reference = march(hot(moves, "full")), textbook(moves)
    assert decoded(reference, "bar.thermal").max() > (330.0 if moves else 570.0)
    for name in BLOCKS:
        assert error(run, reference, name) < 1e-9


@pytest.mark.full
@pytest.mark.parametrize("moves", [False, True], ids=["clamped", "swinging"])
@pytest.mark.parametrize("reducer", REDUCERS)
def test_reduced_models_follow_full_order(reducer: str, moves: bool) -> None:
    reference = textbook(moves)
    run = march(hot(moves, {"use": reducer, **REDUCERS[reducer]}), snapshots=learnt(reference))
    limit = 1e-5 if reducer == "ecsw" else 1e-8
    for name in BLOCKS:
        assert error(run, reference, name) < limit
    if reducer == "ecsw":
        for name in BLOCKS:
            fact = run.solver.facts[name]
            assert 0 < int(fact["local_elements_kept"]) < int(fact["local_elements"])


@pytest.mark.full
def test_the_dependence_on_temperature_matters() -> None:
    """With constant properties the displacements are others."""
    scene = hot(False, "full")
    constant = {"rho": 7850, "nu": 0.3, "E": 2.1e10, "alpha": 1.2e-5, "k": 52, "c": 440}
    run = march(scene.using({"bodies.bar.material": constant}))
    assert error(run, textbook(False), "bar.elastic") > 0.05
    assert error(run, textbook(False), "bar.thermal") > 0.02
