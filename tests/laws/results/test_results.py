"""The store: what goes in comes out, also after a kill; nothing that is not finite goes in."""

import dataclasses
import pickle
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from sparsemor.bodies.terms.field_kinds import ELASTIC, MULTIPLIER, RIGID, THERMAL
from sparsemor.core import BodyShape, Dictionary
from sparsemor.core.errors import Damaged, InputError
from sparsemor.core.protocols.layout import Block, Layout
from sparsemor.core.results.checkpoint import checkpoint_file
from sparsemor.core.results.metadata import ProbeHeader, RunHeader
from sparsemor.core.results.result_writer import ChunkOfSteps, ResultWriter
from sparsemor.core.results.run_result import open_result
from sparsemor.core.status import Status

FULL = Layout([Block("arm", RIGID, 3), Block("arm", ELASTIC, 6), Block("arm", THERMAL, 3),
               Block("pin", MULTIPLIER, 2)])
POINTS = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
SHAPE = BodyShape(
    points=POINTS, cells=np.array([[0, 1, 2], [0, 2, 3]]), elastic_dofs=np.arange(2, 8),
    thermal_nodes=np.array([0, 1, 3]), eliminated_temperature=np.full(4, 300.0))
DICTIONARY = Dictionary(np.linalg.qr(np.vander(np.arange(6.0), 4))[0], np.full(6, 0.25),
                        ("a", "b", "c", "d"))


def header(reduced: bool) -> RunHeader:
    return RunHeader(
        scene={"format": 1, "time": {"end": 1.0}}, scene_digest="d1", seed=7,
        versions={"sparsemor": "0.1.0"}, reducer="sparse" if reduced else "full",
        layout=FULL.resized({"arm.elastic": 4}) if reduced else FULL, full_layout=FULL,
        step=0.01, steps_planned=100,
        dictionaries={"arm.elastic": DICTIONARY} if reduced else {},
        rows={"arm.elastic": np.array([0, 2, 5])} if reduced else {}, bodies={"arm": SHAPE},
        probes=(ProbeHeader("tip", "arm", (1.0, 0.0)),))


def steps(layout: Layout, first: int, count: int) -> ChunkOfSteps:
    numbers = np.arange(first, first + count)
    times = np.asarray(0.01 * numbers, dtype=np.float64)
    x = np.sin(numbers[:, None] * 0.1 + np.arange(layout.size)) + 1.5
    active = (numbers[:, None] + np.arange(4)) % 3 == 0
    return ChunkOfSteps(
        times=times, x=x, iterations=numbers % 4, remaining=1e-14 * numbers,
        step_seconds=np.full(count, 2e-3),
        supports={"arm.elastic": active} if layout["arm.elastic"].stop == 7 else {},
        probes={"tip": x[:, :2] * 2.0})


@pytest.mark.parametrize("reduced", [False, True])
def test_round_trip(tmp_path: Path, reduced: bool) -> None:
    head = header(reduced)
    writer = ResultWriter.create(tmp_path / "result", head)
    for first in range(0, 700, 70):
        writer.append(steps(head.layout, first, 70))
    writer.finish(Status.DONE, {"steps": np.int64(699), "online_seconds": 1.5})
    run, given = open_result(tmp_path), steps(head.layout, 0, 700)
    assert (run.status, run.summary) == (Status.DONE, {"steps": 699, "online_seconds": 1.5})
    assert run.scene == head.scene and run.path == (tmp_path / "result").absolute()
    assert np.array_equal(run.times, given.times)
    assert np.array_equal(run.iterations, given.iterations)
    assert np.array_equal(run.probe("tip"), given.probes["tip"])
    assert np.array_equal(run.block("pin.multiplier"), given.x[:, head.layout["pin.multiplier"]])
    stored = given.x[:, head.layout["arm.elastic"]]
    if reduced:
        assert np.array_equal(run.coefficients("arm.elastic"), stored)
        assert np.array_equal(run.support("arm.elastic"), given.supports["arm.elastic"])
        assert np.array_equal(run.rows("arm.elastic"), [0, 2, 5])
        full = DICTIONARY.offset + stored @ DICTIONARY.atoms.T
    else:
        full = stored
    assert np.allclose(run.block("arm.elastic"), full, rtol=1e-14)
    part = np.array([3, 255, 256, 600])
    assert np.allclose(run.block("arm.elastic", part), full[part], rtol=1e-14)
    assert np.allclose(run.block("arm.elastic", slice(250, 300, 7)), full[250:300:7], rtol=1e-14)
    assert np.array_equal(pickle.loads(pickle.dumps(run)).times, run.times)


def test_nodes_and_positions(tmp_path: Path) -> None:
    writer = ResultWriter.create(tmp_path / "result", header(False))
    x = np.zeros((1, FULL.size))
    x[0, FULL["arm.rigid"]] = [2.0, 3.0, np.pi / 2]
    x[0, FULL["arm.elastic"]] = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
    x[0, FULL["arm.thermal"]] = [310.0, 320.0, 340.0]
    given = steps(FULL, 0, 1)
    writer.append(dataclasses.replace(given, x=x))
    run = open_result(tmp_path)
    u = np.array([[0.0, 0.0], [0.1, 0.2], [0.3, 0.4], [0.5, 0.6]])
    assert np.array_equal(run.nodal_displacement("arm", -1), u)
    assert np.array_equal(run.nodal_temperature("arm", 0), [310.0, 320.0, 300.0, 340.0])
    z = POINTS + 2.0 * u
    turned = np.column_stack([2.0 - z[:, 1], 3.0 + z[:, 0]])
    assert np.allclose(run.positions("arm", 0, magnify=2.0), turned, atol=1e-15)
    with pytest.raises(IndexError, match="1 stored"):
        run.nodal_displacement("arm", 1)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("where", ["x", "times", "step_seconds"])
def test_what_is_not_finite_is_refused_whole(tmp_path: Path, bad: float, where: str) -> None:
    writer = ResultWriter.create(tmp_path / "result", header(False))
    writer.append(steps(FULL, 0, 5))
    chunk = steps(FULL, 5, 5)
    values = getattr(chunk, where).copy()
    values[3] = bad
    name = {"x": "arm.rigid", "times": "time", "step_seconds": "step_seconds"}[where]
    with pytest.raises(ValueError, match=f"{name}: not finite in row 3"):
        writer.append(dataclasses.replace(chunk, **{where: values}))
    with pytest.raises(ValueError):
        writer.finish(Status.DONE, {"error": bad})
    assert len(open_result(tmp_path).times) == 5
    assert np.isfinite(open_result(tmp_path).block("arm.elastic")).all()


def test_times_must_grow_and_names_must_fit(tmp_path: Path) -> None:
    writer = ResultWriter.create(tmp_path / "result", header(False))
    writer.append(steps(FULL, 0, 5))
    with pytest.raises(ValueError, match="time: must grow"):
        writer.append(steps(FULL, 4, 5))
    with pytest.raises(ValueError, match="probe.tip"):
        writer.append(dataclasses.replace(steps(FULL, 5, 5), probes={}))
    with pytest.raises(ValueError, match="expected"):
        writer.append(dataclasses.replace(steps(FULL, 5, 5), x=np.zeros((5, 3))))


def test_an_existing_result_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "result"
    ResultWriter.create(path, header(False)).append(steps(FULL, 0, 5))
    with pytest.raises(InputError, match="already contains a result"):
        ResultWriter.create(path, header(False))
    assert len(open_result(path).times) == 5
    assert [p.name for p in tmp_path.iterdir()] == ["result"]


def test_resume_continues_where_the_checkpoint_stands(tmp_path: Path) -> None:
    head = header(True)
    whole = ResultWriter.create(tmp_path / "a" / "result", head)
    whole.append(steps(head.layout, 0, 900))
    broken = ResultWriter.create(tmp_path / "b" / "result", head)
    broken.append(steps(head.layout, 0, 300))
    broken.checkpoint({"x": np.arange(3.0)}, memory={"active": [1, 2]})
    lost = steps(head.layout, 300, 350)
    broken.append(dataclasses.replace(lost, x=lost.x + 99.0))
    broken.finish(Status.INTERRUPTED, {"steps": 650})

    again, checkpoint = ResultWriter.resume(tmp_path / "b" / "result")
    memory = checkpoint.memory.into({"active": []})
    assert (again.stored, checkpoint.stored, memory) == (300, 300, {"active": [1, 2]})
    assert np.array_equal(checkpoint.arrays["x"], np.arange(3.0))
    assert len(open_result(tmp_path / "b").times) == 300
    again.append(steps(head.layout, 300, 1))
    again.append(steps(head.layout, 301, 599))
    again.finish(Status.DONE, {})
    one, two = open_result(tmp_path / "a"), open_result(tmp_path / "b")
    for block in ("arm.rigid", "arm.elastic", "arm.thermal"):
        assert np.array_equal(one.block(block), two.block(block))
    assert np.array_equal(one.support("arm.elastic"), two.support("arm.elastic"))
    assert checkpoint_file(two.path).exists()  # for a later end


def test_resume_refuses_in_words(tmp_path: Path) -> None:
    path = tmp_path / "result"
    with pytest.raises(InputError, match="there is no result"):
        ResultWriter.resume(path)
    ResultWriter.create(path, header(False))
    with pytest.raises(InputError, match="before its first checkpoint"):
        ResultWriter.resume(path)
    with pytest.raises(InputError, match="no block 'arm.heat'.*arm.thermal"):
        open_result(path).block("arm.heat")


def test_a_reader_keeps_the_steps_that_it_opened(tmp_path: Path) -> None:
    writer = ResultWriter.create(tmp_path / "result", header(False))
    writer.append(steps(FULL, 0, 1000))
    before = open_result(tmp_path)
    assert len(before.times) == 1000
    writer.append(steps(FULL, 1000, 1200))  # the file that it reads is replaced, others are added
    assert np.array_equal(before.block("arm.elastic"), steps(FULL, 0, 1000).x[:, 3:9])
    assert {len(v) for v in before.to_xarray().values() if v.dims[0] == "time"} == {1000}
    after = open_result(tmp_path)
    assert np.array_equal(after.block("arm.elastic"), steps(FULL, 0, 2200).x[:, 3:9])
    writer.finish(Status.DONE, {})
    assert sorted(p.name for p in after.path.iterdir()) == [
        "fixed.npz", "header.json", *(f"steps-00000{n}.npz" for n in range(3))]


@pytest.mark.parametrize(("number", "lost"), [(0, "0 to 1023"), (1, "1024 to 2047"),
                                              (2, "2048 to 2199")])
def test_a_file_of_steps_that_is_lost_is_named(tmp_path: Path, number: int, lost: str) -> None:
    writer = ResultWriter.create(tmp_path / "result", header(False))
    writer.append(steps(FULL, 0, 2200))
    writer.checkpoint({})
    file = tmp_path / "result" / f"steps-00000{number}.npz"
    kept = file.read_bytes()
    file.unlink()
    if number < 2:  # while the run goes on the number of its steps is that of its files
        with pytest.raises(Damaged, match=f"{file} is missing; steps {lost}"):
            _ = open_result(tmp_path).times
    else:
        assert len(open_result(tmp_path).times) == 2048
    with pytest.raises(Damaged, match=f"{file} is missing; steps {lost}"):
        ResultWriter.resume(tmp_path / "result")
    with pytest.raises(OSError, match=f"{file} is missing; steps {lost}"):
        writer.finish(Status.DONE, {})
    file.write_bytes(kept)
    writer.finish(Status.DONE, {})
    file.unlink()
    with pytest.raises(Damaged, match=f"{file} is missing; steps {lost}"):
        _ = open_result(tmp_path).times


ENDLESS = """
import sys
from pathlib import Path
import numpy as np
from sparsemor.bodies.terms.field_kinds import RIGID, THERMAL
from sparsemor.core.protocols.layout import Block, Layout
from sparsemor.core import Dictionary
from sparsemor.core.results.metadata import RunHeader
from sparsemor.core.results.result_writer import ChunkOfSteps, ResultWriter

path = Path(sys.argv[1])
full = Layout([Block("b", RIGID, 3), Block("b", THERMAL, 5)])
layout = full.resized({"b.thermal": 2})
head = RunHeader({}, "d", 1, {}, "sparse", layout, full, 1.0, 10,
                 {"b.thermal": Dictionary(np.eye(5, 2), np.ones(5), ("a", "b"))})
if path.exists():
    writer, checkpoint = ResultWriter.resume(path)
    n = int(checkpoint.arrays["n"])
    assert n == writer.stored
else:
    writer, n = ResultWriter.create(path, head), 0
    writer.checkpoint({"n": np.array(0)})
print("ready", flush=True)
while True:
    count = 1 + n % 23
    t = np.arange(n, n + count)
    x = t[:, None] + np.arange(1.0, 6.0)
    active = {"b.thermal": np.ones((count, 2), bool)}
    writer.append(ChunkOfSteps(t * 1.0, x, t + 1, 0.0 * t, t + 1.0, active))
    n += count
    if n % 3 == 0:
        writer.checkpoint({"n": np.array(n)})
"""


@pytest.mark.full
def test_a_killed_run_is_whole_up_to_its_last_commit(tmp_path: Path) -> None:
    reached: list[int] = []
    for turn in range(20):  # each store is killed and resumed four times, more on a busy machine
        if turn >= 4 and max(reached) > 1024:
            break
        stores = [tmp_path / str(i) / "result" for i in range(4)]
        writers = [subprocess.Popen([sys.executable, "-c", ENDLESS, str(s)],
                                    stdout=subprocess.PIPE) for s in stores]
        for number, writer in enumerate(writers):
            assert writer.stdout is not None and writer.stdout.readline().strip() == b"ready"
            time.sleep(0.0137 * (1 + (number + turn) % 4) + 0.0011 * turn)
            writer.kill()
            writer.wait()
            writer.stdout.close()
        for store in stores:
            run = open_result(store)
            data = run.to_xarray()
            count = data.sizes["time"]
            t = np.arange(count)
            assert np.array_equal(data["time"], t)
            assert np.array_equal(data["iterations"], t + 1)
            assert np.array_equal(data["step_seconds"], t + 1.0)
            assert np.array_equal(data["b.rigid"], t[:, None] + np.arange(1.0, 4.0))
            assert np.array_equal(data["b.thermal.coefficients"], t[:, None] + np.arange(4.0, 6.0))
            assert bool(data["b.thermal.active"].all())
            reached.append(count)
            assert run.status is Status.INTERRUPTED and run.summary == {}
            assert np.array_equal(run.block("b.thermal")[:, 2], np.ones(count))
    assert max(reached) > 1024  # more than one file was written
