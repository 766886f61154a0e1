"""Terms that depend on rates of temperature, such as c(T) T': the same in every reducer."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from reduced_runs import decoded, learnt
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.model import Model
from sparsemor.core.scene.scene import Scene
from sparsemor.core.testing import check_term
from sparsemor.core.testing.in_memory_run import March, march, scene_of
from tiers import quick

BASIS = {"basis": {"use": "pod", "count": 20}}
REDUCERS: dict[str, dict[str, Any]] = {
    "galerkin": BASIS, "lspg": BASIS, "deim": BASIS, "gnat": BASIS, "ecsw": {**BASIS, "tau": 1e-8},
    "sparse": {**BASIS, "sampler": "deim", "budgets": {"*": {"rows": 40, "atoms": 20}}}}
INTEGRATORS = ["bdf1", "bdf2", "generalized_alpha"]


GROWING = {"polynomial": [475.0, 0.475], "origin": 293.15, "range": [200.0, 2000.0]}
"""Specific heat that grows by 0.1 % per kelvin."""


def plate(c: Any = GROWING, **changes: Any) -> Scene:
    """A plate that a lamp heats on its left and a film cools from below."""
    return scene_of({
        "bodies": {"plate": {
            "use": "flexible", "thickness": 0.01, "fields": ["thermal"], "frame": "fixed",
            "material": {"rho": 7850, "k": 44.5, "c": c},
            "mesh": {"use": "rectangle", "size": [0.2, 0.04], "divisions": [20, 4],
                     "diagonal": "alternating"}}},
        "loads": {
            "lamp": {"use": "heat_flux", "on": ["plate:left"], "flux": {
                "use": "sine", "amplitude": 3e5, "frequency": 0.02, "offset": 3e5}},
            "film": {"use": "convection", "on": ["plate:bottom"], "film": 200.0,
                     "temperature": 293.15}},
        "time": {"end": 20.0, "step": 0.5}, **changes})


@cache
def model() -> Model:
    return assemble(plate())


@cache
def textbook(integrator: str) -> March:
    """The whole system at once by Newton's method."""
    newton = {"use": "full", "method": "newton"}
    return march(plate(reducer=newton, integrator=integrator), model=model())


def error(run: March, reference: March) -> float:
    """Largest error over the largest change."""
    T, want = decoded(run, "plate.thermal"), decoded(reference, "plate.thermal")
    return float(np.abs(T - want).max() / np.abs(want - want[0]).max())


def test_the_term_keeps_the_laws_of_terms() -> None:
    (term,) = model().separated.heat[0].local
    base = np.full(len(term.columns), 400.0)
    check_term(term, np.random.default_rng(0), base=base, scale=5.0, trials=2)


@pytest.mark.full
def test_the_capacity_matters() -> None:
    plain = march(plate(c=475.0))
    assert error(plain, textbook("bdf1")) > 1e-2


@pytest.mark.full
@pytest.mark.parametrize("integrator", quick(INTEGRATORS, "bdf2"))
def test_full_order_is_the_textbook(integrator: str) -> None:
    run = march(plate(reducer="full", integrator=integrator), model=model())
    assert error(run, textbook(integrator)) < 1e-9


@pytest.mark.full
@pytest.mark.parametrize("integrator", quick(INTEGRATORS, "bdf2"))
@pytest.mark.parametrize("reducer", REDUCERS)
def test_reduced_models_follow_full_order(reducer: str, integrator: str) -> None:
    reference = textbook(integrator)
    scene = plate(reducer={"use": reducer, **REDUCERS[reducer]}, integrator=integrator)
    run = march(scene, model=model(), snapshots=learnt(reference))
    assert error(run, reference) <= 1e-7
    if reducer == "ecsw":
        fact = run.solver.facts["plate.thermal"]
        assert int(fact["local_elements"]) == 160
        assert 0 < int(fact["local_elements_kept"]) < 160
        assert float(fact["residual"]) <= 2.0 * float(fact["tau"])
