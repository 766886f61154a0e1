"""Errors above a limit are marked in every table, file and chart; what is constant has no error
relative to its round-off."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor.bodies.terms.field_kinds import BODY_KINDS
from sparsemor.core.results.relative_error_estimates import LIMIT
from sparsemor.core.status import Status
from sparsemor.plugins.charts.error_over_time import error_over_time_figure
from sparsemor.plugins.charts.work_precision import WorkPoint, work_precision_figure
from sparsemor.plugins.comparison.compare import Comparison, compare
from sparsemor.plugins.comparison.error_norms import measure_errors
from sparsemor.plugins.publishing.tables import marked, text_table
from sparsemor.plugins.study.plan import StudyPlan
from sparsemor.plugins.study.report import counted, in_words
from sparsemor.plugins.study.table_columns import measured
from toy_scene import TOY_SCENE
from toy_study import HEAD, planned
from written_runs import ALL, TIMES, motion, write_run


def runs(tmp_path: Path, limit: float = LIMIT) -> Comparison:
    """A run that is wrong by 0.5 in the elastic field alone, and one that is right."""
    wrong, right = motion(ALL, np.linspace(0.0, 1.0, 41)), motion(ALL, np.linspace(0.0, 1.0, 41))
    wrong[:, 3:11] *= 1.5
    right[:, 3:11] *= 1.0 + 1e-6
    return compare(write_run(tmp_path / "full"), error_limit=limit,
                   wrong=write_run(tmp_path / "wrong", x=wrong),
                   right=write_run(tmp_path / "right", x=right))


def test_what_is_above_the_limit_is_marked(tmp_path: Path) -> None:
    made = runs(tmp_path)
    assert made.above_limit == {"wrong": {"elastic": pytest.approx(0.5)}}
    lines = str(made).splitlines()
    wrong = next(line for line in lines if line.startswith("wrong"))
    right = next(line for line in lines if line.startswith("right"))
    assert "5.00e-01!" in wrong and "!" not in right
    assert wrong.index("5.00e-01") == right.index("1.00e-06")  # digits below digits
    assert "! above 0.1: 1 of 2 runs: wrong (elastic 0.5)" in lines
    assert sum("5.0e-01!" in line for line in lines) == 1  # start-up and rest
    told = json.loads(made.to_json())["runs"]
    assert list(told["wrong"]["above_limit"]) == ["elastic"] and not told["right"]["above_limit"]
    made.write(tmp_path / "out", charts=False)
    with (tmp_path / "out" / "errors.csv").open(encoding="utf-8") as text:
        rows = {r["run"]: r for r in csv.DictReader(text)}
    assert (rows["wrong"]["above_limit"], rows["right"]["above_limit"]) == ("elastic", "")


def test_a_mark_does_not_move_the_digits() -> None:
    assert [marked(v, ".1e", 0.1) for v in (0.2, 0.1, None)] == ["2.0e-01!", "1.0e-01", "-"]
    table = text_table([["run", "error"], ["a", "2.0e-01!"], ["b", "1.0e-03"], ["c", "-"]])
    assert table.splitlines()[2:] == ["a    2.0e-01!", "b    1.0e-03", "c          -"]


@pytest.mark.full
def test_charts_show_the_limit(tmp_path: Path) -> None:
    made = runs(tmp_path)
    statuses = dict.fromkeys(made.runs, Status.DONE)
    over_time = error_over_time_figure(made.measured, statuses, BODY_KINDS)
    high = error_over_time_figure(made.measured, statuses, BODY_KINDS, 1.0)
    assert over_time is not None and high is not None
    assert [t.get_text() for axes in over_time.axes for t in axes.texts] == ["limit 0.1"]
    assert not any(axes.texts for axes in high.axes)
    points = [WorkPoint(name, "", ms, {"elastic": e, "thermal": 1e-9}, Status.DONE)
              for name, ms, e in (("wrong", 1.0, 0.5), ("right", 2.0, 1e-6))]
    figure = work_precision_figure(points, None, BODY_KINDS)
    assert figure is not None
    crossed = [tuple(line.get_xydata()[0]) for axes in figure.axes for line in axes.lines
               if line.get_marker() == "x"]
    assert crossed == [(1.0, 0.5)]
    assert figure.get_supxlabel() == "crossed out: error above 0.1"


def still(tmp_path: Path, factor: float) -> Comparison:
    """Temperatures that change by round-off in the reference, and by `factor` of themselves in the
    run."""
    times = np.linspace(0.0, 1.0, 41)
    here, there = motion(ALL, times), motion(ALL, times)
    here[:, 11:15] = 293.15 * (1.0 + 2e-14 * np.outer(np.arange(41) % 3, np.ones(4)))
    there[:, 11:15] = 293.15 * (1.0 + factor * np.outer(np.arange(41) % 2, np.ones(4)))
    return compare(write_run(tmp_path / "full", x=here), run=write_run(tmp_path / "run", x=there))


def test_a_field_that_changes_by_round_off_is_constant(tmp_path: Path) -> None:
    """58 % of round-off was reported as an error of 58 %."""
    made = still(tmp_path, 3e-14)
    errors = made.measured["run"]
    assert errors.constant == {"arm.thermal", "thermal"}
    assert errors.worst["thermal"] == errors.worst["arm.thermal"] < 1e-12
    (row,) = [t for t in str(made).splitlines() if t.startswith("run  ") and "done" in t]
    assert "constant" in row
    assert str(made).count("constant") == 2  # by field, and in the table by block
    figure = error_over_time_figure(made.measured, {"run": Status.DONE}, BODY_KINDS)
    assert figure is None or "temperature" not in [a.get_title(loc="left") for a in figure.axes]
    columns = measured(made.runs["run"], made.reference, 0.0, "")
    assert columns["constant"] == "thermal" and columns["error_thermal"] < 1e-12
    made.write(tmp_path / "out", charts=False)
    with (tmp_path / "out" / "errors.csv").open(encoding="utf-8") as text:
        rows = {r["run"]: r for r in csv.DictReader(text)}
    assert rows["run"]["constant"] == "arm.thermal thermal" and not rows["run"]["above_limit"]


def test_a_run_that_moves_a_constant_field_has_an_error(tmp_path: Path) -> None:
    """Relative to the field's own size."""
    made = still(tmp_path, 0.2)
    assert measure_errors(made.reference, made.runs["run"]).worst["thermal"] == pytest.approx(0.2)
    assert "constant" not in str(made)
    assert list(made.above_limit["run"]) == ["combined", "thermal"]


@pytest.mark.parametrize(("solver", "error"), [
    ({"use": "cg", "rtol": 1e-10}, 1e-8), ({"use": "splu"}, 1.0)])
def test_remainders_of_iterative_solvers_are_no_change(
    solver: dict[str, Any], error: float, tmp_path: Path
) -> None:
    """A field at rest that conjugate gradients move by 1e-8 of itself, and that a reduced run does
    not move at all: its error was 1."""
    x = motion(ALL, TIMES)
    x[:, 11:15] = 293.15
    full = x.copy()
    full[1:, 11:15] *= 1.0 + 1e-8
    runs = [write_run(tmp_path / name, x=states, scene={"linear_solver": solver})
            for name, states in (("full", full), ("run", x))]
    assert measure_errors(*runs).worst["arm.thermal"] == pytest.approx(error, rel=1e-6)


@pytest.mark.full
@pytest.mark.usefixtures("toys")
def test_a_study_counts_its_marked_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("scene.yaml").write_text(TOY_SCENE)
    plan: StudyPlan = planned(HEAD + "grid: {bodies.a.mass: [1, 2, 3, 4]}\n")
    made = runs(tmp_path)
    rows: list[dict[str, Any]] = [
        {"run": i, "message": "", **measured(made.runs[name], made.reference, 0.0, "")}
        for i, name in enumerate(("wrong", "right", "wrong"), 1)]
    assert [r["above_limit"] for r in rows] == ["elastic", "", "elastic"]
    assert counted(plan, rows) == (
        "4 runs: 3 done (2 with an error above 0.1, marked !), 1 not run yet")
    text = in_words(plan, rows)
    assert text.count("5.00e-01!") == 2 and text.count("1.00e-06") == 1
