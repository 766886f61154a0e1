"""The program as a process: Ctrl-C, a reader that leaves, `python -m sparsemor`."""

import os
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

from in_process import sparsemor
from sparsemor.core.status import SolveFailed, Status
from toy_scene import TOY_SCENE

pytestmark = pytest.mark.usefixtures("toys", "here")


@pytest.fixture(autouse=True)
def scene(here: Path) -> None:
    (here / "scene.yaml").write_text(TOY_SCENE)


@pytest.mark.parametrize("command", ["run", "validate"])
def test_ctrl_c_has_code_130_wherever_it_strikes(monkeypatch, command):
    def strike(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("sparsemor.core.simulation.simulate.simulate", strike)
    monkeypatch.setattr("sparsemor.core.simulation.validation.checked_model", strike)
    done = sparsemor(command, "scene.yaml")
    assert (done.code, done.out, done.err) == (130, "", "interrupted\n")


def test_a_run_interrupted_between_two_steps_has_code_130(monkeypatch):
    def simulate(scene, **options):
        raise SolveFailed(Status.INTERRUPTED, 0.25)

    monkeypatch.setattr("sparsemor.core.simulation.simulate.simulate", simulate)
    done = sparsemor("run", "scene.yaml")
    assert (done.code, done.out) == (130, "")
    assert done.err == "interrupted at t = 0.25 s: continue it with --resume\n"


STRUCK = """
import sys
class Strike:
    def find_spec(self, name, path=None, target=None):
        if name == "typer":
            raise KeyboardInterrupt
sys.meta_path.insert(0, Strike())
from sparsemor.core.cli import main
main()
"""


@pytest.mark.full
def test_ctrl_c_while_the_program_is_imported_is_no_traceback():
    done = subprocess.run([sys.executable, "-c", STRUCK], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "interrupted\n")


@pytest.mark.full
def test_a_reader_that_leaves_is_no_traceback():
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run([sys.executable, "-m", "sparsemor", "--version"], stdout=write,
                          stderr=subprocess.PIPE, text=True)
    os.close(write)
    assert (done.returncode, done.stderr) == (1, "")


@pytest.mark.full
def test_the_package_is_a_program_too():
    done = subprocess.run([sys.executable, "-m", "sparsemor", "--version"], capture_output=True,
                          text=True)
    assert (done.returncode, done.stdout) == (0, version("sparsemor") + "\n")


@pytest.mark.full
@pytest.mark.skipif(sys.platform == "win32", reason="a POSIX shell")
@pytest.mark.parametrize(("streams", "code", "error"), [
    (">&-", 0, ""), (">&- 2>&-", 0, ""), ("<&- >&- 2>&-", 0, ""),
    (">/dev/full", 1, "standard output: No space left on device\n"), (">/dev/full 2>&1", 1, "")])
def test_closed_and_full_streams_are_no_traceback(streams: str, code: int, error: str) -> None:
    if "full" in streams and not Path("/dev/full").exists():
        pytest.skip("no /dev/full")
    done = subprocess.run(
        ["sh", "-c", f'"$0" -m sparsemor schema {streams}', sys.executable], capture_output=True,
        text=True)
    assert (done.returncode, done.stdout) == (code, "")
    assert done.stderr in (error, error.replace("standard output", "input or output"))


CLOSED = """
import os, sys
os.close(1)
import sparsemor.core.cli
with open("result", "w") as file:
    assert file.fileno() > 2
    os.write(1, b"what a library prints")
assert os.path.getsize("result") == 0
print("nothing", file=sys.stdout)
"""


@pytest.mark.full
def test_no_file_gets_the_number_of_a_closed_stream() -> None:
    done = subprocess.run([sys.executable, "-c", CLOSED], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


ENDED = """
import os, signal, sys, threading
signal.signal(getattr(signal, sys.argv[1]), getattr(signal, sys.argv[2]))
import sparsemor.core.cli as cli
from sparsemor.core.results.files.temporary_folders import TemporaryFolder

def app():
    global folder
    folder = TemporaryFolder()
    print(folder.path, flush=True)
    os.kill(os.getpid(), getattr(signal, sys.argv[1]))
    threading.Event().wait(float(sys.argv[3]))

cli.app = app
cli.main()
"""


def ended(name: str, handling: str, seconds: float) -> "subprocess.CompletedProcess[str]":
    """A program with a temporary folder, whose path it prints, that is sent a signal and goes on
    for `seconds` unless this ends it. handling: that of the signal at its start; without it, tests
    under nohup would start programs that ignore SIGHUP."""
    return subprocess.run([sys.executable, "-c", ENDED, name, handling, str(seconds)],
                          capture_output=True, text=True)


@pytest.mark.full
@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP", "SIGINT"])
def test_a_program_that_is_ended_leaves_no_temporary_folder(name: str) -> None:
    done = ended(name, "default_int_handler" if name == "SIGINT" else "SIG_DFL", 60)
    assert (done.returncode, done.stderr) == (130, "interrupted\n")
    assert done.stdout and not Path(done.stdout.strip()).exists()


@pytest.mark.full
@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_a_program_under_nohup_goes_on_after_a_hangup() -> None:
    done = ended("SIGHUP", "SIG_IGN", 0)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout and not Path(done.stdout.strip()).exists()
