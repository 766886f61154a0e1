"""Bodies whose stiffness, expansion, conductivity and heat capacity depend on temperature: every
reducer follows the textbook's Newton method for all unknowns together."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from reduced_runs import decoded, learnt
from sparsemor.core.errors import InputError
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


INTEGRATORS = ["bdf1", "bdf2", {"use": "generalized_alpha", "rho_inf": 0.8}]


def hot(moves: bool, reducer: Any, which: int = 0) -> Scene:
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
        "time": {"end": 0.6, "step": 0.03}, **(moving if moves else {}), 
        "integrator": INTEGRATORS[which], "reducer": reducer})


@cache
def textbook(moves: bool, which: int) -> March:
    return march(hot(moves, {"use": "full", "method": "newton"}, which))


def error(run: March, reference: March, name: str) -> float:
    """Largest error over the largest change."""
    x, want = decoded(run, name), decoded(reference, name)
    return float(np.abs(x - want).max() / np.abs(want - want[0]).max())


@pytest.mark.full
@pytest.mark.parametrize(("moves", "which"), [(False, 1), (True, 0), (True, 2)])
def test_full_order_is_the_textbook(moves: bool, which: int) -> None:
    run, reference = march(hot(moves, "full", which)), textbook(moves, which)
    assert decoded(reference, "bar.thermal").max() > (330.0 if moves else 570.0)
    for name in BLOCKS:
        assert error(run, reference, name) < 1e-9


@pytest.mark.full
@pytest.mark.parametrize(("reducer", "moves", "which"), [
    ("galerkin", False, 2), ("lspg", True, 0), ("deim", False, 1), ("gnat", True, 0),
    ("ecsw", False, 1), ("ecsw", True, 0), ("sparse", False, 1)])
def test_reduced_models_follow_full_order(reducer: str, moves: bool, which: int) -> None:
    reference = textbook(moves, which)
    run = march(hot(moves, {"use": reducer, **REDUCERS[reducer]}, which),
                snapshots=learnt(reference))
    limit = 1e-5 if reducer == "ecsw" else 1e-8
    for name in BLOCKS:
        assert error(run, reference, name) < limit
    if reducer == "ecsw":
        for name in BLOCKS:
            fact = run.solver.facts[name]
            assert 0 < int(fact["local_elements_kept"]) < int(fact["local_elements"])


@pytest.mark.full
def test_a_choice_of_atoms_is_refused() -> None:
    chosen = {**REDUCERS["sparse"], "use": "sparse", "budgets": {"*.elastic": {"atoms": 5}}}
    with pytest.raises(InputError, match="acts on displacements by elements"):
        march(hot(False, chosen, 1), snapshots=learnt(textbook(False, 1)))


@pytest.mark.full
def test_the_dependence_on_temperature_matters() -> None:
    """With constant properties the displacements are others."""
    scene = hot(False, "full", 1)
    constant = {"rho": 7850, "nu": 0.3, "E": 2.1e10, "alpha": 1.2e-5, "k": 52, "c": 440}
    run = march(scene.using({"bodies.bar.material": constant}))
    assert error(run, textbook(False, 1), "bar.elastic") > 0.05
    assert error(run, textbook(False, 1), "bar.thermal") > 0.02
