"""A reduced run whose atoms or rows cannot hold the solution says so, with the right number."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.sparse import csr_array

from small_scenes import tiny
from sparsemor import load, simulate
from sparsemor.core import Dictionary
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.offline import Offline
from sparsemor.plugins.checks.trial_space import trial_spaces
from sparsemor.plugins.comparison.error_norms import measure_errors
from sparsemor.reducers.errors_at_states import StateError
from sparsemor.reducers.projection.projected_error import projected_error, projection_note
from tiers import quick
from tiny_scene import full, snapshots

OF_THE_MODEL = {"trial_space", "beyond_training", "galerkin_error", "sampled_rows", "unsampled",
                "unstable"}
"""Kinds of notes on the accuracy of a reduced model."""
ROWS = {"*.elastic": {"rows": 20}, "*.thermal": {"rows": 10}}


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Cache:
    return Cache(tmp_path_factory.mktemp("cache"))


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    return simulate(tiny(), out=tmp_path_factory.mktemp("reference") / "full")


def run(shared: Cache, tmp_path: Path, scene: Scene | None = None, **reducer: Any) -> RunResult:
    scene = (scene or tiny()).using({"reducer": reducer})
    return simulate(scene, out=tmp_path / "run", cache=shared)


def notes(result: RunResult, kind: str) -> list[str]:
    """Sentences of one kind: its words tell them apart."""
    words = {"trial_space": "cannot represent", "beyond_training": "left the range",
             "sampled_rows": "do not determine", "no_effect": "no effect",
             "galerkin_error": "Galerkin projection on"}[kind]
    found = [text for text in result.summary["notes"] if words in text]
    assert bool(found) == (kind in result.summary["note_kinds"])
    return found


# ------------------------------------------------------------------------ the trial space


@pytest.mark.full
def test_what_too_few_atoms_leave_out_is_said(
    shared: Cache, tmp_path: Path, reference: RunResult
) -> None:
    """The number is the projection error of the snapshots in the measure of `compare`."""
    result = run(shared, tmp_path, use="galerkin", basis={"use": "pod", "count": 1})
    space = {s.name: s for s in trial_spaces(
        full().model, _offline(), _dictionaries(result), tiny().time.step, tiny().time.end)}
    for name in ("bar.elastic", "bar.thermal"):
        x = full().block(name).T
        A = np.asarray(result.to_xarray()[f"{name}.atoms"])
        left = np.linalg.norm(x - A @ np.linalg.lstsq(A, x, rcond=None)[0], axis=0)
        error = float(left.max() / np.linalg.norm(x - x[:, :1], axis=0).max())
        assert space[name].error == pytest.approx(error)
        (text,) = [t for t in notes(result, "trial_space") if name in t]
        assert f"the 1 atoms of {name} cannot represent the training run" in text
        assert f"projection error {error:.2g} of its largest change" in text
        assert measure_errors(reference, result).worst[name] >= 0.99 * error


def _offline() -> Offline:
    offline = Offline.from_snapshots(full().model, snapshots())
    offline.trained = True
    return offline


def _dictionaries(result: RunResult) -> dict[str, Dictionary]:
    data = result.to_xarray()
    return {b.name: Dictionary(np.asarray(data[f"{b.name}.atoms"]),
                               np.asarray(data[f"{b.name}.offset"]), ())
            for b in result.layout if result.reduced(b.name)}


def test_dependent_atoms_span_what_they_span() -> None:
    """Twice the same atoms, and atoms of other lengths, hold as much; a complete basis all."""
    A = np.linalg.qr(full().block("bar.elastic").T)[0][:, :3]
    zero, size = np.zeros(len(A)), len(A)
    found = [trial_spaces(full().model, _offline(), {"bar.elastic": Dictionary(a, zero, ())},
                          tiny().time.step, tiny().time.end)[0]
             for a in (A, np.hstack([A, A @ np.diag([1.0, 5.0, 1e-3])]), np.eye(size))]
    assert found[0].error > 1e-6
    assert found[1].error == pytest.approx(found[0].error, rel=1e-6)
    assert found[2].error == 0.0
    c = np.zeros((2, 6))
    c[1, 4] = 1e6  # another way to write a state far outside
    assert found[1].excess(c)[0] < 0.05 < 1e3 < found[1].excess(c)[1]


@pytest.mark.full
@pytest.mark.parametrize("basis", quick(["modal", "static"], "static"))
def test_without_training_the_estimate_of_the_run_decides(
    shared: Cache, tmp_path: Path, reference: RunResult, basis: str
) -> None:
    result = run(shared, tmp_path, use="galerkin", basis={"use": basis, **(
        {"count": 3} if basis == "modal" else {})})
    assert "training" not in result.summary["cache"]
    said = [t for t in notes(result, "trial_space") if "bar.thermal" in t]
    assert len(said) == 1 and "what the loads of this run do" in said[0]
    stated = float(said[0].split("projection error ")[1].split()[0])
    error = measure_errors(reference, result).worst["thermal"]
    assert error > 0.1 and 0.3 < stated / error < 3.0


@pytest.mark.full
def test_a_good_model_is_not_doubted(shared: Cache, tmp_path: Path, reference: RunResult) -> None:
    for name, reducer in {
        "galerkin": {"use": "galerkin"},
        "free": {"use": "galerkin", "basis": {"use": "modal", "count": 10**4}},
        "sparse": {"use": "sparse", "basis": {"use": "pod", "count": 10}, "budgets": ROWS},
    }.items():
        result = run(shared, tmp_path / name, **reducer)
        assert OF_THE_MODEL.isdisjoint(result.summary["note_kinds"]), name
        assert max(measure_errors(reference, result).worst.values()) < 1e-3


def test_a_field_that_does_not_change_has_no_note() -> None:
    """Without heat its one atom holds it; its change is round-off, and so is what is left out."""
    model, states = full().model, {"bar.thermal": np.full((27, 3), 293.15)}
    states["bar.thermal"][:, 2] *= 1.0 + 1e-14 * np.arange(27)
    offline = Offline.from_snapshots(model, states)
    offline.trained = True
    one = Dictionary(np.full((27, 1), 27.0 ** -0.5), np.zeros(27), ())
    (space,) = trial_spaces(model, offline, {"bar.thermal": one}, 1e-3, 0.01)
    assert space.change == 0.0 and space.error < 1e-12 and space.note() is None


# ------------------------------------------------------------------------ Galerkin solutions


@pytest.mark.full
def test_the_error_of_galerkin_solutions_is_foreseen(
    shared: Cache, tmp_path: Path, reference: RunResult
) -> None:
    """One atom holds the states to 0.2 of their change, and its solution is wrong by 0.7: stiff
    deformations weigh more in the equations than in the error."""
    result = run(shared, tmp_path, use="galerkin", bases={"*.elastic": {"use": "pod", "count": 1}})
    (text,) = notes(result, "galerkin_error")
    stated, best = (float(text.split(f"{words} ")[1].split()[0].rstrip("):"))
                    for words in ("has an error of", "projected orthogonally"))
    error = measure_errors(reference, result).worst["bar.elastic"]
    assert stated > 2.0 * best
    assert 0.8 < stated / error < 1.25


def test_galerkin_errors_are_those_of_the_reduced_equations() -> None:
    """For x = 0 at the start, the solution of A^T D A c = A^T D x; best: the orthogonal part."""
    rng = np.random.default_rng(4)
    half = rng.standard_normal((9, 9))
    D, A = half @ half.T + 0.1 * np.eye(9), np.linalg.qr(rng.standard_normal((9, 2)))[0]
    x = np.hstack([np.zeros((9, 1)), rng.standard_normal((9, 4))])
    change = np.linalg.norm(x, axis=0).max()
    found = projected_error(Dictionary(A, np.zeros(9), ()), csr_array(D), x)
    assert found is not None
    solved = A @ np.linalg.solve(A.T @ D @ A, A.T @ D @ x)
    assert found.solved == pytest.approx(np.linalg.norm(x - solved, axis=0).max() / change)
    assert found.best == pytest.approx(np.linalg.norm(x - A @ A.T @ x, axis=0).max() / change)
    assert found.best <= found.solved
    whole = projected_error(Dictionary(np.eye(9), np.zeros(9), ()), csr_array(D), x)
    assert whole is not None and whole.solved < 1e-12 and projection_note(whole, "a", 9) is None
    assert projected_error(Dictionary(A, np.zeros(9), ()), csr_array(D), x[:, :1]) is None


@pytest.mark.parametrize(("galerkin", "best", "noted"), [
    (0.02, 0.002, True), (0.009, 0.001, False), (0.3, 0.2, False), (0.5, 0.2, True)])
def test_galerkin_errors_are_noted_beyond_those_of_the_atoms(
    galerkin: float, best: float, noted: bool
) -> None:
    note = projection_note(StateError(galerkin, best), "bar.elastic", 3)
    assert (note is not None) == noted
    if note is not None:
        assert f"an error of {galerkin:.2g} of its largest change" in note.text


# ------------------------------------------------------------------------ beyond training


@pytest.mark.full
def test_a_run_that_leaves_its_training_says_when_and_by_how_much(
    shared: Cache, tmp_path: Path
) -> None:
    half = tiny().using({"training.end": 0.02})
    result = run(shared, tmp_path, half, use="galerkin", basis={"use": "pod", "count": 6})
    (text,) = [t for t in notes(result, "beyond_training") if "bar.thermal" in t]
    assert "training ended at 0.02 s, the run at 0.04 s: train longer (training.end)" in text
    share = int(text.split(" in ")[1].split("%")[0])
    first = float(text.split("first at ")[1].split()[0])
    assert 0.02 <= first < 0.03 and 30 <= share <= 50
    assert np.count_nonzero(result.times >= first) / len(result.times) == pytest.approx(
        share / 100, abs=0.02)
    within = run(shared, tmp_path / "within", tiny().using({
        "time.end": 0.02, "training.end": 0.04}), use="galerkin", basis={"use": "pod", "count": 6})
    assert notes(within, "beyond_training") == []


@pytest.mark.full
def test_a_small_estimated_error_makes_it_no_warning(shared: Cache, tmp_path: Path) -> None:
    """With many atoms the estimate shows that the run is right outside the range, too; with few it
    shows that it is not."""
    half = tiny().using({"training.end": 0.02})
    for count, warned in ((12, False), (2, True)):
        result = run(shared, tmp_path / str(count), half, use="galerkin", error_estimate="on",
                     basis={"use": "pod", "count": count})
        left = [text for text in [*result.summary["notes"], *result.summary["information"]]
                if "bar.thermal left the range" in text]
        (text,) = left
        estimate = float(text.split("estimated error of ")[1].split(";")[0])
        assert (estimate > 1e-3) is warned
        assert (text in result.summary["notes"]) is warned and ("train longer" in text) is warned


# ------------------------------------------------------------------------ loads never trained


CASES = Path(__file__).parents[2] / "support" / "cases" / "reduced"


@pytest.mark.full
def test_a_load_that_was_absent_from_training_is_noted(tmp_path: Path) -> None:
    """The heat of the run did not act in training, where the temperature was constant: relative
    error above 0.9, and the note states it before the run."""
    scene, block = load(CASES / "1_t6_s23.yaml"), "b.thermal"
    full, reduced = (simulate(scene.using({"reducer": r}), out=tmp_path / r)
                     for r in ("full", "galerkin"))
    error = measure_errors(full, reduced).worst[block]
    (text,) = [t for t in notes(reduced, "trial_space") if block in t]
    stated = float(text.split("projection error ")[1].split()[0])
    assert error > 0.9 and stated == pytest.approx(error, rel=0.1)
    assert "did not contain it" in text


@pytest.mark.full
def test_larger_loads_of_the_same_shape_are_no_reason_for_a_note(
    shared: Cache, tmp_path: Path
) -> None:
    """Twice the flux of training leaves the range of coordinates, not the span of the atoms."""
    scene = tiny().using({"training": {"overrides": {"loads.heating.flux": 5.0e5}}})
    result = run(shared, tmp_path, scene, use="galerkin")
    full = simulate(tiny(), out=tmp_path / "full")
    assert max(measure_errors(full, result).worst.values()) < 1e-3
    assert OF_THE_MODEL.isdisjoint(result.summary["note_kinds"])


# ------------------------------------------------------------------------ sampled rows


@pytest.mark.full
def test_the_error_of_sampled_rows_is_foreseen(
    shared: Cache, tmp_path: Path, reference: RunResult
) -> None:
    """Atoms that hold the motion to 1 %, and rows that make of it ten times its size; good rows
    have a small one, and no note."""
    good = run(shared, tmp_path / "good", use="sparse", budgets=ROWS,
               basis={"use": "pod", "count": 6})
    stated = good.summary["facts"]["bar.elastic"]["row_error"]
    error = measure_errors(reference, good).worst["elastic"]
    assert error < 1e-2 and 0.1 < stated / error < 10.0 and notes(good, "sampled_rows") == []
    result = run(shared, tmp_path, use="sparse", residual="plain", budgets=ROWS,
                 basis={"use": "pod", "count": 8},
                 bases={"*.elastic": {"use": "modal", "count": 10}})
    stated = result.summary["facts"]["bar.elastic"]["row_error"]
    error = measure_errors(reference, result).worst["elastic"]
    assert error > 0.1 and 0.3 < stated / error < 3.0
    (text,) = notes(result, "sampled_rows")
    assert "sampled rows of bar.elastic do not determine its 10 atoms" in text
    assert f"{stated:.2g} of their largest change" in text


# ------------------------------------------------------------------------ options without effect


@pytest.mark.full
@pytest.mark.parametrize(("options", "says"), [
    ({"solver": "omp"}, "reducer.solver has no effect: every budget covers its dictionary"),
    ({"solver": {"use": "greedy_gauss_newton", "gain": 0.5}}, "reducer.solver has no effect"),
    ({"hysteresis": 0.5}, "reducer.hysteresis has no effect"),
    ({"selection": "joint"}, "reducer.selection has no effect"),
    ({"carried": False, "every": 3}, "reducer.every, reducer.carried have no effect"),
    ({"preconditioner": "row_scaling", "preconditioned": []}, "names no block of this scene"),
    ({"preconditioned": ["*.elastic"]}, "reducer.preconditioner is none"),
    ({"bases": {"*": {"use": "pod", "count": 8}}, "basis": "modal"}, "reducer.basis has no effect"),
    ({"sampler": "random", "budgets": {"*.elastic": {"rows": 47}, "*.thermal": {"rows": 24}}},
     "reducer.sampler has no effect: all rows of every block are taken"),
])
def test_an_option_without_effect_is_said(
    shared: Cache, tmp_path: Path, options: dict[str, Any], says: str
) -> None:
    plain = {"use": "sparse", "basis": {"use": "pod", "count": 8}, "budgets": ROWS}
    short = tiny().using({"time.end": 0.002, "training.end": 0.04})
    (text,) = notes(run(shared, tmp_path, short, **{**plain, **options}), "no_effect")
    assert says in text
    acts = {**plain, "solver": {"use": "greedy_gauss_newton", "rtol": 1e-8}}
    assert notes(run(shared, tmp_path / "acts", short, **acts), "no_effect") == []
