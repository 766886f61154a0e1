"""Two distributions that offer one name: which one a scene means, and how it says so."""

import json
from importlib.metadata import version
from pathlib import Path

import pytest
from typer.testing import CliRunner

from sparsemor.core.cli import app
from sparsemor.core.errors import InputError
from sparsemor.core.registry.registry import Registry
from sparsemor.core.scene.scene import load
from sparsemor.core.simulation.simulate import simulate
from sparsemor.core.simulation.validation import checked_model
from sparsemor.plugins.commands.json_schema import scene_schema

TINY = Path(__file__).parents[1] / "scenes" / "tiny.yaml"
OTHER = """
from sparsemor.core import Sampler


class Other(Sampler):
    'Rows of another package.'

    def sample(self, block, m, dictionary, rng, required):
        return required
"""
SPARSE = {"reducer": "sparse", "reducer.budgets": {"*": {"rows": 12, "atoms": 2}}}


@pytest.fixture
def clash(distribute):
    distribute("sparsemor-bad", {"sampler": {"lhs": "clash_a:Other", "own": "clash_a:Other"}},
               version="0.2.0", clash_a=OTHER)


def test_a_plain_name_stays_ours_and_the_qualified_one_selects_the_other(clash):
    registry = Registry()
    assert registry.get("sampler", "lhs").__module__.startswith("sparsemor.plugins")
    other = registry.get("sampler", "sparsemor-bad:lhs")
    assert other is registry.get("sampler", "Sparsemor_Bad:lhs") and other.__name__ == "Other"
    assert registry.get("sampler", "sparsemor:lhs") is registry.get("sampler", "lhs")
    assert registry.name_of("sampler", registry.get("sampler", "lhs")) == "lhs"
    with pytest.raises(InputError, match="no sampler plugin is called 'nobody:lhs'"):
        registry.get("sampler", "nobody:lhs")


@pytest.mark.full
def test_a_scene_that_uses_the_name_runs_and_is_warned(clash, here):
    scene = load(TINY, {"time.end": 0.002, "training.end": 0.002, **SPARSE})
    (note,) = scene.notes
    assert note.kind == "same_name"
    for part in (f"'lhs' is that of sparsemor {version('sparsemor')}", "sparsemor-bad 0.2.0 offers",
                 "write sparsemor-bad:lhs"):
        assert part in note.text
    assert note.text in simulate(scene).summary["notes"]


def test_a_scene_that_does_not_use_the_name_hears_nothing(clash):
    assert load(TINY).notes == ()


def test_a_qualified_name_is_written_down_and_read_again(clash):
    scene = load(TINY, {**SPARSE, "reducer.sampler": "sparsemor-bad:lhs"})
    assert scene.notes == ()
    assert scene.dump()["reducer"]["sampler"] == {"use": "sparsemor-bad:lhs"}
    assert scene.using({"reducer.solver": "omp"}).dump()["reducer"]["sampler"] == {
        "use": "sparsemor-bad:lhs"}


@pytest.mark.full
def test_the_schema_knows_both(clash):
    choices = scene_schema()["$defs"]["slot.sampler"]["anyOf"]
    names = [c["const"] for c in choices if "const" in c]
    assert {"lhs", "own", "sparsemor-bad:lhs"} <= set(names) and len(set(names)) == len(names)


def test_the_listing_names_both_and_neither_is_broken(clash):
    done = CliRunner().invoke(app, ["plugins", "lhs", "--json"])
    found = {p["use"]: p for p in json.loads(done.stdout)["plugins"]}
    assert set(found) == {"lhs", "sparsemor-bad:lhs"}
    assert found["sparsemor-bad:lhs"]["doc"] == "Rows of another package."
    assert not any(p["broken"] for p in found.values())


def test_two_others_of_one_name_are_refused_where_the_name_is_used(distribute):
    distribute("pkg-a", {"sampler": {"own": "clash_b:Other"}}, clash_b=OTHER)
    distribute("pkg-b", {"sampler": {"own": "clash_c:Other"}}, clash_c=OTHER)
    assert load(TINY).notes == ()
    with pytest.raises(InputError, match="reducer.sampler: .*write pkg-.:own or pkg-.:own"):
        load(TINY, {**SPARSE, "reducer.sampler": "own"})
    assert load(TINY, {**SPARSE, "reducer.sampler": "pkg-b:own"}).notes == ()


def test_a_new_package_does_not_take_a_name_that_exists(here):
    done = CliRunner().invoke(app, ["new-plugin", "lhs", "--kind", "sampler"])
    assert done.exit_code == 2 and "offers a sampler called 'lhs' already" in done.output
    assert not Path("sparsemor-lhs").exists()


PARTS = """
from pathlib import Path
from sparsemor.core import JointPlugin, LoadPlugin

double_pendulum = Path(__file__).with_name("theirs.yaml")

class Own(JointPlugin):
    'A joint of another package.'

    def build(self, name, parts):
        raise RuntimeError("it was not meant")

class Other(LoadPlugin):
    'A load of another package.'

    def build(self, name, parts):
        raise RuntimeError("it was not meant")
"""


@pytest.mark.full
def test_parts_and_scenes_of_ours_stay_ours(distribute, here):
    distribute("sparsemor-bad", {"joint": {"revolute": "clash_p:Own"}, "load": {
        "gravity": "clash_p:Other"}, "scene": {"double_pendulum": "clash_p:double_pendulum"}},
        clash_p=PARTS)
    registry = Registry()
    ours = registry.load("scene", "double_pendulum")
    assert ours == registry.load("scene", "sparsemor:double_pendulum")
    theirs = registry.load("scene", "sparsemor-bad:double_pendulum")
    assert theirs.name == "theirs.yaml"
    theirs.write_text(TINY.read_text())
    scene = load("sparsemor-bad:double_pendulum", {"time.end": 0.002, "training.end": 0.002})
    assert sorted(note.kind for note in scene.notes) == ["same_name", "same_name"]
    assert simulate(scene).status.ok
    pendulum = load("double_pendulum")
    assert pendulum.title and pendulum.name == "double_pendulum"
    with pytest.raises(InputError, match="it was not meant"):
        checked_model(load(TINY, {"joints.pin": {"use": "sparsemor-bad:revolute"}}))


@pytest.mark.full
def test_packages_that_share_scenes_and_samplers_are_told_apart_by_every_command(
    distribute, here
):
    for name in ("pkg-a", "pkg-b"):
        module = f"same_{name[-1]}"
        distribute(name, {"scene": {"small": f"{module}:scene"}, "study": {"few": f"{module}:few"},
                          "sampler": {"own": f"{module}:Other"}},
                   **{module: OTHER + f"""
from pathlib import Path
scene, few = (Path(__file__).with_name(f"{module}_{{n}}.yaml") for n in ("scene", "few"))
"""})
        registry = Registry()
        registry.load("scene", f"{name}:small").write_text(TINY.read_text())
        registry.load("study", f"{name}:few").write_text(
            f"scene: {name}:small\nset: {{time.end: 0.002}}\ngrid: {{reducer: [full]}}\n")

    def lines(*command: str) -> tuple[int, str]:
        done = CliRunner().invoke(app, list(command))
        return done.exit_code, done.output

    for command, kind, plain in (("validate", "scene", "small"), ("run", "scene", "small"),
                                 ("compare", "scene", "small"), ("study", "study", "few")):
        code, text = lines(command, plain)
        assert code == 2 and text.startswith(f"{kind} plugin {plain!r} is offered by pkg-a")
        assert f"write pkg-a:{plain} or pkg-b:{plain}" in text and text.count("\n") == 1
    assert lines("validate", "pkg-a:small")[0] == 0
    code, text = lines("study", "pkg-b:few", "--out", "few")
    assert code == 0 and "1 done" in text
    sampled = ["pkg-a:small", "--set", 'reducer={use: sparse, budgets: {"*": {rows: 9, atoms: 2}}}']
    code, text = lines("stability", *sampled, "--samplers", "own")
    assert code == 2 and text.startswith("--samplers: sampler plugin 'own' is offered by pkg-a")
    code, text = lines("compare", "pkg-a:small", "--reducers", "full,nope")
    assert code == 2 and text.startswith("--reducers: no reducer plugin is called 'nope'")
