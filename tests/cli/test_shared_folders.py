"""Runs that share folders, or lose theirs: nobody's result is harmed, and nobody ends `done` with
arrays that are missing or another run's."""

import contextvars
import errno
import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from sparsemor import InputError, SolveFailed, Status, load, open_result, simulate
from sparsemor.core.cli import app
from sparsemor.core.registry.hooks import hookimpl
from sparsemor.core.results.atomic_files import replace_file
from sparsemor.core.results.files.written_files import LISTING
from sparsemor.core.results.npz_archive import write_archive
from sparsemor.core.results.output_directory import COMPARISON
from sparsemor.core.results.output_lock import LOCK
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.simulation import stages_before_steps
from sparsemor.plugins.command_line.options import place_for_result
from sparsemor.plugins.publishing.listed_files import add_part

TESTS = Path(__file__).parents[1]
TINY = TESTS / "scenes" / "tiny.yaml"
RESULT = {"result", "result.checkpoint"}
"""What a run leaves in its folder."""
KILLED = TESTS / "support" / "hostile" / "killed_force.py"
SHORT: dict[str, Any] = {"time.end": 0.02}
SETTINGS = ["--set", "time.end=0.02"]
REFUSED = ["--set", "time.end=0.0155"]  # no whole number of steps: found in the run's own check


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SPARSEMOR_CACHE", str(tmp_path / "cache"))


class AtStep:
    """Does something once, in the middle of a run, and keeps what came of it."""

    def __init__(self, step: int, action: Callable[[], Any]) -> None:
        self.step, self.action, self.found = step, action, None

    @hookimpl
    def on_step(self, step: int) -> None:
        if step == self.step:
            self.found = self.action()


def other(*arguments: str | Path) -> tuple[int, str]:
    """The program as another process would run it: locks are held by context. Exit code, errors."""
    done = contextvars.Context().run(CliRunner().invoke, app, [str(a) for a in arguments])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, done.stderr


def scene(**changes: Any) -> Any:
    return load(TINY, SHORT | {k.replace("__", "."): v for k, v in changes.items()})


def assert_same(run: RunResult, whole: RunResult) -> None:
    assert (run.status, whole.status) == (Status.DONE, Status.DONE)
    for name in ("bar.rigid", "bar.elastic", "bar.thermal", "pin.multiplier"):
        assert np.array_equal(run.block(name), whole.block(name)), name
    assert np.array_equal(run.times, whole.times)


@pytest.mark.full
def test_a_refused_run_removes_nothing_of_others() -> None:
    with pytest.raises(InputError, match="found late"), place_for_result(
            Path("runs/b"), resume=False, force=False):
        simulate(scene(), out="runs/a")  # another run, while this one is at work
        Path("runs/notes.txt").write_text("mine", encoding="utf-8")
        raise InputError("found late")
    assert_same(open_result("runs/a"), simulate(scene(), out="whole"))
    assert Path("runs/notes.txt").exists() and not Path("runs/b").exists()


def test_a_refused_run_leaves_nothing_of_its_own() -> None:
    code, _ = other("run", TINY, *REFUSED, "--out", "a/b/c")
    assert code == 2 and not Path("a").exists()


@pytest.mark.full
def test_force_onto_a_run_at_work_is_refused() -> None:
    force = AtStep(7, lambda: other("run", TINY, *SETTINGS, "--out", "out", "--force"))
    run = simulate(scene(), out="out", observers=[force])
    assert force.found == (
        2, "--out: another run is writing to out: wait for it, or choose another --out\n")
    assert_same(run, simulate(scene(), out="whole"))
    assert {p.name for p in Path("out").iterdir()} == RESULT


@pytest.mark.full
def test_two_runs_into_one_new_directory(monkeypatch: pytest.MonkeyPatch) -> None:
    """The second one comes while the first is still assembling: nothing is stored yet."""
    found: list[tuple[int, str]] = []
    resolved = stages_before_steps.resolved_start

    def second(*arguments: Any) -> Any:
        if not found:
            found.append((0, ""))
            found[0] = other("run", TINY, *SETTINGS, "--out", "out")
        return resolved(*arguments)

    monkeypatch.setattr(stages_before_steps, "resolved_start", second)
    code, errors = other("run", TINY, *SETTINGS, "--out", "out")
    assert code == 0 and "another run" not in errors, errors
    assert found[0][0] == 2 and "another run is writing to out" in found[0][1]
    assert_same(open_result("out"), simulate(scene(), out="whole"))


@pytest.mark.full
def test_compare_owns_its_directory() -> None:
    inside = AtStep(7, lambda: other(
        "compare", TINY, *SETTINGS, "--out", "out", "--force", "--reducers", "full,galerkin"))
    Path("out").mkdir()
    add_part(Path("out"), "full", COMPARISON)
    simulate(scene(), out="out/full", observers=[inside])
    assert inside.found is not None and inside.found[0] == 2
    assert "another run is writing to out/full" in inside.found[1]
    assert open_result("out/full").status is Status.DONE
    assert {p.name for p in Path("out").iterdir()} == {LISTING, "full"}


def lose(how: str) -> None:
    if how == "removed":
        shutil.rmtree("out")
    elif how == "store removed":
        shutil.rmtree("out/result")
    else:
        Path("out").rename("moved")
    if how == "replaced":
        shutil.copytree("whole", "out")


@pytest.mark.full
@pytest.mark.parametrize("how", ["moved", "removed", "store removed", "replaced"])
def test_a_directory_lost_in_mid_run_ends_the_run(
    how: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sparsemor.core.simulation.recorder.CHUNK", 5)
    whole = simulate(scene(), out="whole")
    with pytest.raises(OSError, match="moved, removed or replaced while the run") as caught:
        simulate(scene(), out="out", observers=[AtStep(13, lambda: lose(how))])
    assert str(caught.value.filename).endswith("out/result")
    if how == "moved":
        left = open_result("moved")
        assert left.status is Status.INTERRUPTED and 1 < len(left.times) < 15
        assert_same(simulate(scene(), out="moved", resume=True), whole)
    if how == "replaced":
        assert_same(open_result("out"), whole)
        assert {p.name for p in Path("out").iterdir()} == RESULT
    else:
        assert not Path("out/result").exists()


@pytest.mark.full
def test_a_file_that_is_lost_in_mid_run_ends_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sparsemor.core.simulation.recorder.CHUNK", 5)
    lost = Path("out/result/steps-000000.npz")
    monkeypatch.setattr("sparsemor.core.results.result_variables.CHUNK_STEPS", 8)
    with pytest.raises(OSError, match="steps 0 to 7 are lost"):
        simulate(scene(), out="out", observers=[AtStep(18, lost.unlink)])
    assert json.loads(Path("out/result/header.json").read_text(encoding="utf-8"))[
        "attributes"]["status"] == "interrupted"


def interrupted() -> None:
    """A run in `out` that was stopped by Ctrl-C in its middle."""
    import signal

    with pytest.raises(SolveFailed):
        simulate(scene(), out="out", observers=[
            AtStep(9, lambda: signal.raise_signal(signal.SIGINT))])


@pytest.mark.full
def test_two_resume_at_once() -> None:
    interrupted()
    again = AtStep(15, lambda: other("run", TINY, *SETTINGS, "--out", "out", "--resume"))
    run = simulate(scene(), out="out", resume=True, observers=[again])
    assert again.found is not None and again.found[0] == 2
    assert "another run is writing to out" in again.found[1]
    assert_same(run, simulate(scene(), out="whole"))


@pytest.mark.full
def test_a_lock_of_a_process_that_is_gone_is_no_lock() -> None:
    Path("out").mkdir()
    Path("out", LOCK).touch()
    assert other("run", TINY, *SETTINGS, "--out", "out")[0] == 0
    assert {p.name for p in Path("out").iterdir()} == RESULT


@pytest.mark.full
def test_force_keeps_the_earlier_result_until_the_new_run_has_ended() -> None:
    whole = simulate(scene(), out="out")
    assert other("run", TINY, *REFUSED, "--out", "out", "--force")[0] == 2
    assert_same(open_result("out"), whole)
    assert {p.name for p in Path("out").iterdir()} == RESULT
    assert other("run", TINY, "--set", "time.end=0.01", "--out", "out", "--force")[0] == 0
    assert len(open_result("out").times) == 11
    assert {p.name for p in Path("out").iterdir()} == RESULT


@pytest.mark.full
def test_a_kill_during_force_loses_no_result() -> None:
    """At each of the renames of a forced run, killed.py kills it and repeats the command."""
    done = subprocess.run([sys.executable, KILLED, TINY], capture_output=True,
                          text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    moments = json.loads(done.stdout)
    assert {m["killed"] for m in moments} == {True, False} and len(moments) > 5
    for m in moments:
        assert m["kept"], m  # the earlier result can be read, where it was or where it is kept
        assert m["put back"], m  # by the next run, also where that one is refused
        assert m["replaced"] == [True, sorted(RESULT)], m  # by the next that reaches its end


@pytest.mark.full
def test_writes_that_fail_leave_nothing_or_what_can_be_continued(
    monkeypatch: pytest.MonkeyPatch
) -> None:
    """Writes of a short run fail in turn, as on a full disk or at a limit of file size."""
    whole = simulate(scene(), out="whole")
    write, count, left, nothing, continued = Path.write_bytes, 0, 0, 0, 0

    def limited(self: Path, data: bytes) -> int:
        nonlocal left
        if "out" in self.parts:
            left -= 1
            if left < 0:
                raise OSError(errno.ENOSPC, "No room")
        return write(self, data)

    monkeypatch.setattr(Path, "write_bytes", limited)
    monkeypatch.setattr("sparsemor.core.simulation.recorder.CHUNK", 7)
    while True:
        left = count
        status, errors = other("run", TINY, *SETTINGS, "--out", "out")
        left = 10**6
        if status == 0:
            break
        assert status == 1 and errors.endswith(": No room\n") and "/result" in errors, errors
        if Path("out").exists():
            assert open_result("out").status is Status.INTERRUPTED
            assert other("run", TINY, *SETTINGS, "--out", "out", "--resume")[0] == 0
            assert_same(open_result("out"), whole)
            shutil.rmtree("out")
            continued += 1
        else:
            nothing += 1
        count += 1
    assert nothing > 2 and continued > 2


@pytest.mark.full
def test_a_store_without_a_step_can_be_read_and_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    """As a kill leaves it that comes between the store and its first step."""
    class Killed(BaseException):
        pass

    def kill(*_: object) -> None:
        raise Killed

    with monkeypatch.context() as patched:
        patched.setattr("sparsemor.core.results.result_writer.ResultWriter.append", kill)
        with pytest.raises(Killed):
            simulate(scene(), out="out")
    left = open_result("out")
    assert left.status is Status.INTERRUPTED and len(left.times) == 0
    assert left.block("bar.elastic").shape[0] == 0
    with pytest.raises(InputError, match="no stored step yet"):
        left.steps_at(None)
    code, errors = other("run", TINY, *SETTINGS, "--out", "out", "--resume")
    assert code == 2 and "stopped before its first checkpoint" in errors
    assert other("run", TINY, *SETTINGS, "--out", "out", "--force")[0] == 0


def test_names_longer_than_files_can_have_are_refused(tmp_path: Path) -> None:
    long = "n" * 101
    for key in (f"bodies.{long}", f"loads.{long}", f"joints.{long}", f"probes.{long}"):
        value = {"bodies": "rigid", "loads": "gravity", "joints": "revolute"}.get(
            key.partition(".")[0], "{body: bar, position: [0, 0]}")
        code, errors = other("validate", TINY, "--set", f"{key}={value}")
        assert code == 2 and f"--set {key}: a name has at most 100 characters" in errors
    code, errors = other("run", TINY, *SETTINGS, "--out", "o" * 300)
    assert code == 2 and "is not writable" in errors and "choose another --out" in errors


def test_writing_never_makes_a_folder_that_is_gone(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        replace_file(tmp_path / "gone" / "file", b"x")
    with pytest.raises(FileNotFoundError):
        write_archive(tmp_path / "gone" / "file.npz", {"a": np.ones(4)}, "run")
    assert not list(tmp_path.glob("gone"))
