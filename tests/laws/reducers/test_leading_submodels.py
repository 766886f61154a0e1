"""Leading sub-models of a prepared projection: the first atoms of each block, nothing trained
again."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from reduced_runs import decoded, learnt
from small_scenes import SCENES
from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.scene.scene import Scene, load
from sparsemor.core.testing.in_memory_run import March, march, reduced_problem
from sparsemor.reducers import Projection

pytestmark = pytest.mark.full

GLOW = {"use": "radiation", "on": ["bar:top"], "emissivity": 0.9, "surroundings": 293.15}
REDUCERS: dict[str, dict[str, Any]] = {
    "galerkin": {}, "lspg": {}, "gnat": {"oversampling": 2.0}, "deim": {}, "ecsw": {}}


def glowing(reducer: Any) -> Scene:
    return load(SCENES / "tiny.yaml", {"time.end": 0.015, "loads.glow": GLOW, "reducer": reducer})


@cache
def full() -> March:
    return march(glowing("full"))


def projection(use: str, count: int) -> Projection:
    scene = glowing({"use": use, "basis": {"use": "pod", "count": count}, **REDUCERS[use]})
    found: Projection = scene.reducer.project(
        reduced_problem(scene, full().model, learnt(full())))
    return found


def states(prepared: Projection) -> FloatArray:
    return march(glowing("full"), model=full().model, solver=prepared.solver()).x


@pytest.mark.parametrize("use", ["galerkin", "lspg", "gnat", "deim"])
def test_a_leading_submodel_is_the_model_of_the_smaller_basis(use: str) -> None:
    assert np.array_equal(states(projection(use, 6).leading(3)), states(projection(use, 3)))


def test_elements_are_weighed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = projection("ecsw", 6)
    monkeypatch.setattr("sparsemor.reducers.projection.ecsw.reducer.Ecsw.approximation", None)
    small = whole.leading({"bar.thermal": 4})
    assert small.approximation is whole.approximation
    solver = small.solver()
    assert {n: d.atoms.shape[1] for n, d in solver.dictionaries.items()} == {
        "bar.elastic": 6, "bar.thermal": 4}
    exact = projection("galerkin", 6).leading({"bar.thermal": 4}).solver()
    ours, theirs = (march(glowing("full"), model=full().model, solver=s) for s in (solver, exact))
    T, known = (decoded(run, "bar.thermal") for run in (ours, theirs))
    assert np.abs(T - known).max() < 1e-4 * np.ptp(known)


@pytest.mark.parametrize("counts, words", [
    (0, "0 leading atoms of bar.elastic: allowed: 1 to 6"),
    ({"bar.thermal": 7}, "7 leading atoms of bar.thermal: allowed: 1 to 6"),
    ({"bar.heat": 2}, "no reduced block is called 'bar.heat': blocks: bar.elastic, bar.thermal")])
def test_numbers_that_a_block_does_not_have(counts: Any, words: str) -> None:
    with pytest.raises(InputError) as caught:
        projection("galerkin", 6).leading(counts)
    assert words in str(caught.value)
