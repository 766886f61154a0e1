"""The commands on real scenes: what they print, what they write, and nothing else."""

import fcntl
import json
import os
import pty
import re
import struct
import subprocess
import sys
import termios
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from sparsemor import load, open_result, simulate
from sparsemor.core.cli import app

SWING = Path(__file__).parents[1] / "scenes" / "swing.yaml"
PROGRAM = Path(sys.executable).with_name("sparsemor")
Program = Callable[..., tuple[str, str]]
pytestmark = pytest.mark.usefixtures("here")
BLOCKS = {"arm.elastic", "arm.thermal"}
KEYS = {"status", "scene", "reducer", "steps", "t_end", "wall_s", "ms_per_step",
        "newton_iterations", "factorizations", "rows", "atoms", "atoms_active", "elements_touched",
        "probes", "out"}


def said(err: str) -> list[str]:
    """Lines of stderr without warnings that elements bend too little and that steps are long."""
    known = ("loads that bend it into its lowest modes", "is long for this run")
    return [line for line in err.splitlines() if not any(k in line for k in known)]


def installed(*arguments: object) -> tuple[str, str]:
    """Standard output and error of the installed program, which must succeed."""
    done = subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True,
                          check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


def sparsemor(*arguments: object) -> tuple[str, str]:
    """The same in this process: most of what a short command takes is to start."""
    done = CliRunner().invoke(app, [*map(str, arguments)], prog_name="sparsemor")
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    assert done.exit_code == 0, done.stderr
    return done.stdout, done.stderr


def in_json(*arguments: object, program: Program = sparsemor) -> dict[str, Any]:
    out, err = program(*arguments, "--json")
    assert said(err) == []
    shown = json.loads(out)  # one object and nothing else
    assert isinstance(shown, dict)
    return shown


def assert_summary(s: dict[str, Any], reducer: str, steps: int) -> None:
    assert KEYS <= set(s)
    assert (s["status"], s["scene"], s["reducer"]) == ("done", "swing", reducer)
    assert (s["steps"], s["t_end"]) == (steps, pytest.approx(1e-3 * steps))
    assert set(s["wall_s"]) == {"offline", "online"}
    assert 0 < s["ms_per_step"] < 1e3 * s["wall_s"]["online"]
    assert s["newton_iterations"] >= 1 and s["factorizations"] >= 1
    assert set(s["elements_touched"]) == BLOCKS
    assert set(s["probes"]) == {"tip", "weight_point"}
    assert len(s["probes"]["weight_point"]["position"]) == 2
    assert 293 < s["probes"]["tip"]["temperature"] < 300
    assert set(s["atoms"]) == set(s["atoms_active"]) == (set() if reducer == "full" else BLOCKS)
    assert set(s["rows"]) == (BLOCKS if reducer == "sparse" else set())


@pytest.mark.full
def test_run_in_json() -> None:
    first = in_json("run", SWING, program=installed)
    assert_summary(first, "sparse", 200)
    assert first["cache"] == {"training": "miss", "basis": "miss"} | {
        k: "miss" for k in first["cache"]}
    assert first["rows"]["arm.elastic"] > 16 and first["atoms"]["arm.elastic"] == 6
    assert Path(first["out"]) == Path("runs/swing-sparse").absolute()
    result = open_result(first["out"])
    assert result.summary == first
    again = in_json("run", SWING, "--force")
    assert set(again["cache"].values()) == {"hit"}
    assert again["probes"] == first["probes"]
    assert [p.name for p in Path("runs").iterdir()] == ["swing-sparse"]


@pytest.mark.full
def test_run_in_words() -> None:
    out, err = installed("run", SWING, "--set", "time.end=0.05", "--out", "there")
    # no progress bar: this is no terminal
    assert all(line.startswith("note: ") for line in said(err))
    lines = [re.split(r"  +", line, maxsplit=1) for line in out.splitlines()]
    *table, last = lines
    assert last == ["result: there"]
    words = dict(reversed(table))
    assert words["status"] == "done" and words["steps"] == "50 to t = 0.05 s"
    assert "cache: training miss, basis miss" in words["offline"]
    assert re.fullmatch(r"[\d.e-]+ s \([\d.e-]+ ms/step\)", words["online"])
    assert table[-1][0] == "probes" and table[-1][1].startswith("weight_point: position 0.99")
    again, _ = sparsemor("run", SWING, "--set", "time.end=0.05", "--out", "there", "--force")
    assert "cache: " in again and "miss" not in again
    assert sparsemor("run", SWING, "--set", "time.end=0.05", "--quiet") == ("", "")


@pytest.mark.slow
def test_compare_goes_on_where_it_stopped() -> None:
    asked = ["compare", SWING, "--reducers", "full,galerkin", "--set", "time.end=0.02",
             "--training-end", "1", "--out", "out"]
    simulate(load(SWING, {"reducer": "full", "time.end": 0.02, "training.end": 0.02}),
             out="out/full")
    before = Path("out/full/result/header.json").read_bytes()
    out, _ = sparsemor(*asked, "--resume")
    assert Path("out/full/result/header.json").read_bytes() == before
    assert [line.split()[0] for line in out.splitlines()[2:4]] == ["full", "galerkin"]
    assert out.splitlines()[-1] == "table and charts: out"
    changed = subprocess.run(
        [PROGRAM, *map(str, asked), "--resume", "--set", "loads.sun.flux=1"], capture_output=True,
        text=True, check=False)
    assert changed.returncode == 2 and "was made from another scene" in changed.stderr


def on_terminal(*arguments: object) -> tuple[str, str]:
    """Standard output, and what a terminal of 120 columns shows of standard error."""
    outer, inner = pty.openpty()
    fcntl.ioctl(inner, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 120, 0, 0))
    environment = os.environ | {"TERM": "xterm", "COLUMNS": "120"}
    process = subprocess.Popen([PROGRAM, *map(str, arguments)], stdout=subprocess.PIPE,
                               stderr=inner, text=True, env=environment)
    os.close(inner)
    shown = b""
    while True:
        try:
            part = os.read(outer, 4096)
        except OSError:  # Linux says so when the other side is closed
            break
        if not part:
            break
        shown += part
    os.close(outer)
    out, _ = process.communicate(timeout=600)
    assert process.returncode == 0
    return out, shown.decode(errors="replace")


@pytest.mark.slow
def test_a_progress_bar_on_a_terminal() -> None:
    long = ["--set", "reducer=full", "--set", "time.end=3"]
    out, shown = on_terminal("run", SWING, *long)
    plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", shown)
    assert "A heated flexible arm swings with a rigid bob full" in plain
    assert re.search(r"t = [\d.]+ of 3 s", plain)
    assert re.search(r"\d+ steps/s", plain)
    assert re.search(r"\d:\d\d:\d\d", plain)  # time left
    assert out.startswith("status ")
    assert said(on_terminal("run", SWING, *long, "--force", "--json")[1]) == []


@pytest.mark.slow
def test_the_packaged_scene_with_its_defaults() -> None:
    out, err = sparsemor("run", "double_pendulum")
    assert all(line.startswith("note: ") for line in said(err)), err
    assert "4000 to t = 4 s" in out
    assert out.splitlines()[-1] == "result: runs/double_pendulum-sparse"
    assert open_result("runs/double_pendulum-sparse").summary["status"] == "done"
