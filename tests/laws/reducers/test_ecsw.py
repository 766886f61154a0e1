"""ECSW: few weighted elements stand for all, and the runs are those of Galerkin."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from small_scenes import coarse_pendulum, everything
from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.validation import checked_model
from sparsemor.core.testing.in_memory_run import March, march, scene_of
from sparsemor.reducers.projection.ecsw.reducer import Ecsw

WEIGHTED = {"use": "ecsw", "constant": "weighted"}
BASES = {"basis": {"use": "pod", "count": 16}, "bases": {"*.thermal": {"use": "pod", "count": 12}}}


RULES: dict[str, Any] = {
    "bdf1": "bdf1", "bdf2": "bdf2", "undamped": {"use": "generalized_alpha", "rho_inf": 1.0}}


@cache
def full(integrator: str) -> March:
    return march(coarse_pendulum().using({"reducer": "full", "integrator": RULES[integrator]}))


def unknowns(run: March, name: str) -> FloatArray:
    """(T, n) of a block: what coefficients are of is the model's own affair."""
    d, x = run.solver.dictionaries.get(name), run.block(name)
    return x if d is None else np.asarray(d.offset + x @ d.atoms.T)


def errors(run: March, reference: March) -> dict[str, float]:
    """Largest error of each field over its largest motion."""
    found = {}
    for b in reference.model.layout:
        if b.field != "multiplier":
            x, want = unknowns(run, b.name), reference.block(b.name)
            found[b.name] = float(np.abs(x - want).max() / np.abs(want - want[0]).max())
    return found


def repeated(reference: March, scene: Scene, **options: Any) -> March:
    snapshots = {n: reference.block(n).T for n in reference.model.reducible()}
    reducer = {**WEIGHTED, **BASES, **options}
    return march(scene.using({"reducer": reducer}), model=reference.model, snapshots=snapshots)


@cache
def default() -> March:
    return repeated(full("bdf1"), coarse_pendulum())


@pytest.mark.full
def test_the_pendulum_is_repeated_with_a_fraction_of_its_elements() -> None:
    reference, run = full("bdf1"), default()
    assert max(errors(run, reference).values()) < 1e-4
    for name, fact in run.solver.facts.items():
        kept, all_of_them = int(fact["elements_kept"]), fact["elements"]
        assert all_of_them == 320 and 5 < kept < 110
        assert run.solver.elements_touched[name] == kept
        assert 0.0 < float(fact["residual"]) <= 1.01e-6 == pytest.approx(1.01 * float(fact["tau"]))
    assert run.solver.notes == ()


@pytest.mark.full
@pytest.mark.parametrize("rule,bound", [("bdf2", 2e-4), ("undamped", 2e-3)])
def test_second_order_rules_too(rule: str, bound: float) -> None:
    """Sampled rows are unstable under the undamped one; symmetric weighted operators are not.
    16 modes carry the start of a second-order run to these bounds."""
    scene = coarse_pendulum().using({"integrator": RULES[rule]})
    reference = full(rule)
    assert max(errors(repeated(reference, scene), reference).values()) < bound


def radiating(divisions: list[int]) -> Scene:
    return scene_of({
        "bodies": {"plate": {
            "use": "flexible", "frame": "fixed", "fields": ["thermal"], "thickness": 0.01,
            "mesh": {"use": "rectangle", "size": [0.4, 0.05], "divisions": divisions},
            "material": {"rho": 2000, "k": 40, "c": 700},
            "initial_temperature": "400 + 800*x"}},
        "loads": {"glow": {"use": "radiation", "on": ["plate:top", "plate:bottom"],
                           "emissivity": 0.9,
                           "surroundings": {"use": "ramp", "end": 100, "initial": 280,
                                            "final": 320}}},
        "integrator": "bdf1",  # ten atoms represent its run, with implicit Euler's damping, best
        "time": {"end": 100.0, "step": 2.0}})


@pytest.mark.full
def test_few_facets_radiate_for_all_and_no_more_on_a_finer_mesh() -> None:
    """The counting law: galerkin visits every facet in a step, ecsw a number that the mesh does not
    change. Nor does it change how many elements carry the heat."""
    visited, kept = [], []
    for divisions in ([40, 3], [80, 6]):
        scene = radiating(divisions)
        reference = march(scene)
        snapshots = {"plate.thermal": reference.block("plate.thermal").T}
        runs = [march(scene.using({"reducer": {**use, "basis": {"use": "pod", "count": 10}}}),
                      model=reference.model, snapshots=snapshots)
                for use in ({"use": "galerkin"}, WEIGHTED)]
        fact = runs[1].solver.facts["plate.thermal"]
        assert runs[0].solver.elements_touched["plate.thermal"] == fact["local_elements"]
        assert fact["local_elements"] == 2 * divisions[0]
        assert errors(runs[1], reference)["plate.thermal"] < 1e-5
        visited.append(int(fact["local_elements_kept"]))
        solver: Any = runs[1].solver
        assert solver.heat["plate.thermal"].elements == visited[-1]
        kept.append(int(fact["elements_kept"]))
        assert runs[1].solver.elements_touched["plate.thermal"] == visited[-1] + kept[-1]
    assert visited[1] < 160 / 2.5 and abs(visited[1] - visited[0]) <= 10
    assert kept[1] < 960 / 7 and abs(kept[1] - kept[0]) <= 15


@pytest.mark.full
def test_without_local_terms_it_is_galerkin_and_says_so() -> None:
    """Only facets that radiate are weighted; without them the runs of both agree to round-off."""
    scene = radiating([20, 2]).using({"time.end": 20.0})
    for loads in (scene, scene.using({"loads": {}})):
        reference = march(loads)
        snapshots = {"plate.thermal": reference.block("plate.thermal").T}
        basis = {"basis": {"use": "pod", "count": 6}}
        exact, whole = (march(loads.using({"reducer": {**basis, **options}}), snapshots=snapshots)
                        for options in ({"use": "ecsw"}, {"use": "galerkin"}))
        one, other = (unknowns(run, "plate.thermal") for run in (exact, whole))
        difference = np.abs(one - other).max() / np.abs(other).max()
        if loads is scene:
            fact = exact.solver.facts["plate.thermal"]
            assert fact["local_elements_kept"] == exact.solver.elements_touched["plate.thermal"]
            assert 0 < int(fact["local_elements_kept"]) < 40 and "elements" not in fact
            assert 0.0 < difference < 1e-6 and not exact.solver.notes
        else:
            assert set(exact.solver.facts["plate.thermal"]) == {"norm"} and difference < 1e-13
            (note,) = exact.solver.notes
            assert note.kind == "no_effect" and "galerkin in plate.thermal: without" in note.text


def test_a_body_at_rest_keeps_all_its_elements() -> None:
    """There are no forces to be trained on: K T of a uniform temperature is round-off."""
    scene = radiating([6, 2]).using({
        "bodies.plate.initial_temperature": 300.0, "loads": {}, "time.end": 10.0})
    reference = march(scene)
    run = march(scene.using({"reducer": {**WEIGHTED, "basis": {"use": "pod", "count": 1}}}),
                snapshots={"plate.thermal": reference.block("plate.thermal").T})
    assert run.solver.facts["plate.thermal"]["elements_kept"] == 24
    assert np.ptp(run.block("plate.thermal")) < 1e-9


class Plain:
    """A local term without element shares."""

    rows = columns = np.zeros(0, dtype=np.int64)
    weighs_elements = False


@pytest.mark.full
def test_bodies_and_terms_that_offer_no_elements_are_refused_in_words() -> None:
    model = checked_model(everything())
    assert not Ecsw(constant="weighted").check(model)
    s = model.separated
    rigid_copy = replace(s, heat=(
        replace(s.heat[0], integrals=None), replace(s.heat[1], local=(Plain(),)), *s.heat[2:]),
        moving=tuple(m if m.operators is None else replace(
            m, operators=replace(m.operators, integrals=None)) for m in s.moving))
    changed = replace(model, separated=rigid_copy)
    (fault,) = Ecsw().check(changed)  # constant matrices need no elements
    assert "Plain on body hot does not offer" in fault.message
    faults = Ecsw(constant="weighted").check(changed)
    words = [f.message for f in faults]
    assert len(words) == 5
    assert "body plate does not offer for its heat" in words[0]
    assert "Plain on body hot does not offer" in words[1]
    assert all("for its elastic field: use reducer: galerkin" in w for w in words[2:])


@pytest.mark.parametrize("tau", [0.0, 1e-9, 1.0])
def test_a_tolerance_that_makes_no_sense_is_refused(tau: float) -> None:
    with pytest.raises(InputError, match="tau"):
        coarse_pendulum().using({"reducer": {"use": "ecsw", "tau": tau}})


def largest(values: FloatArray) -> float:
    return float(np.abs(values).max())
