"""The program as a process: Ctrl-C, a reader that leaves, `python -m sparsemor`."""

import os
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from sparsemor.core.cli import app
from sparsemor.core.status import SolveFailed, Status
from toy_scene import TOY_SCENE

pytestmark = pytest.mark.usefixtures("toys", "here")


@pytest.fixture(autouse=True)
def scene(here: Path) -> None:
    (here / "scene.yaml").write_text(TOY_SCENE)


def sparsemor(*arguments: str) -> SimpleNamespace:
    done = CliRunner().invoke(app, list(arguments))
    return SimpleNamespace(code=done.exit_code, out=done.stdout, err=done.stderr)


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
