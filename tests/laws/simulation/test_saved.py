"""State of a run in a file: the same values come back, and no file decides what is executed."""

import os
import pickle
import signal
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor import InputError, SolveFailed, open_result, simulate
from sparsemor.core import StepOutcome
from sparsemor.core.registry.hooks import hookimpl
from sparsemor.core.results.checkpoint import MAGIC, Saved, SavedError, checkpoint_file
from sparsemor.core.scene.scene import Scene
from sparsemor.core.scene.scene import load as load_scene
from sparsemor.core.simulation.recorder import StepStatistics
from sparsemor.core.status import Status

TINY = Path(__file__).parents[2] / "scenes" / "tiny.yaml"


@dataclass(frozen=True, slots=True)
class Corner:
    """Frozen, with slots: its state is set by a method of its own."""

    x: float
    y: np.ndarray


class Slotted:
    __slots__ = ("count", "name")

    def __init__(self) -> None:
        self.count, self.name = 0, ""


@dataclass
class Everything:
    nothing: Any = None
    flag: bool = False
    whole: int = 0
    real: float = 0.0
    scalar: Any = np.float32(0)
    raw: bytes = b""
    pair: tuple[Any, ...] = ()
    ages: list[float] = field(default_factory=list)
    live: frozenset[int] = frozenset()
    by_number: dict[Any, Any] = field(default_factory=dict)
    bent: Any = field(default_factory=lambda: np.zeros((2, 3), order="F"))
    corner: Corner = field(default_factory=lambda: Corner(0.0, np.zeros(2)))
    inner: Slotted = field(default_factory=Slotted)
    levels: dict[int, Slotted] = field(default_factory=lambda: {0: Slotted()})
    draws: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))


def filled() -> Everything:
    rng = np.random.default_rng(5)
    one, two = Slotted(), Slotted()
    one.count, two.count, two.name = 2**70, 3, "two"
    made = Everything(
        np.arange(3), True, -(2**70), -0.1, np.float32(0.3), b"\x00\xff", ("a", (1, None)),
        [float("inf"), -0.0, 5e-324], frozenset({4, 1}), {3: [1], "x": {"y": 2}, (1, b"k"): 0},
        np.asfortranarray(rng.random((2, 3))), Corner(2.5, rng.random(2)), one, {0: one, 7: two},
        rng)
    rng.random(3)
    return made


def test_values_come_back_to_the_last_bit() -> None:
    kept = filled()
    found = Saved.load(Saved.from_value(kept).dump()).into(Everything())
    assert isinstance(found, Everything)
    for name in ("flag", "whole", "real", "raw", "pair", "ages", "live", "by_number"):
        assert getattr(found, name) == getattr(kept, name)
        assert type(getattr(found, name)) is type(getattr(kept, name))
    assert np.signbit(found.ages[1]) and found.scalar.dtype == np.float32
    assert found.scalar == kept.scalar and np.array_equal(found.nothing, kept.nothing)
    assert np.array_equal(found.bent, kept.bent) and found.bent.flags.f_contiguous
    assert found.corner.x == 2.5 and np.array_equal(found.corner.y, kept.corner.y)
    assert (found.inner.count, found.levels[7].count, found.levels[7].name) == (2**70, 3, "two")
    assert found.levels[0] is not found.levels[7]
    assert np.array_equal(found.draws.random(9), kept.draws.random(9))


class Nasty:
    """Unpickling one would make a folder."""

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, ("was_here",)


def forged_array() -> bytes:
    """A file of the right format whose array holds pickled objects."""
    import io
    import zlib

    body = io.BytesIO()
    np.lib.format.write_array(body, np.array([Nasty()], dtype=object), allow_pickle=True)
    return MAGIC + b"%08x\n" % zlib.crc32(body.getvalue()) + body.getvalue()


@pytest.mark.parametrize("forged", ["pickle", "array"])
def test_a_forged_checkpoint_executes_nothing(
    forged: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    scene = stopped(tmp_path / "out")
    data = pickle.dumps(("run", 0, {}, Nasty())) if forged == "pickle" else forged_array()
    checkpoint_file(tmp_path / "out" / "result").write_bytes(data)
    with pytest.raises(InputError, match="cannot be resumed: result.checkpoint: it "):
        simulate(scene, out=tmp_path / "out", resume=True)
    assert not (tmp_path / "was_here").exists()


def test_a_damaged_checkpoint_is_named(tmp_path: Path) -> None:
    scene = stopped(tmp_path / "out")
    file = checkpoint_file(tmp_path / "out" / "result")
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(data)
    with pytest.raises(InputError, match="checksum does not match: the file is damaged"):
        simulate(scene, out=tmp_path / "out", resume=True)


class Stops:
    @hookimpl
    def on_step(self, step: int) -> None:
        if step == 3:
            raise RuntimeError("stopped")


def stopped(out: Path, **changes: Any) -> Scene:
    """A scene whose run in `out` broke off."""
    scene = load_scene(TINY, {"reducer": "full", "time.end": 0.005, **changes})
    with pytest.raises(RuntimeError, match="stopped"):
        simulate(scene, out=out, observers=[Stops()])
    assert open_result(out).status.value == "interrupted"
    return scene


@pytest.mark.parametrize(("change", "words"), [
    ({"whole": "text"}, r"memory.whole is a str, and a number"),
    ({"bent": np.zeros(2)}, r"memory.bent is an array of float64 with 1 axes, and an array"),
    ({"bent": np.zeros((2, 3), np.float32)}, r"memory.bent is an array of float32"),
    ({"ages": {}}, r"memory.ages is a mapping"),
    ({"nothing": Slotted()}, r"memory.nothing is an object with fields, and nothing"),
    ({"inner": 3}, r"memory.inner is a number"),
    ({"draws": None, "extra": 1}, r"memory has other fields than in this program: extra"),
])
def test_another_structure_is_refused_with_its_place(change: dict[str, Any], words: str) -> None:
    kept = filled()
    kept.__dict__.update(change)
    with pytest.raises(SavedError, match=words):
        Saved.from_value(kept).into(Everything())


@pytest.mark.parametrize("value", [
    print, Slotted, os, np.array([Nasty()], dtype=object), {"a": [lambda: 0]}])
def test_code_is_no_state(value: Any) -> None:
    with pytest.raises(TypeError, match="memory"):
        Saved.from_value(value)


def test_what_refers_to_itself_is_no_state() -> None:
    ring: list[Any] = []
    ring.append(ring)
    with pytest.raises(TypeError, match=r"memory\[0\]: refers to an object that it is part of"):
        Saved.from_value(ring)


def test_sums_of_a_run_do_not_grow_with_it() -> None:
    stats, rng = StepStatistics(), np.random.default_rng(0)
    times = 1e-4 * (1.0 + rng.random(20_000))
    for seconds in times:
        stats.add(float(seconds), StepOutcome(np.zeros(1), Status.DONE, 2))
    assert len(Saved.from_value(stats).dump()) < 20_000
    assert (stats.done, stats.iterations) == (20_000, 40_000)
    assert stats.ms_per_step_solver == pytest.approx(1e3 * np.median(times), rel=0.01)


@pytest.mark.full
def test_ms_per_step_counts_all_that_a_step_takes(tmp_path: Path) -> None:
    scene = load_scene(TINY, {"reducer": "full", "time.end": 0.02})
    run = simulate(scene, out=tmp_path / "out")
    summary = run.summary
    assert summary["ms_per_step"] == pytest.approx(1e3 * summary["wall_s"]["online"] / 20)
    # a median, which under load may exceed the mean
    assert summary["ms_per_step_solver"] > 0.0
    assert run.step_seconds.sum() <= summary["wall_s"]["online"]


class Strikes:
    @hookimpl
    def on_start(self) -> None:
        signal.raise_signal(signal.SIGINT)


@pytest.mark.full
def test_ctrl_c_before_the_first_step_leaves_a_run_that_can_be_continued(tmp_path: Path) -> None:
    scene = load_scene(TINY, {"reducer": "full", "time.end": 0.005})
    with pytest.raises(SolveFailed, match="interrupted at t = 0 s: continue it with --resume"):
        simulate(scene, out=tmp_path, observers=[Strikes()])
    assert open_result(tmp_path).times.tolist() == [0.0]
    again, whole = simulate(scene, out=tmp_path, resume=True), simulate(scene)
    np.testing.assert_array_equal(again.block("bar.elastic"), whole.block("bar.elastic"))
