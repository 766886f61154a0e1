"""Scene files: every fault, at its place."""

from pathlib import Path

import pytest

from sparsemor.core.errors import Fault, InputError
from sparsemor.core.scene.scene import Scene, load

GOOD = """\
format: 1
seed: 3
bodies:
  a: {use: ball, mass: 1e0}
loads:
  wind: push
time: {end: 1.0, step: 1e-3}
integrator: still
reducer:
  use: tuned
  sampler: {use: grid, mix: 0.25}
  budgets: {"*.elastic": 5}
probes:
  tip: {body: a, at: [0.5, 1]}
"""

pytestmark = pytest.mark.usefixtures("toys")


@pytest.fixture
def written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def write(text: str) -> str:
        Path("scene.yaml").write_text(text, encoding="utf-8")
        return "scene.yaml"

    return write


def lines(path: str) -> list[str]:
    with pytest.raises(InputError) as caught:
        load(path)
    return str(caught.value).splitlines()


def test_a_good_file(written, tmp_path):
    scene = load(written(GOOD))
    assert scene.bodies["a"].mass == 1.0
    assert scene.reducer.sampler.mix == 0.25
    assert scene.probes["tip"].at == [0.5, 1.0]
    assert (scene.name, scene.folder) == ("scene", tmp_path)
    assert Scene.model_validate(scene.dump()).dump() == scene.dump()


def test_all_faults_at_once_sorted_by_place(written):
    found = lines(written("""\
format: 2
bodies:
  a: {use: bal, mass: 1}
  b-c: {use: ball, mass: 1}
  d: {use: ball, mss: 3}
loads: {a: push, ground: push}
time:
  end: 1
  step: 2
reducer:
  use: tuned
  sampler:
    use: grid
    mix: 1.5
seeds: 3
probes:
  p: {body: q, at: [1, x]}
"""))
    assert [line.split(": ")[0] + ": " + line.split(": ")[1] for line in found] == [
        "scene.yaml:1:1: format",
        "scene.yaml:3:3: bodies.a",
        "scene.yaml:4:3: bodies.b-c",
        "scene.yaml:5:3: bodies.d.mass",
        "scene.yaml:5:18: bodies.d.mss",
        "scene.yaml:6:9: loads.a",
        "scene.yaml:6:18: loads.ground",
        "scene.yaml:9:3: time.step",
        "scene.yaml:14:5: reducer.sampler.mix",
        "scene.yaml:15:1: seeds",
        "scene.yaml:17:7: probes.p.body",
        "scene.yaml:17:24: probes.p.at.1",
    ]
    text = "\n".join(found)
    for part in ("did you mean ball?", "did you mean mass?", "did you mean seed?",
                 "this name is taken in bodies", "ground means the fixed world",
                 "is missing", "must not exceed time.end = 1 s (got 2)",
                 "less than or equal to 1 (got 1.5)", "no body is called 'q'"):
        assert part in text


@pytest.mark.parametrize("text, expected", [
    ("", "scene.yaml:1:1: the file is empty"),
    ("- 1\n- 2", "scene.yaml:1:1: a scene is a mapping"),
    ("just text", "scene.yaml:1:1: a scene is a mapping"),
    ("a: [1, 2\nb: 3", "scene.yaml:2:2: this is not YAML"),
    ("seed: 1\nbodies: {}\nseed: 2", "scene.yaml:3:1: seed: written twice, first at 1:1"),
    ("loads:\n  w: push\n  w: push", "scene.yaml:3:3: loads.w: written twice, first at 2:3"),
    ("time: {end: .inf}", "scene.yaml:1:13: time.end: must be a finite number (got .inf)"),
    ("a: .nan", "scene.yaml:1:4: a: must be a finite number (got .nan)"),
    ("a: !!python/tuple [1]", "scene.yaml:1:4: a: the tag tag:yaml.org,2002:python/tuple"),
    ("a: !mine 3", "scene.yaml:1:4: a: the tag !mine is not supported"),
    ("? [1, 2]\n: 3", "scene.yaml:1:3: a key must be plain text"),
    ("a: &x {b: *x}", "nested too deep or too large"),
])
def test_faults_of_form(written, text, expected):
    (line,) = lines(written(text))
    assert expected in line


def test_yaml_1_2_numbers(written):
    scene = load(written(GOOD.replace("mass: 1e0", "mass: 1e-3")))
    assert scene.bodies["a"].mass == 1e-3


def test_files_that_cannot_be_read(written, tmp_path):
    assert lines("nowhere/scene.yaml") == ["nowhere/scene.yaml: there is no such file"]
    assert lines(str(tmp_path)) == [f"{tmp_path}: is a directory, not a scene file"]
    Path("latin.yaml").write_bytes(b"title: \xff")
    assert lines("latin.yaml") == ["latin.yaml: is not UTF-8 text"]
    (line,) = lines("double_pendulm")
    assert "did you mean double_pendulum" in line


def test_no_bodies(written):
    (line,) = lines(written(GOOD.replace("  a: {use: ball, mass: 1e0}", "  {}").replace(
        "probes:\n  tip: {body: a, at: [0.5, 1]}\n", "")))
    assert line.startswith("scene.yaml:3:1: bodies: ")


def test_later_faults_are_placed_too(written):
    scene = load(written(GOOD))
    error = InputError([Fault("reducer.budgets.*.elastic", "too many"), Fault("joints.A", "gone"),
                        Fault("bodies.a.mass", "too light"), Fault("", "something else")])
    assert scene.locate(error) == [
        "scene.yaml:1:1: something else",
        "scene.yaml:1:1: joints.A: gone",
        "scene.yaml:4:18: bodies.a.mass: too light",
        "scene.yaml:12:13: reducer.budgets.*.elastic: too many",
    ]


def test_digest_tells_scenes_apart_by_what_is_asked(written):
    scene = load(written(GOOD))
    other = scene.using({"reducer": "direct"})
    assert scene.digest() != other.digest()
    assert scene.digest("bodies", "time") == other.digest("bodies", "time")
    assert scene.digest("bodies.a.mass") != scene.using({"bodies.a.mass": 2}).digest(
        "bodies.a.mass")
    assert len(scene.digest()) == 64
    with pytest.raises(InputError, match="nothing: there is no such key"):
        scene.digest("nothing")
