"""Bad input through the real command: one clear line a fault, exit code 2, nothing written."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from in_process import sparsemor
from sparsemor import InputError, load, simulate
from sparsemor.core.results.model_file import MAGIC
from sparsemor.core.simulation.validation import checked_model

SWING = (Path(__file__).parents[1] / "scenes" / "swing.yaml").read_text(encoding="utf-8")

Changed = Callable[..., Path]


@pytest.fixture
def changed(here: Path) -> Changed:
    """changed((old, new), ...): the scene `swing` with other text, in a folder of its own."""

    def write(*changes: tuple[str, str]) -> Path:
        text = SWING
        for old, new in changes:
            assert old in text
            text = text.replace(old, new, 1)
        Path("scene.yaml").write_text(text, encoding="utf-8")
        return Path("scene.yaml")

    return write


def refused(*arguments: str) -> list[str]:
    """The lines of a refused command. Nothing is on standard output, nothing new on disk."""
    before = sorted(Path().rglob("*"))
    done = sparsemor(*arguments)
    assert (done.code, done.out) == (2, "")
    assert sorted(Path().rglob("*")) == before
    return list(done.lines)


@pytest.mark.parametrize("command", ["validate", "reduce", "compare", "advise", "stability"])
def test_a_reduced_model_is_no_scene(command: str, here: Path) -> None:
    Path("bar.model").write_bytes(MAGIC)
    assert refused(command, "bar.model") == [
        "bar.model: is a reduced model, which `sparsemor run` takes; give its scene here"]


MESH = "{use: rectangle, size: [1.0, 0.1], divisions: [10, 2]}"
ARM = "    thickness: 0.02"
HEAT = 'flux: 1.0e5}'


def gmsh(points: list[tuple[float, float]], cells: list[tuple[int, int, int]]) -> str:
    """A Gmsh 2.2 file of triangles (point numbers from 1)."""
    nodes = [f"{i} {x} {y} 0" for i, (x, y) in enumerate(points, 1)]
    triangles = [f"{i} 2 2 0 1 {a} {b} {c}" for i, (a, b, c) in enumerate(cells, 1)]
    head = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$Nodes", str(len(nodes)), *nodes]
    return "\n".join([*head, "$EndNodes", "$Elements", str(len(triangles)), *triangles,
                      "$EndElements", ""])


SQUARE = [(0.0, 0.0), (1.0, 0.0), (1.0, 0.1), (0.0, 0.1)]
FAULTS: dict[str, tuple[list[tuple[str, str]], str, str, str]] = {
    # name: changes of the scene's text; the text at the place that is named; the key; words
    "unknown plugin": (
        [("use: lhs", "use: lsh")], "sampler:", "reducer.sampler", "did you mean lhs?"),
    "misspelt option": (
        [(ARM, "    thicknes: 0.02"), ("    fields", "    thickness: 0.02\n    fields")],
        "thicknes:", "bodies.arm.thicknes", "no such option: did you mean thickness?"),
    "wrong type": (
        [("mass: 0.5", "mass: heavy")], "mass:", "bodies.bob.mass", '(got "heavy")'),
    "negative thickness": (
        [(ARM, "    thickness: -0.02")], "thickness:", "bodies.arm.thickness",
        "greater than 0 (got -0.02)"),
    "missing mesh file": (
        [(MESH, "{use: file, path: arm.msh}")], "path:", "bodies.arm.mesh.path",
        "there is no file 'arm.msh'; paths start at the folder of the scene"),
    "mesh without the named set": (
        [('["arm:top"]', '["arm:upper"]')], '"arm:upper"', "loads.sun.on.0",
        "body 'arm' has no set 'upper': sets: bottom, "),
    "reference to no set": (
        [("bottom_right]", "bottom_rihgt]")], "chord:", "bodies.arm.reference.chord",
        "did you mean bottom_right"),
    "joint to an unknown body": (
        [('"bob:hook"]', '"bop:hook"]')], '"bop:hook"', "joints.hook.between.1",
        "no body is called 'bop': did you mean bob? bodies: arm, bob"),
    "no reference condition": (
        [("    reference: {chord: [bottom_left, bottom_right]}\n", "")], "arm:\n",
        "bodies.arm.reference", "needs a reference condition, such as {clamp: left}"),
    "more rows than unknowns": (
        [("rows: 16", "rows: 160")], "rows: 160", "reducer.budgets.*.elastic.rows",
        "160 rows were requested of arm.elastic, which has 54 unknowns to draw from in "
        "addition to the 9 that joints and loads need: take at most 54"),
    "non-finite load table": (
        [(HEAT, "flux: {use: table, times: [0, 0.1, 0.2], values: [0, .nan, 1]}}")], ".nan",
        "loads.sun.flux.values.1", "must be a finite number (got .nan)"),
    "two loads of one name": (
        [("  sun:", "  weight:")], "weight: {use: heat_flux", "loads.weight",
        "written twice, first at 25:3: two entries of one name; rename or remove one"),
    "sides of a joint that do not meet": (
        [("position: [1.0, 0.0]", "position: [1.1, 0.0]")], 'between: ["arm:right"',
        "joints.hook.between",
        "arm:right is at (1, 0.05) m, bob:hook at (1.1, 0.05) m, 0.1 m apart; correct a pose"),
    "load on a field the body lacks": (
        [("fields: [elastic, thermal]", "fields: [elastic]")], '"arm:top"', "loads.sun.on.0",
        "add `thermal` to its fields"),
    "heat into a rigid body": (
        [('["arm:top"]', '["bob:hook"]')], '"bob:hook"], flux', "loads.sun.on.0",
        "body 'bob' is rigid and has no temperature: make it flexible"),
    "probe on an unknown set": (
        [("at: right", "at: rihgt")], "at: rihgt", "probes.tip.at", "has no set 'rihgt'"),
    "an end that is no whole number of steps": (
        [("end: 0.2, step: 1.0e-3", "end: 0.2, step: 1.3e-3"), ("end: 0.2, every", "every")],
        "end: 0.2, step", "time.end",
        "0.2 s is not a whole number of steps of 0.0013 s (153.846 steps): take 0.1989 or 0.2002"),
    "a training end that is no whole number of steps": (
        [("training: {end: 0.2", "training: {end: 0.0105")], "end: 0.0105",
        "training.end", "(10.5 steps)"),
    "a training run that keeps its start only": (
        [("every: 2}", "every: 500}")], "every: 500", "training.every",
        "has 200 steps, so only its start would be kept: take at most 200 (got 500)"),
    "a budget that fits nothing": (
        [('"*.thermal": {rows', '"*.termal": {rows')], '"*.termal"', "reducer.budgets.*.termal",
        "fits no block: did you mean *.thermal"),
    "an unknown field": (
        [("[elastic, thermal]", "[elastic, thermic]")], "thermic", "bodies.arm.fields.1",
        "'elastic' or 'thermal' (got \"thermic\")"),
    "no atoms": (
        [("count: 6", "count: 0")], "count:", "reducer.basis.count",
        "greater than or equal to 1 (got 0)"),
    "true for a number": (
        [("mass: 0.5", "mass: true")], "mass:", "bodies.bob.mass", "a valid number (got true)"),
    "an unknown reducer": (
        [("use: sparse", "use: sparce")], "reducer:", "reducer", "did you mean sparse?"),
}


ASSEMBLED = ("a budget that fits nothing",)
"""Faults that show in the assembled model only."""
QUICK = [name for name in FAULTS if name not in ASSEMBLED][::8]


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=[pytest.mark.full] * (name not in QUICK)) for name in FAULTS])
def test_one_line_with_place_and_advice(changed: Changed, name: str) -> None:
    changes, marker, key, words = FAULTS[name]
    text = changed(*changes).read_text(encoding="utf-8")
    at = text.index(marker)
    row, column = text.count("\n", 0, at) + 1, at - text.rfind("\n", 0, at)
    (line,) = refused("run", "scene.yaml", "--out", "there")
    assert line.startswith(f"scene.yaml:{row}:{column}: {key}: ")
    assert words in line
    assert refused("validate", "scene.yaml") == [line]
    whole = ["--training-end", "1"] if key == "training.every" else []  # else it trains on half
    assert refused("compare", "scene.yaml", *whole) == [line]


MESHES = {
    "inverted elements": (
        gmsh([*SQUARE[:3], (0.9, 0.05)], [(1, 2, 3), (1, 3, 4)]),
        "1 of 2 cells are inverted and overlap their neighbours: 1; repair"),
    "disconnected elements": (
        gmsh([*SQUARE, (2.0, 0.0), (3.0, 0.0), (2.0, 1.0)],
             [(1, 2, 3), (1, 3, 4), (5, 6, 7)]),
        "2 pieces share no edge; the smallest has 1 cells, near (2.33333, 0.333333): merge"),
    "a file that is no mesh": ("nothing of use", "arm.msh:1: $: a section starts here with $"),
}


@pytest.mark.parametrize("name", MESHES)
def test_meshes_that_cannot_be_used(changed: Changed, name: str) -> None:
    content, words = MESHES[name]
    changed((MESH, "{use: file, path: arm.msh}"))
    Path("arm.msh").write_text(content, encoding="utf-8")
    (line,) = refused("run", "scene.yaml")
    assert line.startswith("scene.yaml:8:23: bodies.arm.mesh.path: ")
    assert words in line


def test_all_faults_are_told_at_once(changed: Changed) -> None:
    changed(("flux: 1.0e5", "flx: 1.0e5"), (ARM, "    thickness: 0"), ("count: 6", "count: six"))
    assert [line.split(": ")[1] for line in refused("run", "scene.yaml")] == [
        "bodies.arm.thickness", "loads.sun.flux", "loads.sun.flx", "reducer.basis.count"]


def test_all_faults_of_the_parts_are_told_at_once(changed: Changed) -> None:
    changed(('"arm:left"', '"arm:lft"'), ('"arm:right", "bob:hook"', '"arm:rght", "bob:hok"'),
            ('["arm:top"]', '["arm:tp", "arm:btm"]'), ("at: right", "at: rigth"),
            ("end: 0.2, step", "end: 0.2005, step"))
    assert [line.split(": ")[1] for line in refused("run", "scene.yaml")] == [
        "joints.pivot.between.1", "joints.hook.between.0", "joints.hook.between.1",
        "loads.sun.on.0", "loads.sun.on.1", "time.end", "probes.tip.at"]


def test_a_body_that_fails_does_not_hide_other_faults(changed: Changed) -> None:
    """Nor are joints and loads on it reported, which may be right."""
    changed((MESH, "{use: file, path: gone.msh}"), (", alpha: 2.0e-5, k: 40.0", ""),
            ("at: hook", "at: hok"))
    assert [line.split(": ")[1] for line in refused("validate", "scene.yaml")] == [
        "bodies.arm.mesh.path", "bodies.arm.material.k", "probes.weight_point.at"]


def test_nothing_that_can_change(changed: Changed) -> None:
    scene = Path("scene.yaml")
    changed()
    scene.write_text("""\
format: 1
bodies:
  plate:
    use: flexible
    mesh: {use: rectangle, size: [1, 1], divisions: [2, 2]}
    thickness: 0.1
    material: {rho: 1000, k: 1, c: 1}
    fields: [thermal]
    frame: fixed
joints:
  held: {use: prescribed_temperature, on: ["plate:all"], temperature: 300}
time: {end: 1, step: 0.1}
""".replace('mesh:', 'sets: {all: {box: [[0, 1], [0, 1]]}}\n    mesh:'), encoding="utf-8")
    (line,) = refused("run", "scene.yaml")
    assert line.startswith("scene.yaml:12:44: joints.held.on.0: with 'plate:all' the temperature "
                           "of every node of 'plate' is prescribed")
    text = scene.read_text()
    scene.write_text(text[: text.index("joints:")].replace("[thermal]", "[]")
                     + text[text.index("time:"):])
    (line,) = refused("run", "scene.yaml")
    assert line.startswith("scene.yaml:2:1: bodies: nothing in this scene can change"), line


@pytest.mark.full
def test_changes_from_the_command_line_are_placed_there(changed: Changed) -> None:
    changed()
    assert refused("run", "scene.yaml", "--set", 'reducer.budgets."*.elastic".rows=500') == [
        '--set reducer.budgets."*.elastic".rows: reducer.budgets.*.elastic.rows: 500 rows were '
        "requested of arm.elastic, which has 54 unknowns to draw from in "
        "addition to the 9 that joints and loads need: take at most 54"]
    (line,) = refused("run", "scene.yaml", "--set", "time.end=0.0015")
    assert line.startswith("--set time.end: 0.0015 s is not a whole number of steps")


def test_places_that_cannot_be_written_to(changed: Changed) -> None:
    changed()
    Path("file").touch()
    (line,) = refused("run", "scene.yaml", "--out", "file/inside")
    assert line.startswith("--out: file/inside: file is not writable")
    (line,) = refused("run", "scene.yaml", "--resume")
    assert line.startswith("--resume: ") and "there is no result" in line


@pytest.mark.full
def test_refusal_comes_before_the_training_run(changed: Changed, tmp_path: Path) -> None:
    """Numbers that follow from the scene alone cost no training."""
    changed(("rows: 16", "rows: 160"), ("every: 2}", "every: 500}"))
    assert len(refused("run", "scene.yaml")) == 2
    assert not (tmp_path / "cache").exists()


@pytest.mark.full
def test_faults_that_only_the_training_run_shows(changed: Changed) -> None:
    changed(("rows: 8, atoms: 6", "rows: 0, atoms: 6"), ("required: true", "required: false"))
    (line,) = refused("run", "scene.yaml")
    assert "reducer.budgets: arm.thermal: 0 rows cannot determine" in line
    assert refused("compare", "scene.yaml") == [line]  # also not what ran before


def test_in_json(changed: Changed) -> None:
    changed((ARM, "    thickness: -0.02"))
    for command in ("run", "validate", "compare"):
        done = sparsemor(command, "scene.yaml", "--json")
        shown = json.loads(done.out)
        assert done.code == 2 and shown["status"] == "bad_input"
        assert shown["errors"] == done.lines and len(done.lines) == 1


@pytest.mark.full
def test_in_python(changed: Changed) -> None:
    with pytest.raises(InputError) as caught:
        load(changed((ARM, "    thickness: -0.02"), ("mass: 0.5", "mass: 0")))
    assert [f.key for f in caught.value.faults] == ["bodies.arm.thickness", "bodies.bob.mass"]
    scene = load(changed(('"bob:hook"]', '"bop:hook"]'), ("end: 0.2, step", "end: 0.2005, step")))
    keys = {"joints.hook.between.1", "time.end"}
    for use in (simulate, checked_model):
        with pytest.raises(InputError) as caught:
            use(scene)
        assert {f.key for f in caught.value.faults} == keys
    assert [line.split(": ")[0] for line in scene.locate(caught.value)] == [
        "scene.yaml:22:48", "scene.yaml:28:8"]


@pytest.mark.full
def test_the_installed_program_says_the_same(changed: Changed) -> None:
    changed(('"bob:hook"]', '"bop:hook"]'))
    done = subprocess.run(
        [Path(sys.executable).with_name("sparsemor"), "run", "scene.yaml"], capture_output=True,
        text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.splitlines() == refused("run", "scene.yaml")
    assert [p.name for p in Path().iterdir()] == ["scene.yaml"]
