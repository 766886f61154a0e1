"""Heat that enters faster than the elements resolve: undershoot, lumped capacity, and the note."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from reduced_runs import decoded, learnt
from sparsemor import simulate
from sparsemor.core.model.assembly import assemble
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.scene import Scene
from sparsemor.core.testing.in_memory_run import march, scene_of
from tiers import quick


def bar(capacity: str, mesh: Any = None, **changes: Any) -> Scene:
    """A steel bar that a strong source heats on its left from 300 K, which a step of 1 ms carries
    a small part of an element far."""
    return scene_of({
        "bodies": {"bar": {
            "use": "flexible", "fields": ["thermal"], "frame": "fixed", "capacity": capacity,
            "mesh": mesh or {"use": "rectangle", "size": [0.1, 0.02], "divisions": [10, 2]},
            **({} if mesh else {"thickness": 0.01}),
            "material": {"rho": 7850, "k": 44.5, "c": 475}, "reference_temperature": 300.0}},
        "loads": {"lamp": {"use": "heat_flux", "on": ["bar:left"], "flux": 1e7}},
        "time": {"end": 0.02, "step": 1e-3}, "reducer": "full", **changes})


BLOCK = {"use": "block", "size": [0.1, 0.02, 0.02], "divisions": [6, 2, 2]}


@pytest.mark.parametrize("mesh", [None, BLOCK])
def test_lumped_capacity_holds_the_same_heat(mesh: Any) -> None:
    made = [assemble(bar(c, mesh)).separated.heat[0] for c in ("consistent", "lumped")]
    whole, lumped = (b.capacity.toarray() for b in made)
    assert np.count_nonzero(lumped - np.diag(np.diag(lumped))) == 0
    np.testing.assert_allclose(np.diag(lumped), whole.sum(axis=1), rtol=1e-12)
    for b in made:  # elements, as ecsw weighs them
        assert b.integrals is not None
        ones = np.ones(b.integrals().capacity.count)
        size = abs(b.capacity).max()
        assert abs(b.integrals().capacity.weighted(ones) - b.capacity).max() < 1e-13 * size


@pytest.mark.full
@pytest.mark.parametrize("mesh", [None, BLOCK])
def test_lumped_capacity_does_not_undershoot(mesh: Any) -> None:
    runs = {c: march(bar(c, mesh)).block("bar.thermal") for c in ("consistent", "lumped")}
    assert runs["consistent"].min() < 297.0
    assert runs["lumped"].min() > 300.0 - 1e-9
    # both take in the heat of the lamp: the same mean temperature
    power = 1e7 * (0.02 * 0.02 if mesh else 0.01 * 0.02)
    volume = 0.1 * (0.02 * 0.02 if mesh else 0.02 * 0.01)
    for capacity, T in runs.items():
        (heat,) = assemble(bar(capacity, mesh)).separated.heat
        C = heat.capacity.toarray()
        gained = float(np.ones(len(C)) @ C @ (T[-1] - 300.0))
        assert gained == pytest.approx(power * 0.02, rel=1e-9)
        assert C.sum() == pytest.approx(7850 * 475 * volume, rel=1e-12)


def test_every_reducer_takes_lumped_capacity() -> None:
    reference = march(bar("lumped"))
    want = decoded(reference, "bar.thermal")
    for reducer in ("galerkin", "lspg", "deim", "gnat", "ecsw"):
        scene = bar("lumped", reducer={"use": reducer, "basis": {"use": "pod", "count": 12}})
        run = march(scene, model=reference.model, snapshots=learnt(reference))
        error = np.abs(decoded(run, "bar.thermal") - want).max()
        assert error < 1e-5 * np.abs(want - want[0]).max(), reducer


def noted(run: RunResult) -> list[str]:
    texts = [*run.summary["notes"], *run.summary["information"]]
    return [text for text in texts
            if "its temperature falls to" in text or "temperatures fall up to" in text]


@pytest.mark.full
@pytest.mark.parametrize("reducer", ["full", {"use": "galerkin", "basis": "pod"}],
                         ids=["full", "galerkin"])
def test_a_run_says_how_far_it_undershoots(reducer: Any, here: Path) -> None:
    """By a tenth of the temperature it is a warning."""
    for flux, kind in ((1e7, "information"), (1e8, "notes")):
        run = simulate(bar("consistent", reducer=reducer, loads={
            "lamp": {"use": "heat_flux", "on": ["bar:left"], "flux": flux}}))
        lowest = float(run.block("bar.thermal").min())
        (text,) = noted(run)
        assert text.startswith("body bar: ") and f"{lowest:.4g} K at " in text
        assert f"{300.0 - lowest:.3g} K below" in text and "capacity: lumped" in text
        assert text in run.summary[kind]
        assert ("undershoot" in run.summary["note_kinds"]) is (kind == "notes")
    assert noted(simulate(bar("lumped", reducer=reducer))) == []


COOLING: dict[str, dict[str, Any]] = {
    "a negative flux": {"use": "heat_flux", "on": ["bar:right"], "flux": -1e6},
    "a cold film": {
        "use": "convection", "on": ["bar:top"], "film": 1e4, "temperature": 100.0},
    "cold surroundings": {
        "use": "radiation", "on": ["bar:top"], "emissivity": 0.9, "surroundings": 3.0},
}


@pytest.mark.full
@pytest.mark.parametrize("name", quick(COOLING, "a cold film"))
def test_what_may_cool_a_body_is_no_undershoot(here: Path, name: str) -> None:
    """Without the lamp: nothing but what is there to cool it."""
    run = simulate(bar("consistent", loads={"cooling": COOLING[name]}))
    assert float(run.block("bar.thermal").min()) < 300.0
    assert noted(run) == []


@pytest.mark.full
def test_a_cold_end_is_no_undershoot(here: Path) -> None:
    cold = {"use": "prescribed_temperature", "on": ["bar:right"], "temperature": 200.0}
    run = simulate(bar("lumped", loads={}, joints={"cold": cold}))
    assert float(run.block("bar.thermal").min()) < 299.9
    assert noted(run) == []
