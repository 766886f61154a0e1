"""Damaged scene and mesh files end in a refusal, a status or a result: never in a traceback, a
hang, or a file elsewhere. A failing case is named by its seed and number."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

import pytest

from hostile import mesh_mutants, scene_mutants
from sparsemor.bodies.mesh.mesh_file import MeshFile
from sparsemor.core.errors import InputError
from sparsemor.core.registry.registry import Registry
from sparsemor.core.scene.scene import build
from sparsemor.core.scene.source import Source
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.simulate import simulate
from sparsemor.core.simulation.validation import checked_model
from sparsemor.core.status import SolveFailed

LONGEST = 10.0
"""CPU time after which a case counts as a hang, s: not wall time, which other processes stretch."""
STEPS = 3


@contextmanager
def alarm(what: str) -> Iterator[None]:
    """A failure with the name of the case where it raises what it should not, or does not end."""
    def ring(number: int, frame: FrameType | None) -> None:
        raise TimeoutError(f"no end after {LONGEST:g} s")

    before = signal.signal(signal.SIGPROF, ring)
    signal.setitimer(signal.ITIMER_PROF, LONGEST)
    try:
        yield
    except (InputError, SolveFailed):
        pass
    except Exception as error:
        raise AssertionError(f"{what}: {type(error).__name__}: {error}") from error
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def attempt(what: str, text: str, run: bool, place: Path) -> None:
    """Read, check and, where it is valid, run a few steps of one scene."""
    with alarm(what):
        scene = build(Source.of_text(text, "scene.yaml", Registry()))
        checked_model(scene)
        if run:
            short = scene.using({"time.end": STEPS * scene.time.step, "training": {}})
            simulate(short, out=place / "out", cache=Cache(place / "cache"))


@pytest.mark.full
@pytest.mark.parametrize("count, runs", [
    (100, 6), pytest.param(2000, 4, marks=pytest.mark.slow)])
def test_damaged_scenes(
    count: int, runs: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One in `runs` of the valid ones is run."""
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    monkeypatch.setenv("SPARSEMOR_MEMORY", "1")  # so that a mesh refined at random is refused
    for number, (what, text) in enumerate(scene_mutants.mutants(7, count)):
        attempt(what, text, number % runs == 0, tmp_path / f"case {number}")
        assert not list(here.iterdir()), what


@pytest.mark.parametrize("count", [200, pytest.param(1000, marks=pytest.mark.slow)])
def test_damaged_meshes(
    count: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh_mutants.originals()
    capsys.readouterr()  # meshio's writers advise against text
    accepted = 0
    for what, ending, data in mesh_mutants.mutants(3, count):
        file = tmp_path / f"mesh.{ending}"
        file.write_bytes(data)
        with alarm(what):
            try:
                MeshFile(path=file.name).build(tmp_path)
                accepted += 1
            except InputError as error:
                assert str(tmp_path) not in str(error) and len(str(error)) < 2000
    assert 0.02 * count < accepted < 0.9 * count
    assert capsys.readouterr() == ("", "")
    assert {p.suffix for p in tmp_path.iterdir()} <= set(mesh_mutants.ENDINGS)
