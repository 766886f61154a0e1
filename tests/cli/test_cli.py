"""The program: exit codes, one JSON object, clear lines, nothing written on bad input."""

import json
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from in_process import sparsemor
from sparsemor.core.errors import InputError
from sparsemor.core.notes import Note
from sparsemor.core.results.stored_arrays import FORMAT, write_header
from sparsemor.core.scene.scene import Scene, load
from sparsemor.core.simulation.checks import Checks
from sparsemor.core.status import SolveFailed, Status
from toy_scene import TOY_SCENE

SUMMARY = {"status": "done", "scene": "scene", "reducer": "tuned", "steps": 3, "t_end": 1.0,
           "wall_s": {"offline": 0.2, "online": 0.3}, "ms_per_step": 2.0, "rows": {"a.elastic": 12}}

pytestmark = pytest.mark.usefixtures("toys")


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch) -> Path:
    place = tmp_path / "here"
    place.mkdir()
    monkeypatch.chdir(place)
    Path("scene.yaml").write_text(TOY_SCENE)
    return place


@pytest.fixture
def runs(monkeypatch) -> list[SimpleNamespace]:
    """Replaces the time loop: what was asked for, and a directory as a run leaves it."""
    asked: list[SimpleNamespace] = []

    def simulate(scene, *, out=None, resume=False, observers=(), **shared):
        asked.append(SimpleNamespace(scene=scene, out=out, resume=resume, observers=observers))
        name = scene.dump()["reducer"]["use"]
        if scene.bodies["a"].mass > 100:
            raise InputError("too heavy to hold", "bodies.a.mass")
        (out / "result").mkdir(parents=True, exist_ok=True)
        write_header(out / "result", {"arrays": {}, "attributes": {
            "format": FORMAT, "run": name, "status": "done", "steps_per_chunk": 8,
            "mass": scene.bodies["a"].mass}})
        if scene.bodies["a"].mass > 10:
            raise SolveFailed(Status.SINGULAR, 0.25, "a.rigid")
        return SimpleNamespace(summary={**SUMMARY, "reducer": name, "out": str(out)}, path=out)

    module = ModuleType("sparsemor.core.simulation.simulate")
    module.simulate = simulate
    monkeypatch.setitem(sys.modules, "sparsemor.core.simulation.simulate", module)
    monkeypatch.setattr("sparsemor.core.simulation.validation.checked_model", lambda scene: None)
    return asked


def test_run_writes_where_it_says(runs):
    done = sparsemor("run", "scene.yaml", "--set", "reducer.sampler.mix=1e-1")
    assert (done.code, done.err) == (0, "")
    assert runs[0].out == Path("runs/scene-tuned")
    assert runs[0].scene.reducer.sampler.mix == 0.1
    assert list(runs[0].observers) == []
    for part in ("done", "3 to t = 1 s", "2 ms/step", "a.elastic: 12", "runs/scene-tuned"):
        assert part in done.out


def test_run_prints_one_json_object(runs):
    done = sparsemor("run", "scene.yaml", "--json", "--out", "there")
    assert json.loads(done.out) == {**SUMMARY, "out": "there"}
    assert sparsemor("run", "scene.yaml", "--quiet").out == ""


def test_an_earlier_result_is_kept_unless_told_otherwise(runs):
    assert sparsemor("run", "scene.yaml").code == 0
    mine, group = (Path("runs/scene-tuned/result", name) for name in ("mine", "header.json"))
    mine.touch()
    before = group.read_bytes()
    again = sparsemor("run", "scene.yaml")
    assert again.code == 2
    assert "--resume" in again.err and "--force" in again.err
    refused = sparsemor("run", "scene.yaml", "--force", "--set", "bodies.a.mass=1000")
    assert refused.code == 2
    assert mine.exists() and group.read_bytes() == before
    assert sparsemor("run", "scene.yaml", "--force", "--set", "bodies.a.mass=2").code == 0
    assert mine.exists() and group.read_bytes() != before
    assert sorted(Path("runs/scene-tuned").rglob("*")) == [group.parent, group, mine]
    assert [p.name for p in Path("runs").iterdir()] == ["scene-tuned"]


def test_force_removes_nothing_but_results(runs):
    Path("mine").mkdir()
    Path("mine/thesis.tex").touch()
    done = sparsemor("run", "scene.yaml", "--out", "mine", "--force")
    assert done.code == 2
    assert Path("mine/thesis.tex").exists()


def test_bad_input_has_code_2_and_writes_nothing(runs, here):
    before = sorted(here.rglob("*"))
    for arguments, expected in [
        (["--set", "time.step=0"], "--set time.step: Input should be greater than 0 (got 0)"),
        (["--set", "time.step"], "--set takes key=value, as time.end=0.5 (got time.step)"),
        (["--set", "seed=[1"], "--set seed: "),
        (["--set", "bodies.a.mass=1e3"], "--set bodies.a.mass: too heavy to hold"),
    ]:
        done = sparsemor("run", "scene.yaml", *arguments)
        assert (done.code, done.out) == (2, "")
        assert done.err.startswith(expected)
        assert "Traceback" not in done.err
    Path("scene.yaml").write_text(TOY_SCENE.replace("mass: 1", "mass: 1e3"))
    assert sparsemor("run", "scene.yaml").err == (
        "scene.yaml:3:18: bodies.a.mass: too heavy to hold\n")
    assert sorted(here.rglob("*")) == before


def test_bad_input_in_json():
    done = sparsemor("run", "nowhere.yaml", "--json")
    assert done.code == 2
    assert json.loads(done.out) == {
        "status": "bad_input", "errors": ["nowhere.yaml: there is no such file"]}


def test_a_failed_run_has_code_1(runs):
    done = sparsemor("run", "scene.yaml", "--set", "bodies.a.mass=11")
    assert done.code == 1
    assert "singular at t = 0.25 s in a.rigid" in done.err
    done = sparsemor("run", "scene.yaml", "--set", "bodies.a.mass=11", "--json", "--out", "x")
    assert json.loads(done.out)["status"] == "singular"


def test_unknown_options_and_missing_arguments_have_code_2():
    assert sparsemor("run").code == 2
    assert sparsemor("run", "scene.yaml", "--colour").code == 2


def checked_by(monkeypatch: pytest.MonkeyPatch, check: Callable[[Scene], None]) -> None:
    """Toy bodies cannot be built: this stands in for what builds and counts."""
    module = ModuleType("sparsemor.core.simulation.validation")
    monkeypatch.setattr(module, "checked_model", check, raising=False)
    monkeypatch.setitem(sys.modules, "sparsemor.core.simulation.validation", module)


def test_validate_also_builds_the_parts(monkeypatch):
    def check(scene):
        if scene.bodies["a"].mass > 100:
            raise InputError("too heavy to hold", "bodies.a.mass")
        return SimpleNamespace(bodies={}, layout=(), separated=SimpleNamespace(moving=()))

    checked_by(monkeypatch, check)
    monkeypatch.setattr(Checks, "of_model", lambda checks, scene, model: (
        Note("the mass is 3 tons", "heavy"),) if scene.bodies["a"].mass == 3 else ())
    done = sparsemor("validate", "scene.yaml")
    assert (done.code, done.err) == (0, "")
    done = sparsemor("validate", "scene.yaml", "--set", "bodies.a.mass=3")
    assert (done.code, done.err) == (0, "warning: the mass is 3 tons\n")
    done = sparsemor("validate", "scene.yaml", "--set", "bodies.a.mass=1000")
    assert (done.code, done.err) == (2, "--set bodies.a.mass: too heavy to hold\n")
    done = sparsemor("validate", "scene.yaml", "--set", "bodies.a.mas=1", "--set", "format=3")
    assert done.code == 2
    assert [line.split(": ")[0] for line in done.err.splitlines()] == [
        "--set bodies.a.mas", "--set format"]
    shown = json.loads(sparsemor("validate", "scene.yaml", "--json").out)
    assert shown["scene"]["bodies"]["a"] == {"use": "ball", "mass": 1.0}


def test_settings_are_applied_before_the_scene_is_checked():
    Path("scene.yaml").write_text(TOY_SCENE.replace("use: tuned", "use: gone"))
    assert sparsemor("run", "scene.yaml").code == 2
    assert load("scene.yaml", {"reducer": "direct"}).dump()["reducer"] == {"use": "direct"}


@pytest.mark.full
def test_plugins_lists_broken_and_duplicate_ones_with_code_0(distribute):
    distribute("bad-pkg", {"toy_sampler": {"bad": "mod_bad:Bad"}}, mod_bad="import nothing_there")
    distribute("twin", {"toy_sampler": {"dice": "mod_twin:Dice"}}, mod_twin="")
    done = sparsemor("plugins", "toy_sampler", "--json")
    assert done.code == 0
    found = {(p["name"], p["distribution"]): p for p in json.loads(done.out)["plugins"]}
    assert "nothing_there" in found["bad", "bad-pkg"]["broken"]
    assert found["dice", "toys"]["broken"] == ""
    assert "no attribute 'Dice'" in found["dice", "twin"]["broken"]
    assert [found["dice", owner]["use"] for owner in ("toys", "twin")] == ["toys:dice", "twin:dice"]
    assert found["grid", "toys"]["doc"] == "A sampler."
    table = sparsemor("plugins", "toy_sampler")
    assert (table.code, table.err) == (0, "")
    assert "BROKEN" in table.out


@pytest.mark.full
def test_plugins_with_a_name_shows_its_options():
    done = sparsemor("plugins", "grid")
    assert "toy_sampler grid (toys 1.0): A sampler." in done.out
    for part in ("mix", "number <= 1", "0.5", "How mixed"):
        assert part in done.out
    tuned = json.loads(sparsemor("plugins", "tuned", "--json").out)["plugins"][0]["options"]
    assert tuned[0] == {"name": "sampler", "type": "toy_sampler plugin", "required": False,
                        "default": "grid", "doc": "Chooses rows."}
    unknown = sparsemor("plugins", "gird")
    assert unknown.code == 2
    assert "did you mean grid" in unknown.err


@pytest.mark.full
def test_plugins_shows_whole_sentences_and_types_in_words(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    (ecsw,) = json.loads(sparsemor("plugins", "ecsw", "--json").out)["plugins"]
    assert ecsw["doc"].startswith("ECSW, ") and ecsw["doc"].endswith("2014).")
    assert {o["name"]: o["type"] for o in ecsw["options"]}["bases"] == "name: basis plugin"
    shown = " ".join(sparsemor("plugins", "ecsw").out.split())
    assert "Annotated" not in shown and "\u2026" not in shown
    assert "did you mean the kind linear_solver or sparse_solver?" in sparsemor(
        "plugins", "solver").err


def test_plugins_shows_the_whole_cause_of_a_broken_one(monkeypatch, distribute):
    monkeypatch.setenv("COLUMNS", "80")
    name = "a_package_with_a_name_that_does_not_fit_into_one_line_of_eighty_columns"
    distribute("bad-pkg", {"toy_sampler": {"bad": "mod_long:Bad"}}, mod_long=f"import {name}")
    lines = sparsemor("plugins", "toy_sampler").out.splitlines()
    last = "".join(line.split("\u2502")[-2].strip() for line in lines if "\u2502" in line)
    assert name in last


@pytest.mark.full
def test_schema_and_version_are_printed():
    assert json.loads(sparsemor("schema").out)["title"] == "Scene"
    assert sparsemor("--version").out.strip() == version("sparsemor")


def test_new_plugin_writes_a_package_once():
    done = sparsemor("new-plugin", "my_rows", "--kind", "sampler")
    assert done.code == 0
    assert 'my_rows = "sparsemor_my_rows:MyRows"' in Path(
        "sparsemor-my-rows/pyproject.toml").read_text()
    assert sparsemor("new-plugin", "my_rows", "--kind", "sampler").code == 2
    assert "did you mean sampler" in sparsemor("new-plugin", "x", "--kind", "sampelr").err
    assert sparsemor("new-plugin", "My-Rows", "--kind", "sampler").code == 2
