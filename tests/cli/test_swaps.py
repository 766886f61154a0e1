"""One word of a packaged scene swapped for another: no run ends `done`, is off by more than 0.1 in
a field, and says nothing. Short runs; the slow ones are all scenes and all words."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from sparsemor import load, simulate
from sparsemor.core.errors import InputError
from sparsemor.core.results.error_norms import LIMIT, measure_errors
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.status import SolveFailed

BASES = ("modal", "craig_bampton", "static", "attachment", "impulse", "dictionary")
WORDS: tuple[Mapping[str, Any], ...] = (
    *({"reducer": name} for name in ("galerkin", "deim", "gnat", "lspg", "ecsw", "sparse")),
    *({"reducer.basis": name} for name in BASES),
    *({"reducer.sampler": name} for name in ("deim", "s_opt", "leverage", "random")),
    *({"reducer.solver": name} for name in ("omp", "cosamp", "basis_pursuit_lp")),
    *({"reducer.preconditioner": name} for name in ("untf", "parseval", "row_scaling")),
    *({"integrator": name} for name in ("generalized_alpha", "bdf2")),
    {"linear_solver": "splu"}, {"reducer.carried": False})
COARSE = {"bodies.link1.mesh.elements": 320, "bodies.link2.mesh.elements": 320}
SCENES = {
    "double_pendulum": {"time.end": 0.1, "training.end": 0.1},
    "slider_plate": {"time.end": 1.875e-4, "training.end": 1.875e-4},
    "brake_disk": {"time.end": 0.02, "training.end": 0.02},
}


def outcome(scene: Scene, reference: RunResult, folder: Path, cache: Cache
            ) -> tuple[str, float, list[str]]:
    """Status, largest error of a field, kinds of the warnings."""
    try:
        run = simulate(scene, out=folder, cache=cache)
    except InputError:
        return "refused", 0.0, []
    except SolveFailed as failure:
        return failure.status.value, 0.0, []
    worst = measure_errors(reference, run).worst
    error = max(worst[field] for field in ("rigid", "elastic", "thermal") if field in worst)
    # an undershoot is of the elements, in full order too, and says nothing of the reduction
    return run.status.value, error, [
        kind for kind in run.summary["note_kinds"] if kind != "undershoot"]


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory: pytest.TempPathFactory
             ) -> Iterator[tuple[Scene, RunResult, Path, Cache]]:
    folder = tmp_path_factory.mktemp("swaps")
    cache = Cache(folder / "cache")
    scene = load("double_pendulum").using(COARSE | {"time.end": 0.03, "training.end": 0.03})
    full = simulate(scene.using({"reducer": "full"}), out=folder / "full", cache=cache)
    yield scene, full, folder, cache


@pytest.mark.full
@pytest.mark.parametrize(("word", "wrong", "kind"), [
    ({}, False, ""),
    ({"reducer.basis": "modal"}, True, "trial_space"),
    ({"reducer.basis": "static"}, True, "sampled_rows"),
    ({"reducer.basis": "craig_bampton"}, True, "beyond_training"),
    ({"reducer.solver": "omp"}, False, "no_effect"),
    ({"reducer.carried": False}, False, "no_effect"),
    ({"reducer": "galerkin"}, False, ""),
])
def test_a_word_of_the_pendulum(
    pendulum: tuple[Scene, RunResult, Path, Cache], tmp_path: Path, word: Mapping[str, Any],
    wrong: bool, kind: str,
) -> None:
    scene, reference, _, cache = pendulum
    status, error, kinds = outcome(scene.using(word), reference, tmp_path / "run", cache)
    assert status == "done" and (error > LIMIT) is wrong
    assert kind in kinds if kind else not kinds


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_no_word_of_a_packaged_scene_is_silently_wrong(name: str, tmp_path: Path) -> None:
    cache = Cache(tmp_path / "cache")
    scene = load(name).using(SCENES[name])
    full = simulate(scene.using({"reducer": "full"}), out=tmp_path / "full", cache=cache)
    lines, silent = [], []
    for number, word in enumerate(({}, *WORDS)):
        try:
            swapped = scene.using(word)
        except InputError:
            lines.append(f"{word}: refused")
            continue
        reference = full
        if "integrator" in word:  # its own: errors of time stepping are none of the reduction
            try:
                reference = simulate(swapped.using({"reducer": "full"}), cache=cache)
            except SolveFailed as failure:
                lines.append(f"{word}: full order ends {failure.status.value}")
                continue
            except InputError:
                lines.append(f"{word}: full order is refused")
                continue
        status, error, kinds = outcome(swapped, reference, tmp_path / f"run{number}", cache)
        lines.append(f"{word}: {status}, {error:.2g}, {', '.join(kinds) or 'no note'}")
        immobile = "reducer.solver" in word or "reducer.carried" in word
        if status == "done" and not kinds and (error > LIMIT or immobile):
            silent.append(lines[-1])
    print("\n".join([name, *lines]))
    assert not silent, "\n".join(lines)
    assert lines[0].endswith("no note") and " done, " in lines[0]
