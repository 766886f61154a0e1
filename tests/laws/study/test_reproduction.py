"""The packaged paper is complete and can be computed, rules give what they say, and a verdict
follows the numbers."""

import ast
import json
import shlex
from inspect import currentframe
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from packaged_paper import packaged_paper
from source_trees import tree_of
from sparsemor.core.errors import InputError
from sparsemor.core.registry.registry import Registry
from sparsemor.core.scene.scene import load
from sparsemor.core.scene.yaml_reader import LocatedError
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.simulate import simulate
from sparsemor.plugins.command_line.options import load_with
from sparsemor.plugins.liang2026.computing_time_split import LOOP, Counted
from sparsemor.plugins.liang2026.page import text_of
from sparsemor.plugins.liang2026.paper import (
    BROKEN,
    GRADES,
    MISSED,
    PaperFile,
    RunEntry,
    rule,
)
from sparsemor.plugins.liang2026.quantities import formula, study
from sparsemor.plugins.liang2026.reproduce import chosen_items, reproduce
from sparsemor.plugins.liang2026.runs import command_of, commands_of, plan_of, scene_of
from sparsemor.plugins.study.jobs import execute, keep_reference, scene_data

ROOT = Path(__file__).parents[3]
FIGURES = [f"fig_{n}" for n in range(1, 24)]
TABLES = [f"table_{n}" for n in range(1, 13)]
SCENES = {"double_pendulum": ([*range(1, 9)], [*range(1, 5)]),
          "slider_plate": ([*range(9, 16)], [*range(5, 9)]),
          "brake_disk": ([*range(16, 24)], [*range(9, 13)])}
TOY = """\
title: Short heated bar
source: nowhere
scenes: {bar: Bar, none: Nothing}
runs:
  whole: {scene: tiny.yaml, set: {reducer: full}}
  few:
    scene: tiny.yaml
    set: {reducer: {use: galerkin, basis: {use: pod, count: 4}}}
    after: whole
    profile: 40
  wrong: {scene: tiny.yaml, set: {reducer: no_such}}
items:
  - id: fig_1
    scene: bar
    title: <Angle> & error
    published: It turns.
    values:
      error: {label: error, paper: BOUND, of: {use: error, run: few, reference: whole}}
      angle: {label: angle, unit: rad, of: {use: rotation, run: whole, body: bar}}
      seconds: {label: time, unit: s, of: {use: split, run: few, part: overall}}
      twice: {label: twice the error, of: {use: formula, text: 2 * error}}
    verdict: {better: error <= 0.1 * paper_error, reproduced: error <= paper_error}
    shortfall: It is larger.
    pictures:
      - {draws: angles, reference: whole, others: {few: few}}
      - draws: fields
        field: temperature
        times: [0.02, 0.04]
        reference: whole
        others: {few: few}
  - id: table_1
    scene: none
    title: Broken
    published: Nothing.
    values: {angle: {label: angle, of: {use: rotation, run: wrong, body: bar}}}
    verdict: {reproduced: angle > 0}
"""


def toy(bound: float) -> str:
    """Path of the toy paper in this folder, with this published error."""
    Path("tiny.yaml").write_text((ROOT / "tests" / "scenes" / "tiny.yaml").read_text())
    Path("paper.yaml").write_text(TOY.replace("BOUND", str(bound)))
    return "paper.yaml"


def test_every_figure_and_table_is_an_item_of_its_scene() -> None:
    assert sorted(i.id for i in packaged_paper().items) == sorted([*FIGURES, *TABLES])
    for scene, (figures, tables) in SCENES.items():
        ids = {*(f"fig_{n}" for n in figures), *(f"table_{n}" for n in tables)}
        assert {i.id for i in chosen_items(packaged_paper(), scene)} == ids


@pytest.mark.parametrize("name", [*FIGURES, *TABLES])
def test_every_item_has_a_rule_on_its_numbers_and_a_command(name: str) -> None:
    (item,) = (i for i in packaged_paper().items if i.id == name)
    first, *others = commands_of(packaged_paper(), item, quick=False)
    assert first == f"sparsemor reproduce --items {item.id}" and others
    assert any({*rule(text).names} & {*item.values} for text in item.verdict.values())
    assert item.title and item.published and (item.shortfall or "reproduced" not in item.verdict)
    # without numbers no rule is met: a verdict is never a constant
    nothing = dict.fromkeys([*item.values, *(f"paper_{n}" for n in item.values)])
    assert item.grade(nothing) == MISSED


@pytest.mark.full
@pytest.mark.parametrize("quick", [False, True])
def test_every_run_is_a_valid_scene_and_its_command_repeats_it(quick: bool) -> None:
    assert packaged_paper().runs
    for name, entry in packaged_paper().runs.items():
        scene = scene_of(entry, quick)
        program, verb, named, *settings = shlex.split(command_of(entry, quick))
        assert (program, verb) == ("sparsemor", "run"), name
        assert load_with(named, settings[1::2]).digest() == scene.digest(), name


@pytest.mark.full
@pytest.mark.parametrize("quick", [False, True])
def test_every_study_has_the_rows_that_items_read(quick: bool, here: Path) -> None:
    assert packaged_paper().studies
    for name, entry in packaged_paper().studies.items():
        read = packaged_paper().rows_read(name)
        plan = plan_of(entry, read, quick, here / "plans" / f"{name}.yaml")
        assert not any(run.refused for run in plan.runs), name
        of_rows = [[run.number for run in plan.runs if row.items() <= dict(run.settings).items()]
                   for row in read]
        assert read and all(of_rows), name
        if quick:
            asked = {n for numbers in of_rows for n in numbers}
            assert asked == {r.number for r in plan.runs}, name


@pytest.mark.full
def test_a_run_is_the_reference_of_studies_with_its_physics(here: Path) -> None:
    tiny = ROOT / "tests" / "scenes" / "tiny.yaml"
    scene = load(tiny, {"reducer": "full", "time.end": 0.003})
    simulate(scene, out="out")
    keep_reference(scene, Path("out"))
    for change, same in (({"title": "another", "seed": 7}, True), ({"output.every": 3}, False),
                         ({"time.end": 0.002}, False)):
        job = {"kind": "reference", "scene": scene_data(scene.using(change))}
        kept = Cache().root / "reference" / execute(job)["key"] / "result" / "header.json"
        assert kept.samefile(Path("out", "result", "header.json")) is same


def test_the_functions_that_count_as_matrix_operations_exist() -> None:
    for text in (*packaged_paper().matrix_operations, ":".join(LOOP)):
        file, _, name = text.partition(":")
        names = {f"{c.name}.{m.name}" for c in tree_of(ROOT / file).body
                 if isinstance(c, ast.ClassDef) for m in c.body if isinstance(m, ast.FunctionDef)}
        names |= {f.name for f in tree_of(ROOT / file).body if isinstance(f, ast.FunctionDef)}
        assert name in names, text


@pytest.mark.parametrize(("text", "expected"), [
    ("a <= 0.1 * paper_a", True), ("a > paper_a or b == 'done'", True), ("a < b", False),
    ("1 < a < 3 and not c > 1", True), ("c < 1", False), ("c * 2 > 0 or c == c", False),
    ("c != 1", False), ("abs(-a) == 2 and min(a, 1) == 1 and max(a, c) > 0", False),
    ("a / 0 > 1", False), ("-a < 0 and a ** 2 == 4", True), ("b != 'done' or b != 2", False)])
def test_rules(text: str, expected: bool) -> None:
    values = {"a": 2.0, "paper_a": 30.0, "b": "done", "c": None}
    assert bool(rule(text).value(values)) is expected


@pytest.mark.parametrize("text", [
    "__import__('os')", "a.b", "[a]", "lambda: a", "open('x')", "a <", "a if b else c", "a in b",
    "'b' + 'c' > 2", "a", "2 * a"])
def test_a_rule_is_no_program(text: str) -> None:
    with pytest.raises(InputError, match="allowed|give a condition"):
        rule(text)


def test_a_rule_does_not_compute_with_texts() -> None:
    with pytest.raises(InputError, match="computes with numbers"):
        rule("2 * a > 1").value({"a": "done"})


@pytest.mark.parametrize(("text", "expected"), [
    ("2 * a + 1 - 1", 4.0), ("a * c", None), ("a / 0", None)])
def test_formulas(text: str, expected: float | None) -> None:
    assert formula(text, {"a": 2.0, "c": None}) == expected


@pytest.mark.parametrize(("old", "new", "fault"), [
    ("reproduced: error <= paper_error", "reproduced: eror <= 1", "unknown names eror"),
    ("run: few, reference", "run: fex, reference", "no run 'fex'"),
    ("id: table_1", "id: fig_1", "fig_1: twice"), ("scene: none", "scene: moon", "no scene"),
    ("after: whole", "after: few", "few: no run 'few'"), ("better:", "best:", "better"),
    ("use: rotation", "use: rotations", "rotations")])
def test_faults_of_a_paper_file_are_located(old: str, new: str, fault: str, here: Path) -> None:
    toy(1.0)
    Path("paper.yaml").write_text(TOY.replace("BOUND", "1.0").replace(old, new, 1))
    with pytest.raises(LocatedError, match=fault):
        PaperFile.read("paper.yaml", Registry())


@pytest.mark.full
def test_a_verdict_follows_the_numbers_and_what_is_complete_is_kept(here: Path) -> None:
    done = reproduce(paper=toy(1e-12), out="out", workers=1)
    fig, table = done.verdicts
    assert (fig.grade, table.grade) == (MISSED, BROKEN) and not fig.met
    assert "no_such" in table.faults[0] and fig.faults == ()
    numbers = {n.name: n for n in fig.numbers}
    error = numbers["error"].here
    assert isinstance(error, float) and 1e-12 < error < 1.0
    assert numbers["twice"].here == 2 * error and numbers["error"].paper == 1e-12
    seconds = numbers["seconds"].here
    assert isinstance(seconds, float) and 0 < seconds < 60
    assert {p.rsplit("_", 1)[1] for p in fig.pictures} == {"angles.png", "temperature.png"}
    assert all((here / "out" / "pictures" / p).stat().st_size > 5000 for p in fig.pictures)
    index, page = (here / "out" / n for n in ("index.html", "bar.html"))
    assert "It is larger." in page.read_text() and text_of(error) in page.read_text()
    assert "&lt;Angle&gt; &amp; error" in page.read_text()
    for text in (index.read_text(), page.read_text()):
        assert "http" not in text and "<script" not in text
    before = (here / "out" / "runs" / "whole" / "result" / "header.json").stat().st_mtime_ns
    for bound, grade in ((1.5 * error, "reproduced"), (20.0 * error, "better")):
        again = reproduce("bar", paper=toy(bound), out="out", workers=1)
        assert [v.grade for v in again.verdicts] == [grade]
        assert grade in GRADES and again.counts == {grade: 1} and not again.incomplete
    after = (here / "out" / "runs" / "whole" / "result" / "header.json").stat().st_mtime_ns
    assert before == after, "a complete run was repeated"
    assert "better" in (here / "out" / "verdicts.csv").read_text()
    with pytest.raises(InputError, match="reproduction without --quick"):
        reproduce(paper="paper.yaml", out="out", quick=True)


@pytest.mark.parametrize(("arguments", "fault"), [
    ({"scene": "moon"}, "SCENE"), ({"items": ["fig_99"]}, "no figure or table 'fig_99'"),
    ({"scene": "none", "items": ["fig_1"]}, "none of fig_1"), ({"workers": 0}, "at least 1")])
def test_bad_arguments_write_nothing(
    arguments: dict[str, object], fault: str, here: Path
) -> None:
    paper = toy(1.0)
    with pytest.raises(InputError, match=fault):
        reproduce(paper=paper, out="out", **arguments)  # type: ignore[arg-type]
    assert not (here / "out").exists()


def test_another_folder_is_not_overwritten(here: Path) -> None:
    (here / "out").mkdir()
    (here / "out" / "mine.txt").write_text("kept")
    with pytest.raises(InputError, match="contains no reproduction"):
        reproduce(paper=toy(1.0), out="out")
    assert (here / "out" / "mine.txt").read_text() == "kept"


def test_a_row_of_a_study_that_was_refused_is_no_result() -> None:
    rows = [{"n": 1, "status": "done", "e": 2.0}, {"n": 1, "status": "diverged", "e": 5.0},
            {"n": 2, "status": "refused", "message": "no such body", "e": None}]
    takes: list[Any] = ["max", "min", "median", "mean"]
    assert [study(rows, "e", {"n": 1}, take) for take in takes] == [5.0, 2.0, 3.5, 3.5]
    with pytest.raises(InputError, match="no such body"):
        study(rows, "e", {"n": 2})
    with pytest.raises(InputError, match="no row"):
        study(rows, "e", {"n": 3})


def test_samples_of_a_stack_are_told_apart() -> None:
    """A frame counts as a matrix operation inside a listed function, and only in the time loop."""
    counted = Counted(["test_reproduction.py:solved"])
    frame = currentframe()
    assert counted.kind_of(frame) == ""
    seen: list[str] = []
    code = compile("def loop(f):\n    f()\n", "x/core/simulation/run_steps.py", "exec")
    space: dict[str, object] = {}
    exec(code, space)  # noqa: S102
    loop = space["loop"]
    assert callable(loop)
    renamed = loop.__code__.replace(co_qualname=LOOP[1])
    loop.__code__ = renamed
    loop(lambda: seen.append(counted.kind_of(currentframe())))
    loop(lambda: solved(seen, counted))
    assert seen == ["update", "matrix"]


def solved(seen: list[str], counted: Counted) -> None:
    np.zeros(1)
    seen.append(counted.kind_of(currentframe()))


def test_values_as_text() -> None:
    assert [text_of(v) for v in (None, "done", True, 3.0, 6.138, 1e-7, 2.5e6)] == [
        "–", "done", "true", "3", "6.138", "1.00e-07", "2.50e+06"]


def test_settings_of_a_command_can_be_read_by_a_shell() -> None:
    entry = RunEntry.model_validate({
        "scene": "brake_disk", "set": {'reducer.budgets."*.a"': {"rows": 1}, "time.end": 0.5}})
    text = command_of(entry, False)
    assert text == ("sparsemor run brake_disk --set "
                    "'reducer.budgets.\"*.a\"={\"rows\": 1}' --set time.end=0.5")
    assert json.loads(text.split("=", 1)[1].split("'")[0]) == {"rows": 1}
