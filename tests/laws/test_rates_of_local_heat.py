"""Local heat terms that depend on rates, such as c(T) T': the same in every reducer."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from reduced_runs import decoded, learnt
from sparsemor.core.model.model import Model
from sparsemor.core.testing import check_term
from sparsemor.core.testing.in_memory_run import March, march
from tiers import quick
from warm_capacity import plate, with_warm_capacity

BASIS = {"basis": {"use": "pod", "count": 14}}
REDUCERS: dict[str, dict[str, Any]] = {
    "galerkin": BASIS, "lspg": BASIS, "deim": BASIS, "gnat": BASIS, "ecsw": {**BASIS, "tau": 1e-7},
    "sparse": {**BASIS, "sampler": "deim", "budgets": {"*": {"rows": 28, "atoms": 14}}}}
INTEGRATORS = ["bdf1", "bdf2", "generalized_alpha"]


@cache
def model() -> Model:
    return with_warm_capacity(plate())


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


def test_the_capacity_matters() -> None:
    plain = march(plate())
    assert error(plain, textbook("bdf1")) > 1e-2


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_full_order_is_the_textbook(integrator: str) -> None:
    run = march(plate(reducer="full", integrator=integrator), model=model())
    assert error(run, textbook(integrator)) < 1e-9


@pytest.mark.parametrize("integrator", quick(INTEGRATORS, "bdf2"))
@pytest.mark.parametrize("reducer", REDUCERS)
def test_reduced_models_follow_full_order(reducer: str, integrator: str) -> None:
    reference = textbook(integrator)
    scene = plate(reducer={"use": reducer, **REDUCERS[reducer]}, integrator=integrator)
    run = march(scene, model=model(), snapshots=learnt(reference))
    assert error(run, reference) <= 1e-6
    if reducer == "ecsw":
        fact = run.solver.facts["plate.thermal"]
        assert int(fact["facets"]) == 160
        assert 0 < int(fact["facets_kept"]) < 160
        assert float(fact["residual"]) <= 2.0 * float(fact["tau"])
