"""The shell: completion, lists that fit the terminal, `init` and `doctor`, and advice that names
options which a command has."""

import json
import logging
import os
import pty
import shutil
import subprocess
import sys
from pathlib import Path

import meshio
import numpy as np
import pytest

from in_process import sparsemor
from sparsemor import load, simulate
from sparsemor.core.registry.registry import Registry
from sparsemor.plugins.command_line.completion import (
    plugin_names,
    scene_names,
    settings,
    stored_runs,
    study_names,
)

ROOT = Path(__file__).parents[2]
PROGRAM = Path(sys.executable).with_name("sparsemor")
ROD = ROOT / "docs" / "examples" / "rod.msh"
TINY = ROOT / "tests" / "scenes" / "tiny.yaml"
pytestmark = pytest.mark.usefixtures("here")


class Given:
    """What a shell knows of a command line: parameters and words that are left."""

    def __init__(self, scene: object) -> None:
        self.params, self.args = {"scene": None}, [str(scene)]


def test_words_are_completed() -> None:
    Path("mine.yaml").write_text("")
    Path("notes.txt").write_text("")
    Path("runs/a/result").mkdir(parents=True)
    Path("runs/a/result/header.json").write_text("{}")
    Path("runs/b").mkdir()
    assert scene_names("hot_pl") == ["hot_plate"] and study_names("samp") == ["samplers"]
    assert scene_names("m") == ["mine.yaml"] and not scene_names("n")
    assert stored_runs("ru") == ["runs/"] and stored_runs("runs/") == ["runs/a", "runs/b/"]
    assert {"sampler", "lhs"} <= set(plugin_names("")) and plugin_names("s_o") == ["s_opt"]
    assert settings(Given(TINY), "time.s") == ["time.step="]  # type: ignore[arg-type]
    assert "bodies.bar.material.E=" in settings(Given(TINY), "")  # type: ignore[arg-type]
    assert settings(Given("no"), "reducer.sampler=l") == [  # type: ignore[arg-type]
        "reducer.sampler=leverage", "reducer.sampler=lhs"]
    assert settings(Given("nothing"), "time.") == []  # type: ignore[arg-type]


@pytest.mark.full
@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_each_shell_completes(shell: str) -> None:
    words = {"COMP_WORDS": "sparsemor run hot_pl", "COMP_CWORD": "2",
             "_TYPER_COMPLETE_ARGS": "sparsemor run hot_pl",
             "_TYPER_COMPLETE_FISH_ACTION": "get-args"}
    done = subprocess.run([PROGRAM], env={**os.environ, "_SPARSEMOR_COMPLETE": f"complete_{shell}",
                          **words}, capture_output=True, text=True, check=True)
    assert "hot_plate" in done.stdout


def test_plugins_fit_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    code, out, _ = sparsemor("plugins")
    lines = out.splitlines()
    assert code == 0 and len(lines) < 60 and max(map(len, lines)) <= 80
    registry = Registry()
    words = set(out.replace(",", " ").split())
    assert {p.name for k in registry.kinds() for p in registry.names(k)
            if p.distribution == "sparsemor"} <= words


@pytest.mark.full
def test_a_scene_for_a_mesh_runs_as_it_is() -> None:
    shutil.copy(ROD, "rod.msh")
    code, _, err = sparsemor("init", "rod.msh")
    assert code == 2 and "--hold" in err and "bore_a (16 points)" in err
    assert sparsemor("init", "rod.msh", "--hold", "bore_c")[0] == 2
    assert not Path("rod.yaml").exists()
    words = ("init", "rod.msh", "--hold", "bore_a", "--load", "bore_b", "--heat", "top")
    code, out, _ = sparsemor(*words, "--json")
    assert code == 0 and json.loads(out)["scale"] == 1e-3
    text = Path("rod.yaml").read_text()
    assert "bore_a (16 points)" in text and text.count("#") > 8
    code, _, err = sparsemor(*words)
    assert code == 2 and "rod.yaml exists" in err and Path("rod.yaml").read_text() == text
    run = simulate(load("rod.yaml"))
    f = json.loads(out)["frequency"]
    assert run.status.ok and not run.summary["notes"]
    assert run.times[1] == pytest.approx(1 / (50 * f), rel=0.6)
    weight = 9.81 * json.loads(out)["mass"]
    force = load("rod.yaml").dump()["loads"]["push"]["force"][1]
    assert 0.3 * weight < -force <= weight
    length, bending = 0.3875 - 0.0125, 2.1e11 * 0.01 * 0.05**3 / 12  # of a beam
    first = 0.1615 * 0.05 / length**2 * (2.1e11 / 7850) ** 0.5  # Hz; it is held by a bore: softer
    sag = length**3 / bending * (-force / 3 + weight / 8) * (first / f) ** 2
    assert sag < -run.probe("end")[:, 3].min() < 2.0 * sag  # more than at rest; twice if sudden


@pytest.mark.full
@pytest.mark.parametrize("name", ["END_A", "true", "7", "left: a", "x, y", 'the "left"'])
def test_names_of_sets_are_written_as_they_are(name: str) -> None:
    text = ROD.read_text()
    assert text.count('"bore_b"') == 1
    Path("rod.msh").write_text(text.replace('"bore_b"', f'"{name}"'))
    words = ("init", "rod.msh", "--hold", "bore_a", "--load", name, "--heat", name)
    assert sparsemor(*words, "--quiet") == (0, "", "")
    scene = load("rod.yaml").dump()
    assert scene["loads"]["push"]["on"] in (f"rod:{name}", [f"rod:{name}"])
    assert scene["loads"]["heat"]["on"] == [f"rod:{name}"]
    assert sparsemor("validate", "rod.yaml")[0] == 0


@pytest.mark.full
def test_a_scene_for_a_solid_mesh_without_sets() -> None:
    n = np.arange(12).reshape(3, 2, 2)
    points = np.indices((3, 2, 2)).reshape(3, -1).T * [50.0, 10.0, 10.0]
    cells = [[n[i, 0, 0], n[i + 1, 0, 0], n[i + 1, 1, 0], n[i, 1, 0],
              n[i, 0, 1], n[i + 1, 0, 1], n[i + 1, 1, 1], n[i, 1, 1]] for i in (0, 1)]
    meshio.Mesh(points, [("hexahedron", cells)]).write("my box.vtk")
    assert sparsemor("init", "my box.vtk", "--out", "box.yaml", "--quiet") == (0, "", "")
    run = simulate(load("box.yaml"))
    assert run.status.ok and run.bodies == ("my_box",)
    assert run.points("my_box").max() == pytest.approx(0.1)
    code, _, err = sparsemor("init", TINY, "--out", "tiny.yaml")
    assert code == 2 and "supported formats" in err


@pytest.mark.full
def test_init_asks_for_the_sets() -> None:
    shutil.copy(ROD, "rod.msh")
    ours, theirs = pty.openpty()
    os.write(ours, b"bor\nbore_a\nbore_b\nnone\n")
    done = subprocess.run([PROGRAM, "init", "rod.msh"], stdin=theirs, capture_output=True,
                          text=True, check=True)
    os.close(ours), os.close(theirs)
    assert "Which set is held?" in done.stdout and "did you mean" in done.stdout
    assert load("rod.yaml").dump()["bodies"]["rod"]["reference"]["clamp"] == "bore_a"
    assert set(load("rod.yaml").loads) == {"weight", "push"}


@pytest.mark.full
def test_doctor_reports_what_is_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    found = json.loads(sparsemor("doctor", "--json")[1])
    assert found["packages"]["numpy"] == np.__version__ and not found["missing"]
    assert found["extras"]["fast"] in ([], ["numba"]) and found["threads"] == 1
    assert found["kernels"] and found["plugins"]["sparsemor"] > 100
    assert found["cache"]["folder"] == os.environ["SPARSEMOR_CACHE"]
    assert found["cache"]["writable"] and found["cache"]["bytes"] == {}
    code, out, _ = sparsemor("doctor")
    assert code == 0 and len(out.splitlines()) < 30 and "no machine code kept" in out


def test_advice_names_no_option_that_a_command_lacks() -> None:
    Path("there").mkdir()
    Path("there/letter.txt").write_text("mine")
    for command in (("solve", TINY, "static"), ("run", TINY)):
        code, _, err = sparsemor(*command, "--out", "there")
        assert code == 2 and "--force" in err and ("--resume" in err) == (command[0] == "run")


@pytest.mark.full
def test_runs_are_logged_where_one_listens(caplog: pytest.LogCaptureFixture) -> None:
    scene = load(TINY)
    simulate(scene)
    assert not [r for r in caplog.records if r.name == "sparsemor"]
    assert not logging.getLogger("sparsemor").handlers
    with caplog.at_level("INFO", "sparsemor"):
        simulate(scene.using({"reducer": {"use": "galerkin", "basis": {"use": "pod", "count": 3}}}))
    told = [r.getMessage() for r in caplog.records if r.name == "sparsemor"]
    assert any("galerkin (run): 40 steps from 0 to 0.04 s" in t for t in told)
    assert any(t.startswith("offline: ") for t in told) and told[-1] == "done after 40 steps"


@pytest.mark.full
def test_arrays_have_the_names_of_their_components() -> None:
    run = simulate(load(TINY, {
        "time.end": 0.01, "probes": {"end": {"body": "bar", "at": "end_b"}}}))
    angle = run.history("bar.rigid").sel(unknown="angle")
    assert np.array_equal(angle, run.block("bar.rigid")[:, 2])
    table = run.to_dataframe("end")
    assert list(table.columns) == list(run.probe_header("end").components)
    assert np.array_equal(table.to_numpy(), run.probe("end"))
    assert np.array_equal(table.index, run.times)
    assert list(run.to_dataframe("pin").columns) == ["force x", "force y"]
    assert "image/gif" in run.animate(frames=2)._repr_html_()
    assert len(run.plot("joint_forces").axes) == 1
