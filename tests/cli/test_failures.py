"""A run that cannot go on stops with status, time, block and advice, and keeps what it has."""

import json
import re
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from sparsemor import SolveFailed, Status, load, open_result, simulate
from sparsemor.core.cli import app
from sparsemor.core.results.run_result import RunResult

SCENES = Path(__file__).parents[1] / "scenes"
SWING, PLATE = str(SCENES / "swing.yaml"), str(SCENES / "plate.yaml")
FEW = {"*.elastic": {"rows": 7, "atoms": 6}, "*.thermal": {"rows": 6, "atoms": 5}}
BLOCK = re.compile(r"\w+\.(rigid|elastic|thermal)")

STOPS = {"not_converged", "not_finite", "diverged"}

TWINS = '''
import numpy as np

from sparsemor.core import Basis, Dictionary


class Twins(Basis):
    """A basis with two atoms that differ in one unknown."""

    needs_snapshots = False

    def build(self, data):
        atoms = np.ones((data.size, 2))
        atoms[data.size // 2, 1] = 2.0
        return Dictionary(atoms, np.zeros(data.size), ("one", "same on most rows"))
'''


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SPARSEMOR_CACHE", str(tmp_path / "cache"))


def run(scene: str, **settings: Any) -> SimpleNamespace:
    """`sparsemor run` with `--set` of each setting, dots written as __."""
    changes = [x for key, value in settings.items()
               for x in ("--set", f"{key.replace('__', '.')}={json.dumps(value)}")]
    done = CliRunner().invoke(app, ["run", scene, *changes, "--out", "out", "--json"])
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return SimpleNamespace(code=done.exit_code, shown=json.loads(done.stdout),
                           lines=done.stderr.splitlines())


def assert_all_finite(result: RunResult) -> None:
    data = result.to_xarray()
    for name, values in data.variables.items():
        if values.dtype.kind == "f":
            assert np.isfinite(values.to_numpy()).all(), name
    for b in result.layout:
        assert np.isfinite(result.block(b.name)).all()


def assert_tells_all(done: SimpleNamespace, statuses: set[str]) -> RunResult:
    """Exit code 1; status, time, block and advice in one line; where the result is in another."""
    assert done.code == 1
    assert done.shown["status"] in statuses
    status = Status(done.shown["status"])
    message, where = (t for t in done.lines if not t.startswith(("warning: ", "note: ")))
    assert message == done.shown["message"]
    assert message.startswith(f"{status.value} at t = ")
    assert message.endswith(status.advice_for(sampled=bool(done.shown["rows"])))
    assert re.search(f" s in {BLOCK.pattern}[ :]", message)
    assert where == f"results up to the failure: {Path('out/result').absolute()}"
    result = open_result("out")
    assert result.status is status
    assert len(result.times) == done.shown["steps"] + 1
    assert float(message.split()[4]) == pytest.approx(
        result.times[-1] + result.attributes["step"], rel=1e-5)
    assert_all_finite(result)
    return result


@pytest.mark.full
@pytest.mark.parametrize("settings", [
    {"time__step": 0.1, "time__end": 2.0, "bodies__arm__pose__spin": 60.0},
    {"loads__sun__flux": 1e308},
    {"loads__weight__g": [0.0, -1e6]},
], ids=["large step, fast spin", "huge heat", "huge weight"])
def test_too_large_a_step_or_load(settings: dict[str, Any]) -> None:
    assert_tells_all(run(SWING, reducer="full", **settings), STOPS)


@pytest.mark.full
@pytest.mark.parametrize("settings", [
    {"time__step": 0.07, "time__end": 3.15, "training__end": 3.15,
     "integrator": "generalized_alpha"},
], ids=["large step"])
def test_steps_that_need_the_exact_jacobian_are_counted(settings: dict[str, Any]) -> None:
    """They ended `not_converged` before there was Newton's method to fall back to."""
    done = run(SWING, reducer="full", **settings)
    assert (done.code, done.shown["status"]) == (0, "done")
    assert any("exact Jacobian" in text for text in done.shown["information"])
    assert_all_finite(open_result("out"))


@pytest.mark.full
def test_a_start_that_overflows_leaves_no_result() -> None:
    done = run(SWING, reducer="full", loads__weight__g=[0.0, -1e300])
    assert (done.code, done.shown["status"]) == (1, "not_finite")
    (line,) = done.lines
    assert line == done.shown["message"] and line.startswith("not_finite at t = 0 s in ")
    assert not Path("out").exists()


@pytest.mark.full
def test_in_the_training_run() -> None:
    """Nothing was computed of the run itself, so there is no result."""
    done = run(SWING, loads__sun__flux=1e308)
    assert done.code == 1
    (line,) = done.lines
    assert "training run" in line and done.shown["message"] == line
    assert not Path("out").exists()


def unstable(**settings: Any) -> tuple[int, SimpleNamespace]:
    """The first seed whose sample of few rows cannot carry the motion, and how its run ended."""
    for seed in range(1, 21):
        shutil.rmtree("out", ignore_errors=True)
        done = run(SWING, seed=seed, reducer__budgets=FEW, reducer__sampler__required=False,
                   reducer__residual="plain", integrator="generalized_alpha", **settings)
        if done.code:
            return seed, done
    raise AssertionError("every sample was stable")


@pytest.mark.full
def test_an_unstable_sample_without_the_required_rows() -> None:
    """The published variant: rows of joints and loads are drawn or missed like any other."""
    seed, done = unstable()
    assert_tells_all(done, STOPS)
    shutil.rmtree("out")
    kept = run(SWING, seed=seed, reducer__budgets=FEW, reducer__residual="plain",
               integrator="generalized_alpha")
    assert (kept.code, kept.shown["status"]) == (0, "done")
    # the rows are as poor as they were, but damped
    (note,) = [n for n in kept.shown["notes"] if "do not determine" in n]
    assert "16 sampled rows of arm.elastic do not determine its 6 atoms well enough" in note


@pytest.mark.slow
def test_unstable_samples_of_the_packaged_scene() -> None:
    few = {"*.elastic": {"rows": 36, "atoms": 30}, "*.thermal": {"rows": 24, "atoms": 20}}
    failed = 0
    for seed in range(1, 11):
        shutil.rmtree("out", ignore_errors=True)
        done = run("double_pendulum", time__end=1.0, training__end=1.0, seed=seed,
                   reducer__budgets=few, reducer__sampler__required=False,
                   reducer__residual="plain")
        failed += done.code
        if done.code:
            assert_tells_all(done, STOPS)
    assert 1 <= failed <= 9


@pytest.mark.full
def test_redundant_joints_have_forces_of_least_norm() -> None:
    again = {"use": "revolute", "between": ["ground", "arm:left"]}
    done = run(SWING, joints__again=again)
    assert done.code == 0
    (note,) = (n for n in done.shown["notes"] if "depend on each other" in n)
    assert note.startswith("the constraints of pivot and again depend on each other: 2 of them "
                           "follow from the others")


@pytest.mark.full
def test_a_body_that_nothing_holds_falls_freely() -> None:
    done = run(SWING, joints={}, reducer="full", time__end=0.1)
    assert done.code == 0
    for probe, x in (("weight_point", 1.0), ("tip", 1.0)):
        position = done.shown["probes"][probe]["position"]
        # BDF1 falls h t / 2 further than g t^2 / 2
        assert position == pytest.approx([x, 0.05 - 9.81 * 0.1 * 0.101 / 2], abs=2e-5)


@pytest.mark.full
def test_a_rank_deficient_sample(distribute: Any) -> None:
    distribute("twins", {"basis": {"twins": "mod_twins:Twins"}}, mod_twins=TWINS)
    done = run(PLATE, reducer__basis="twins", reducer__residual="plain")
    assert done.code == 1 and done.shown["status"] == "rank_deficient"
    (line,) = done.lines
    assert line.startswith("rank_deficient at t = 0 s in plate.thermal (reciprocal condition ")
    assert line.endswith(Status.RANK_DEFICIENT.advice)


@pytest.mark.full
def test_a_failed_run_keeps_its_last_step_whatever_is_stored() -> None:
    _, done = unstable(output__every=150)
    result = open_result("out")
    assert result.times[-1] == pytest.approx(done.shown["t_end"])
    assert done.shown["t_end"] == pytest.approx(1e-3 * done.shown["steps"])
    assert len(result.times) == 2 + (done.shown["steps"] - 1) // 150
    assert_all_finite(result)


@pytest.mark.full
def test_a_sample_that_misses_a_load_is_told() -> None:
    lines: list[str] = []
    for seed in range(1, 21):
        shutil.rmtree("out", ignore_errors=True)
        done = run(PLATE, seed=seed, reducer__residual="plain")
        lines = [t for t in done.lines if " that lamp acts on: " in t]
        if lines:
            break
    (line,) = lines
    assert done.code == 0
    assert line.startswith("warning: no sampled row of plate.thermal is one that lamp acts on: ")
    warned = [t for t in done.lines if t.startswith("warning: ")]
    assert done.shown["notes"] == [t.removeprefix("warning: ") for t in warned]
    above = done.shown["probes"]["above"]["temperature"]
    shutil.rmtree("out")
    heated = run(PLATE, reducer="full").shown["probes"]["above"]["temperature"]
    assert above < heated - 5.0  # the lamp is not felt


@pytest.mark.slow
def test_compare_shows_a_run_that_failed() -> None:
    seed, _ = unstable()
    shutil.rmtree("out")
    changes = {"seed": seed, "integrator": "generalized_alpha", "reducer.sampler.required": False,
               "reducer.residual": "plain", "reducer.budgets": FEW}
    sets = [x for k, v in changes.items() for x in ("--set", f"{k}={json.dumps(v)}")]
    done = CliRunner().invoke(
        app, ["compare", SWING, "--reducers", "full,sparse", *sets, "--training-end", "1",
              "--out", "out"])
    assert done.exit_code == 1
    row = next(line for line in done.stdout.splitlines() if line.startswith("sparse "))
    assert row.split()[1] in STOPS
    *warnings, last = done.stderr.splitlines()
    predicted = "warning: sparse: the reduced model is unstable in "
    assert all(line.startswith("warning: sparse: ") for line in warnings
               if "too stiff" not in line and "long for this run" not in line)
    assert sum(line.startswith(predicted) for line in warnings) == 1
    assert last.startswith(f"sparse: {row.split()[1]} at t = ")
    assert Path("out/errors.csv").is_file()


@pytest.mark.full
def test_in_python(tmp_path: Path) -> None:
    scene = load(SWING, {"reducer": "full", "loads.sun.flux": 1e308})
    with pytest.raises(SolveFailed) as caught:
        simulate(scene, out=tmp_path / "out")
    error = caught.value
    assert error.status in (Status.NOT_FINITE, Status.NOT_CONVERGED)
    assert error.time == pytest.approx(1e-3) and BLOCK.fullmatch(error.block)
    assert isinstance(error.result, RunResult)
    assert len(error.result.times) == 1
    assert error.result.summary["message"] == str(error)
