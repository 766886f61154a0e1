"""Geometric stiffness by the loads of the moment (`strains: prestressed`): closed forms of beams,
nonlinear strains, and one set of equations in every solver and reducer."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from reduced_runs import learnt
from slender_beams import ALPHA, EULER, E, L, column, spinning, tip
from sparsemor import load_model, reduce, simulate
from sparsemor.core.errors import InputError
from sparsemor.core.model.assembly import assemble
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.scene import Scene
from sparsemor.core.testing import check_term
from sparsemor.core.testing.in_memory_run import March, march, scene_of

E_SOFT = 7e8


def bar(space: bool, **more: Any) -> dict[str, Any]:
    mesh = {"use": "block", "lower": [0.0, -0.02, -0.02], "size": [0.5, 0.04, 0.04],
            "divisions": [4, 1, 1]} if space else {
        "use": "rectangle", "lower": [0.0, -0.02], "size": [0.5, 0.04], "divisions": [6, 1]}
    return {"use": "flexible", "mesh": mesh, "order": 2, "fields": ["elastic"],
            "strains": "prestressed", "reference": {"clamp": "left"},
            "material": {"E": E_SOFT, "nu": 0.3, "rho": 2700.0},
            **({} if space else {"thickness": 0.04}), **more}


@cache
def swinging(space: bool) -> Scene:
    """A soft pendulum with a rigid weight at its end, under its weight and a wind, next to a bar on
    a fixed frame that is pushed along its axis, and a bar with linear strains."""
    z = [0.0] if space else []
    axis: dict[str, Any] = {"axis": [0, 0, 1]} if space else {}
    inertia = {"inertia": [1e-3, 1e-3, 1e-3]} if space else {"inertia": 1e-3}
    spin = {"spin": [0.0, 0.0, 8.0]} if space else {"spin": 8.0}
    return scene_of({
        "bodies": {
            "b": bar(space, pose=spin), "still": bar(space, frame="fixed"),
            "plain": bar(space, frame="fixed", strains="linear"),
            "weight": {"use": "rigid", "mass": 0.5, **inertia, "points": {"a": [0.0, 0.0, *z]},
                       "pose": {"position": [0.5, 0.0, *z], "velocity": [0.0, 4.0, *z], **spin}}},
        "joints": {"pin": {"use": "revolute", "between": ["ground", "b:left"], **axis},
                   "hinge": {"use": "revolute", "between": ["b:right", "weight:a"], **axis}},
        "loads": {
            "g": {"use": "gravity", "g": [3.0, -9.81, *z]},
            "wind": {"use": "traction", "on": ["b:top"], "traction": [0.0, -400.0, *z],
                     "axes": "space"},
            "push": {"use": "traction", "on": ["still:right", "plain:right"],
                     "traction": [-4e4, 2e3, *z],
                     "factor": {"use": "smooth_step", "end": 0.01, "final": 1.0}}},
        "integrator": {"use": "generalized_alpha", "rho_inf": 0.8},
        "time": {"end": 0.04, "step": 2e-3},
        "probes": {"end": {"body": "b", "at": "right"}}})


@cache
def whole(space: bool) -> March:
    return march(swinging(space))


def differences(run: March, reference: March) -> dict[str, float]:
    found = {}
    for b in reference.model.layout:
        d = run.solver.dictionaries.get(b.name)
        x, want = run.block(b.name), reference.block(b.name)
        x = x if d is None else d.offset + x @ d.atoms.T
        found[b.name] = float(np.abs(x - want)[1:].max() / np.abs(want).max())
    return found


@pytest.mark.full
@pytest.mark.parametrize("space", [False, True])
def test_the_stiffness_is_a_term(space: bool) -> None:
    """Residual, exact Jacobian, restriction and projection, of a moving and of a fixed frame."""
    model = assemble(swinging(space))
    for name in ("b", "still"):
        term, rng = model.by_part[name][-1], np.random.default_rng(2)
        assert len(term.rows) == len(model.layout.numbers(f"{name}.elastic"))
        base = model.x0[term.columns]
        base[term.columns >= model.layout.algebraic.start] = 100.0
        check_term(term, rng, base=base, scale=1e-2, trials=1, rtol=1e-5, same_rates=True)
        assert np.abs(term.residual(base + 0.01, base, base, 0.0)).max() > 0.0


@pytest.mark.full
@pytest.mark.parametrize("space", [False, True])
def test_all_solvers_have_the_same_equations(space: bool) -> None:
    """Bordered and textbook Newton iterations, which add block operators and terms; and it matters:
    the bar with linear strains bends less."""
    scene, run = swinging(space), whole(space)
    textbook = march(scene.using({"reducer": {"use": "full", "method": "newton"}}))
    found = differences(textbook, run)
    assert max(e for n, e in found.items() if n != "weight.multiplier") < 1e-8, found
    pushed, same = (np.abs(run.block(f"{n}.elastic")).max() for n in ("still", "plain"))
    assert pushed > 1.02 * same


@pytest.mark.full
@pytest.mark.parametrize("space, use", [
    (False, "ecsw"), (False, "lspg"), (False, "sparse"), (False, "centred"), (True, "galerkin"),
    (True, "deim"), (True, "gnat")])
def test_reducers_repeat_the_run(space: bool, use: str) -> None:
    """With enough atoms, also with those about a mean, and a selection of rows."""
    pod = {"use": "pod", "count": 12, "centred": use == "centred"}
    reducer = {"use": "galerkin" if use == "centred" else use, "basis": pod}
    run = march(swinging(space).using({"reducer": reducer}), model=whole(space).model,
                snapshots=learnt(whole(space)))
    found = differences(run, whole(space))
    bodies = ("still",) if use == "centred" else ("b", "still", "plain")  # rates have no mean
    assert max(found[f"{n}.elastic"] for n in bodies) < 1e-3, found


@pytest.mark.full
def test_a_kept_model_repeats_the_run(tmp_path: Path) -> None:
    scene = swinging(False).using({
        "reducer": {"use": "galerkin", "basis": {"use": "pod", "count": 12}}})
    model, change = reduce(scene), {"loads.push.factor.final": 0.5}
    model.save(tmp_path / "b.model")
    want = model.run(change).probe("end")
    np.testing.assert_allclose(
        load_model(tmp_path / "b.model").run(change).probe("end"), want, rtol=0, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("space", [False, True])
def test_the_stiffness_is_compiled(space: bool) -> None:
    scene = swinging(space).using({
        "reducer": {"use": "galerkin", "basis": {"use": "pod", "count": 12}}})
    run, fast = simulate(scene), simulate(scene.using({"reducer.compiled": "on"}))
    assert not any("compiled" in n for n in fast.summary["notes"]), fast.summary["notes"]
    np.testing.assert_allclose(fast.probe("end"), run.probe("end"), rtol=0, atol=1e-9)


@pytest.mark.full
@pytest.mark.parametrize(("ratio", "want"), [(0.4, 3.451e-4), (0.8, 3.142e-4)])
def test_a_spinning_beam_is_stiffened(ratio: float, want: float) -> None:
    run = simulate(spinning(ratio, "prestressed"))
    assert tip(run)[1] == pytest.approx(want, rel=2e-3)
    assert not run.summary["notes"]


def buckled(run: RunResult) -> list[bool]:
    return ["times its buckling load" in n for n in run.summary["notes"]]


@pytest.mark.full
def test_beyond_the_buckling_load_it_is_noted() -> None:
    run = simulate(column("prestressed", 2.0 * EULER).using({"time": {"end": 4.0, "step": 1.0}}))
    assert any(buckled(run))
    assert "grow without limit there; take bodies.b.strains: nonlinear" in run.summary["notes"][0]


@pytest.mark.parametrize("change", [
    {"fields": ["elastic", "thermal"]},
    {"material": {"E": {"temperatures": [200.0, 400.0], "values": [E, E / 2]}, "nu": 0.3,
                  "rho": 2700.0, "alpha": ALPHA}}])
def test_what_has_no_constant_matrices_is_refused(change: dict[str, Any]) -> None:
    material = {"E": E, "nu": 0.3, "rho": 2700.0, "k": 40.0, "c": 500.0}
    body = bar(False, **{"material": material, **change})
    with pytest.raises(InputError, match=r"strains.*take nonlinear"):
        assemble(scene_of({"bodies": {"b": {**body, "frame": "fixed"}},
                           "time": {"end": L, "step": 0.1}}))
