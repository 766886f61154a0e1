"""One word of a packaged scene swapped for another: no run ends `done`, is off by more than 0.1 in
a field, and says nothing. Short runs; the slow ones are all scenes and all words."""

import importlib.util
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from sparsemor import load, simulate
from sparsemor.core.results.relative_error_estimates import LIMIT
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.cache import Cache

ROOT = Path(__file__).parents[2]
COARSE = {"bodies.link1.mesh.elements": 320, "bodies.link2.mesh.elements": 320}


def made_by(script: str) -> Any:
    spec = importlib.util.spec_from_file_location("maker", ROOT / "docs" / script)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


SWAPS = made_by("make_swaps.py")


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
    ({"reducer.basis": "static"}, True, "trial_space"),
    ({"reducer.basis": "craig_bampton"}, False, "trial_space"),
    ({"reducer.solver": "omp"}, False, "no_effect"),
    ({"reducer.carried": False}, False, "no_effect"),
    ({"reducer": "galerkin"}, False, ""),
])
def test_a_word_of_the_pendulum(
    pendulum: tuple[Scene, RunResult, Path, Cache], tmp_path: Path, word: Mapping[str, Any],
    wrong: bool, kind: str,
) -> None:
    scene, reference, _, cache = pendulum
    status, error, kinds, _ = SWAPS.outcome(
        scene.using(word), reference, tmp_path / "run", cache)
    assert status == "done" and (error > LIMIT) is wrong
    assert kind in kinds if kind else not kinds


def test_the_page_shows_the_stored_outcomes() -> None:
    rows = SWAPS.read()
    assert SWAPS.PAGE.read_text(encoding="utf-8") == SWAPS.page(rows)
    swaps = [r for r in rows if r["set"] != "{}"]
    assert len(swaps) == len(SWAPS.SCENES) * len(SWAPS.WORDS) == 84
    assert sum(r["status"] == "done" for r in swaps) >= 75
    for row in swaps:
        assert row["status"] in ("done", "refused") and SWAPS.cell(row) != "WRONG", row
        if "solver\": " in row["set"] and "linear" not in row["set"] or "carried" in row["set"]:
            assert "no_effect" in row["notes"], row


@pytest.mark.slow
@pytest.mark.parametrize("name", SWAPS.SCENES)
def test_swaps_of_a_packaged_scene_end_as_stored(name: str, tmp_path: Path) -> None:
    stored = [r for r in SWAPS.read() if r["scene"] == name]
    found = list(SWAPS.outcomes(name, tmp_path))
    assert [SWAPS.cell(r).partition(" (")[0] for r in found] == [
        SWAPS.cell(r).partition(" (")[0] for r in stored]
    assert found[0]["status"] == "done" and not found[0]["notes"]
