"""Rows of D^-1 r: what they are, what they bring, where they are refused; rows around a path."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.sparse import csr_array

from small_scenes import everything, everything_assembled, tiny
from sparsemor import compare, simulate
from sparsemor.core import Dictionary, ReducedProblem
from sparsemor.core.errors import InputError
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.model import Model, StepFactors
from sparsemor.core.notes import Level
from sparsemor.core.protocols.load_tables import LoadTable, Table
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.offline import Offline
from sparsemor.core.simulation.offline_cache import Products
from sparsemor.core.testing import check_sampler
from sparsemor.core.testing.in_memory_run import March, march, scene_of
from sparsemor.plugins.bases.impulse import Impulse
from sparsemor.plugins.samplers.deim import DeimPoints
from sparsemor.plugins.samplers.leverage import Leverage
from sparsemor.plugins.samplers.lhs import LatinHypercube
from sparsemor.plugins.samplers.random import Uniform
from sparsemor.plugins.samplers.s_opt import SOpt
from sparsemor.reducers.block_counts import required_rows
from sparsemor.reducers.sparse.reducer import Sparse
from sparsemor.reducers.sparse.residual_rows import inverted_blocks, plain_rows, samplers
from sparsemor.reducers.sparse.sampled_block import (
    choose_rows,
    inverse_rows,
)
from tiny_scene import BUDGETS, full, snapshots

FIXED = {"*.elastic": {"rows": 10}, "*.thermal": {"rows": 8}}
STEP = StepFactors(1e-3, 1e3, 1e6, 1e3)


def with_reducer(**options: Any) -> Scene:
    return tiny().using({"reducer": {
        "basis": {"use": "pod", "count": 5}, "bases": {"*.thermal": {"use": "pod", "count": 4}},
        **options}})


def sparse(**options: Any) -> Scene:
    return with_reducer(**{"use": "sparse", "budgets": FIXED, **options})


def ran(scene: Scene) -> March:
    return march(scene, model=full().model, snapshots=snapshots())


def error(run: March, reference: March, name: str) -> float:
    d, want = run.solver.dictionaries[name], reference.block(name)
    got = d.offset + run.block(name) @ d.atoms.T
    return float(np.abs(got - want)[1:].max() / np.abs(want - want[0]).max())


def errors(run: March) -> dict[str, float]:
    return {name: error(run, full(), name) for name in full().model.reducible()}


# ------------------------------------------------------------------------ what they are


@pytest.mark.parametrize("name", ["bar.elastic", "bar.thermal"])
def test_rows_of_the_inverse(name: str) -> None:
    D = full().model.block_data(name, step=STEP).operator
    rows = np.array([0, 3, 11])
    want = np.linalg.inv(D.toarray())[rows]
    got = inverse_rows(full().model, None, name, D, rows)
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-11 * np.abs(want).max())


def test_samplers_see_the_equations_that_are_sampled() -> None:
    """D^-1 D = 1: the pivots are those of the atoms themselves."""
    model, name, rng = full().model, "bar.elastic", np.random.default_rng(0)
    d = Dictionary(np.linalg.qr(snapshots()[name])[0][:, :6], np.zeros(0), ("",) * 6)
    rows = [choose_rows(model, None, name, 6, 6, DeimPoints(required=False, of=of), d, rng, STEP,
                        pre)
            for of, pre in (("operator", True), ("atoms", False), ("operator", False))]
    assert np.array_equal(rows[0], rows[1]) and not np.array_equal(rows[0], rows[2])


def test_all_rows_are_as_many_as_atoms() -> None:
    """Without a sampler or a number of rows: the least-squares solution of all rows of D^-1 r."""
    short = {n: {"rows": full().block(n).shape[1]} for n in full().model.reducible()}
    all_rows = ran(sparse(budgets=short, sampler={"use": "lhs", "required": False}))
    compressed = ran(sparse(budgets={}))
    for name in full().model.reducible():
        want = all_rows.block(name)
        np.testing.assert_allclose(compressed.block(name), want, atol=1e-9 * np.abs(want).max())
        assert compressed.solver.facts[name]["rows"] == want.shape[1] < short[name]["rows"]


@pytest.mark.parametrize("inverted", [False, True])
def test_rows_are_enough_for_their_condition(inverted: bool) -> None:
    """Where no number is set: 2, 4, 8, ... times the atoms until sqrt(m/n) <= 2 sigma. Atoms that
    live on few nodes take more than twice their number."""
    model, name, rng = full().model, "bar.elastic", np.random.default_rng(0)
    n = model.block_data(name).size
    for few, atoms in ((True, np.eye(n)[:, :4]), (
            False, np.linalg.qr(snapshots()[name])[0][:, :4])):
        d = Dictionary(atoms, np.zeros(n), ("",) * 4)
        rows = choose_rows(model, None, name, None, 4, LatinHypercube(required=False), d, rng,
                           STEP, inverted)
        image = atoms if inverted else model.block_data(name, step=STEP).operator @ atoms
        sigma = np.linalg.svd(np.linalg.qr(image)[0][rows])[1][-1]
        assert len(rows) in (8, 16, 32, min(64, n))
        assert len(rows) > 8 or not (few and inverted)
        assert np.sqrt(len(rows) / n) <= 2.0 * sigma or len(rows) == min(64, n)


# ------------------------------------------------------------------------ what they bring


@pytest.mark.full
def test_local_terms_are_summed_over_few_elements() -> None:
    """Of k(T) and radiation: the error of galerkin with the same atoms, from fewer elements, whose
    number does not grow with the mesh."""
    kept, k = [], {"temperatures": [293.15, 1073.15], "values": [53.3, 27.3]}
    for n in (12, 24):
        scene = scene_of({
            "bodies": {"b": {
                "use": "flexible", "thickness": 0.01, "fields": ["thermal"], "frame": "fixed",
                "mesh": {"use": "rectangle", "size": [0.1, 0.02], "divisions": [n, n // 3]},
                "material": {"rho": 7850.0, "k": k, "c": 500.0}}},
            "loads": {"heat": {"use": "heat_flux", "on": ["b:left"], "flux": {
                          "use": "pulse", "start": 1.0, "duration": 5.0, "level": 4e5}},
                      "glow": {"use": "radiation", "on": ["b:top", "b:right"], "emissivity": 0.8,
                               "surroundings": 293.15}},
            "training": {"overrides": {"loads.heat.flux": {
                "use": "constant", "level": 1.5e5}}, "end": 10.0},
            "time": {"end": 10.0, "step": 0.25}, "integrator": "bdf2"})
        pod = {"basis": {"use": "pod", "count": 6}}
        whole, best, run, sampled = (simulate(scene.using({"reducer": r})) for r in (
            "full", {"use": "galerkin", **pod}, {"use": "sparse", **pod},
            {"use": "sparse", **pod, "sampler": "leverage"}))
        least, error, other = (
            compare(whole, x=r).errors["x"]["b.thermal"] for r in (best, run, sampled))
        assert error < 3.0 * least and other < 4.0 * least, (error, other, least)
        kept.append(run.summary["elements_touched"]["b.thermal"])
        assert kept[-1] < best.summary["elements_touched"]["b.thermal"]
    assert kept[1] < 1.5 * kept[0], kept


def test_default_takes_rows_of_the_error_where_operators_are_constant() -> None:
    """Without an option: the run of `preconditioned`, in every block, and no note."""
    auto, named = ran(sparse()), ran(sparse(residual="preconditioned"))
    for name in full().model.reducible():
        np.testing.assert_array_equal(auto.block(name), named.block(name))
        assert auto.solver.facts[name]["norm"] == "D^-1"
    assert not [n for n in auto.solver.notes if n.kind == "plain_rows"]


@pytest.mark.full
def test_default_keeps_plain_rows_where_a_row_would_read_every_element_and_says_so() -> None:
    """Element weights are learned from a training run, which modes do not need."""
    model, untrained = everything_assembled(), Sparse.model_validate({"basis": "modal"})
    hot = {b.thermal for b in model.separated.heat if b.local}
    assert hot and inverted_blocks(model, Sparse()) == set(model.reducible())
    assert not plain_rows(model, Sparse())
    assert inverted_blocks(model, untrained) == set(model.reducible()) - hot
    (note,) = plain_rows(model, untrained)
    assert "no training run" in note.text
    assert note.level is Level.INFORMATION and note.kind == "plain_rows"
    assert "glow" in note.text and "deim" in note.text and all(name in note.text for name in hot)
    drawn = samplers(model, untrained)
    assert {n for n, s in drawn.items() if isinstance(s, DeimPoints)} == hot
    for options in ({"residual": "plain"}, {"sampler": "leverage"}, {"resample": 2}):
        own = Sparse.model_validate(options)
        assert set(samplers(model, own).values()) == {own.sampler}
    assert inverted_blocks(model, Sparse(residual="plain")) == frozenset()
    assert not plain_rows(model, Sparse(residual="plain")), "asked for"


@pytest.mark.full
def test_rows_drawn_during_the_run_are_plain_by_default_and_told() -> None:
    run, plain = ran(sparse(resample=3)), ran(sparse(resample=3, residual="plain"))
    for name in full().model.reducible():
        np.testing.assert_array_equal(run.block(name), plain.block(name))
    (note,) = [n for n in run.solver.notes if n.kind == "plain_rows"]
    assert "reducer.row_sets" in note.text and "bar.elastic, bar.thermal" in note.text
    sets = ran(sparse(resample=3, row_sets=2)).solver
    assert sets.facts["bar.elastic"]["norm"] == "D^-1"


def test_by_block_and_told() -> None:
    run = ran(sparse(residual={"*.elastic": "preconditioned", "*.thermal": "plain"}))
    plain = ran(sparse(residual="plain"))
    np.testing.assert_array_equal(run.block("bar.thermal"), plain.block("bar.thermal"))
    assert np.abs(run.block("bar.elastic") - plain.block("bar.elastic")).max() > 0.0
    assert run.solver.facts["bar.elastic"]["norm"] == "D^-1"
    assert "residual" not in run.solver.facts["bar.thermal"]


@pytest.mark.parametrize("options", [
    {"budgets": BUDGETS, "solver": {"use": "greedy_gauss_newton", "candidates": "all"}},
    {"resample": 3, "row_sets": 3},
    {"preconditioner": "row_scaling", "preconditioned": ["elastic", "thermal"]},
], ids=["selection", "row sets", "preconditioner"])
def test_with_selection_row_sets_and_preconditioners(options: dict[str, Any]) -> None:
    found = errors(ran(sparse(residual="preconditioned", **options)))
    bound = 5e-2 if "budgets" in options else 2e-2
    assert all(e < bound for e in found.values()), found


def test_no_row_is_missed_by_a_load() -> None:
    free = {"use": "deim", "required": False}
    budgets = {"*.elastic": {"rows": 5}, "*.thermal": {"rows": 4}}
    solver = ran(sparse(residual="preconditioned", sampler=free, budgets=budgets)).solver
    assert len(solver.rows["bar.elastic"]) == 5 and not solver.notes


# ------------------------------------------------------------------------ refusals


@pytest.mark.parametrize(("options", "key", "words"), [
    ({"residual": {"*.elastc": "preconditioned"}}, "residual.*.elastc", "fits no block"),
    ({"residual": "preconditioned", "resample": 1}, "row_sets", "give a number of row sets"),
])
def test_bad_options_are_told_by_key(options: dict[str, Any], key: str, words: str) -> None:
    faults = sparse(**options).reducer.check(full().model)
    assert [f.key for f in faults] == [key] and words in faults[0].message


@pytest.mark.full
def test_radiation_without_element_weights_would_need_every_element() -> None:
    model = assemble(everything())
    budgets = {"*.elastic": {"rows": 8}, "*.thermal": {"rows": 0}}
    hot = sum(bool(b.local) for b in model.separated.heat)
    assert hot
    for residual, count in (("preconditioned", hot), ({"*.elastic": "preconditioned"}, 0),
                            ("auto", 0)):
        options = {"budgets": budgets, "residual": residual}
        assert not Sparse.model_validate(options).check(model)
        faults = Sparse.model_validate({**options, "basis": "modal"}).check(model)
        assert [f.key for f in faults] == ["residual"] * count
        assert all("every element of glow" in f.message for f in faults)


# ------------------------------------------------------------------------ along a path


@cache
def heated() -> Model:
    """The tiny scene with a source that walks along its upper edge."""
    model = full().model
    (heat,) = model.separated.heat
    places = model.geometry["bar.thermal"][0]
    top = np.flatnonzero(np.isclose(places[:, 1], 0.05))
    times = np.linspace(0.0, 0.04, 41)
    at = np.linspace(0.05, 0.35, 41)[:, None]
    values = 40.0 * np.maximum(0.0, 1.0 - np.abs(places[top, 0] - at) / 0.0625)
    walk = LoadTable(
        "source", csr_array((np.ones(len(top)), (top, np.arange(len(top)))),
                            shape=(len(places), len(top))),
        tuple(f"source, node {i}" for i in top), Table(times, values))
    return replace(model, separated=replace(
        model.separated, heat=(replace(heat, tables=(walk,)),)))


@pytest.mark.parametrize("sampler", [
    LatinHypercube(required="ring"), Uniform(required="ring", unit="node"),
    DeimPoints(required="ring"), Leverage(required="ring"), SOpt(required="ring")], ids=repr)
def test_the_ring_keeps_the_laws_of_samplers(sampler: Any) -> None:
    check_sampler(sampler, seed=4, trials=3)


def test_ring_rows_are_counted_and_kept() -> None:
    model, name = heated(), "bar.thermal"
    ring = model.ring(name)
    kept = np.union1d(model.required[name], ring)
    assert 0 < len(ring) < model.layout[name].stop - model.layout[name].start
    assert len(model.ring("bar.elastic")) == 0 and len(full().model.ring(name)) == 0
    counts = [required_rows(model, name, LatinHypercube(required=r)) for r in (False, True, "ring")]
    assert counts == [0, len(model.required[name]), len(kept)]
    size = model.layout[name].stop - model.layout[name].start
    scene = sparse(sampler={"use": "lhs", "required": "ring"},
                   budgets={"*.elastic": {"rows": 10}, "*.thermal": {"rows": size}})
    (fault,) = scene.reducer.check(model)
    assert f"take at most {size - len(kept)}" in fault.message
    free = size - len(kept)
    few = sparse(sampler={"use": "lhs", "required": "ring"},
                 bases={"*.thermal": {"use": "impulse", "count": 6}},
                 budgets={"*.elastic": {"rows": 10}, "*.thermal": {"rows": min(free, 2)}})
    solver = few.reducer.prepare(ReducedProblem(
        model, few.integrator, few.time.step, Offline.from_snapshots(model, snapshots()),
        np.random.default_rng(0)))
    assert np.isin(kept, solver.rows[name]).all()
    assert len(solver.rows[name]) == len(kept) + min(free, 2)


def test_dictionaries_depend_on_the_step_and_say_when_it_is_missing(tmp_path: Path) -> None:
    from sparsemor.core.simulation.cache import Cache

    offline = Offline(heated(), lambda: [("key", snapshots)], Products(Cache(tmp_path)))
    basis = Impulse(delays=(0, 5))
    a, b, c = (offline.dictionary("bar.thermal", basis, s)[0].atoms for s in (
        STEP, STEP._replace(h=0.1, c1_first=10.0), STEP))
    assert offline.products.used["basis"] == "mixed" and np.array_equal(a, c)
    assert a.shape != b.shape or np.abs(a - b).max() > 1e-3
    with pytest.raises(InputError, match="the time step that bar.thermal is reduced for"):
        offline.dictionary("bar.thermal", basis)
