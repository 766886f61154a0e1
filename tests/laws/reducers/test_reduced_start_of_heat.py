"""Initial rates of temperature of reduced models satisfy the reduced equations; tolerances of heat.

Heat that enters through a surface at t = 0 changes the temperatures of its nodes alone at first.
Those rates are outside the span of the snapshots; their projection gave errors of 6e-4 with
integrators that start from rates.
"""

from functools import cache
from typing import Any

import numpy as np
import pytest

from reduced_runs import decoded, learnt
from sparsemor.core import SolveFailed, Status
from sparsemor.core.scene.scene import Scene
from sparsemor.core.testing.in_memory_run import March, march, scene_of
from tiers import full as full_tier

GROWING = {"polynomial": [475.0, 0.2], "origin": 293.15, "range": [200.0, 2000.0]}
INTEGRATORS: dict[str, Any] = {
    "bdf2": "bdf2", "alpha": {"use": "generalized_alpha", "rho_inf": 0.5}}
REDUCERS: dict[str, dict[str, Any]] = {
    "galerkin": {}, "lspg": {}, "deim": {}, "gnat": {},
    "sparse": {"sampler": "deim", "budgets": {"*": {"rows": 30}}}}


def plate(integrator: Any, *, nonlinear: bool, reducer: Any = "full") -> Scene:
    glow = {"use": "radiation", "on": ["plate:top"], "emissivity": 0.9, "surroundings": 293.15}
    return scene_of({
        "bodies": {"plate": {
            "use": "flexible", "thickness": 0.01, "fields": ["thermal"], "frame": "fixed",
            "material": {"rho": 7850, "k": 44.5, "c": GROWING if nonlinear else 475},
            "mesh": {"use": "rectangle", "size": [0.1, 0.05], "divisions": [8, 4]}}},
        "loads": {"burner": {"use": "heat_flux", "on": ["plate:top"], "flux": 2e5},
                  **({"glow": glow} if nonlinear else {})},
        "time": {"end": 100.0, "step": 5.0}, "integrator": integrator, "reducer": reducer})


@cache
def full(integrator: str, nonlinear: bool) -> March:
    return march(plate(INTEGRATORS[integrator], nonlinear=nonlinear))


@pytest.mark.parametrize(("reducer", "integrator", "nonlinear"), [
    ("galerkin", "alpha", False), full_tier("deim", "bdf2", True), full_tier("lspg", "alpha", True),
    full_tier("gnat", "bdf2", False), full_tier("sparse", "alpha", True),
    full_tier("galerkin", "bdf2", True)])
def test_reduced_models_follow_full_order_from_the_start(
    reducer: str, integrator: str, nonlinear: bool
) -> None:
    reference = full(integrator, nonlinear)
    options = {"use": reducer, "basis": {"use": "pod", "count": 14}, **REDUCERS[reducer]}
    run = march(plate(INTEGRATORS[integrator], nonlinear=nonlinear, reducer=options),
                snapshots=learnt(reference))
    T = reference.block("plate.thermal")
    assert np.abs(decoded(run, "plate.thermal") - T).max() < 2e-7 * np.abs(T - T[0]).max()


@pytest.mark.full
@pytest.mark.parametrize("reducer", REDUCERS)
def test_temperatures_are_iterated_as_the_reducer_says(reducer: str) -> None:
    """`remaining` and `max_iterations` hold for blocks of heat as for mechanics."""
    options = {"use": reducer, "basis": {"use": "pod", "count": 14}, **REDUCERS[reducer]}
    snapshots = learnt(full("bdf2", True))

    def run(**more: float) -> March:
        return march(plate("bdf2", nonlinear=True, reducer={**options, **more}),
                     snapshots=snapshots)

    exact, near = run(), run(remaining=1e-6)
    assert sum(near.iterations) < sum(exact.iterations)
    T, off = (decoded(r, "plate.thermal") for r in (exact, near))
    assert 0.0 < np.abs(T - off).max() < 1e-4 * np.abs(T - T[0]).max()
    with pytest.raises(SolveFailed, match=Status.NOT_CONVERGED.value):
        run(max_iterations=1)
