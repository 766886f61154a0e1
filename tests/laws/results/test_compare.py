"""Error measures with known answers, the table, and pictures that show something."""

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor.core import Dictionary
from sparsemor.core.errors import InputError
from sparsemor.core.protocols.layout import Block, Layout
from sparsemor.core.results.run_result import RunResult, open_result
from sparsemor.core.status import Status
from sparsemor.plugins.charts import FORMATS, write_run_charts
from sparsemor.plugins.charts.fields import magnification
from sparsemor.plugins.comparison.compare import Comparison, compare, installed_charts
from sparsemor.plugins.comparison.error_norms import common_steps, measure_errors
from written_runs import (
    ALL,
    ELASTIC,
    PIN,
    RIGID,
    THERMAL,
    TIMES,
    motion,
    write_run,
)


def test_known_errors(tmp_path: Path) -> None:
    reference = write_run(tmp_path / "a")
    x = motion(ALL, TIMES)
    layout = Layout(ALL)
    x[20, layout["arm.elastic"].start] += 3e-5
    x[4, layout["arm.elastic"].start] += 5e-5
    x[30, layout["arm.rigid"].start + 2] -= 0.01
    x[10, layout["arm.thermal"]] += 2.0
    x[:, layout["pin.multiplier"]] += 1e6  # forces of constraint are in no error
    run = write_run(tmp_path / "b", x=x)
    e = measure_errors(reference, run, late_from=0.3)
    moved = np.linalg.norm([0.5, -0.5, -2.0])
    assert e.worst["elastic"] == pytest.approx(5e-5 / (1e-3 * np.sqrt(8)), rel=1e-10)
    assert e.worst_late["elastic"] == pytest.approx(3e-5 / (1e-3 * np.sqrt(8)), rel=1e-10)
    assert e.worst["arm.rigid"] == pytest.approx(0.01 / moved, rel=1e-10)
    assert e.worst["angle_rad"] == pytest.approx(0.01, rel=1e-10)
    assert e.worst["thermal"] == pytest.approx(4.0 / 160.0, rel=1e-10)
    assert e.worst_late["thermal"] == 0.0
    q = np.delete(motion(ALL, TIMES)[10], np.r_[layout["pin.multiplier"]])
    assert e.worst["combined"] == pytest.approx(4.0 / np.linalg.norm(q), rel=1e-10)
    assert np.flatnonzero(e.series["combined"]).tolist() == [4, 10, 20, 30]
    assert e.until == 1.0


def test_start_up_is_told_from_the_rest(tmp_path: Path) -> None:
    """2 % of 1 s are the first two of a hundred steps; the elastic field grows from zero."""
    times = np.linspace(0.0, 1.0, 101)
    blocks = (RIGID, ELASTIC, THERMAL)
    reference, layout = motion(blocks, times), Layout(blocks)
    x = reference.copy()
    for step, error in ((0, 4e-3), (2, 5e-5), (3, 1e-5), (100, 2e-5)):
        x[step, layout["arm.elastic"].start] += error
    e = measure_errors(write_run(tmp_path / "a", blocks, reference, times),
                       write_run(tmp_path / "b", blocks, x, times))
    whole = 1e-3 * np.sqrt(8)
    assert e.start_up_end == pytest.approx(0.02)
    assert e.start_up["elastic"] == pytest.approx(5e-5 / whole, rel=1e-9)  # not the start itself
    assert e.steady["arm.elastic"] == pytest.approx(2e-5 / whole, rel=1e-9)
    assert e.start_up_present["arm.elastic"] == pytest.approx(5e-5 / (0.02 * whole), rel=1e-9)
    assert e.steady_present["elastic"] == pytest.approx(1e-5 / (0.03 * whole), rel=1e-9)
    assert e.start_up_present["combined"] == e.start_up["combined"] == e.series["combined"][2]
    assert e.start_up["thermal"] == e.steady_present["thermal"] == 0.0
    early = measure_errors(write_run(tmp_path / "c", blocks, reference, times),
                           write_run(tmp_path / "d", blocks, x[:3], times[:3]))
    assert early.start_up_present == e.start_up_present
    assert early.steady == early.steady_present == {}


def test_vanishing_references_give_numbers(tmp_path: Path) -> None:
    blocks = (RIGID,)
    still = np.zeros((3, 3))
    moved = still.copy()
    moved[2, 0] = 0.5
    t = np.array([0.0, 1.0, 2.0])
    zero = write_run(tmp_path / "a", blocks, still, t)
    run = write_run(tmp_path / "b", blocks, moved, t)
    assert measure_errors(zero, zero).worst["rigid"] == 0.0
    assert measure_errors(zero, run).worst["rigid"] == 0.5  # absolute: nothing to divide by
    assert measure_errors(zero, run).worst["combined"] == 0.0  # every time is left out
    resting = write_run(tmp_path / "c", blocks, still + [3.0, 4.0, 0.0], t)
    assert measure_errors(resting, write_run(
        tmp_path / "d", blocks, moved + [3.0, 4.0, 0.0], t)).worst["rigid"] == pytest.approx(0.1)


def test_huge_values_of_a_diverged_run_stay_finite(tmp_path: Path) -> None:
    x = motion(ALL, TIMES[:11])
    x[10] = 1e250
    run = write_run(tmp_path / "b", x=x, times=TIMES[:11], status=Status.DIVERGED)
    e = measure_errors(write_run(tmp_path / "a"), run)
    assert all(np.isfinite(v) for v in e.worst.values())
    assert e.worst["combined"] > 1e240 and e.until == 0.25


def test_common_times() -> None:
    a = np.linspace(0.0, 1.0, 11)
    here, there = common_steps(a, np.array([0.0, 0.2 + 1e-13, 0.25, 0.4, 1.0, 1.2]))
    assert here.tolist() == [0, 2, 4, 10] and there.tolist() == [0, 1, 3, 4]
    assert common_steps(np.array([0.5]), np.array([0.1, 0.5]))[1].tolist() == [1]
    with pytest.raises(InputError, match="no stored time in common"):
        common_steps(a, a + 0.05)
    with pytest.raises(InputError, match="no stored time in common"):
        common_steps(a, np.zeros(0))


def test_runs_of_other_models_are_compared_on_common_blocks(tmp_path: Path) -> None:
    found = compare(reference=write_run(tmp_path / "a"),
                    cold=write_run(tmp_path / "b", (RIGID, ELASTIC)))
    assert found.measured["cold"].unshared == ("arm.thermal",)
    assert "arm.thermal" not in found.errors["cold"] and "arm.elastic" in found.errors["cold"]
    with pytest.raises(InputError, match=r"other: .*no unknowns in common: .*arm.thermal"):
        compare(reference=write_run(tmp_path / "d", (RIGID,)),
                other=write_run(tmp_path / "e", (THERMAL,)))
    with pytest.raises(InputError, match="at least one run"):
        compare(reference=write_run(tmp_path / "c"))


@pytest.fixture(scope="module")
def comparison(tmp_path_factory: pytest.TempPathFactory) -> Comparison:
    folder = tmp_path_factory.mktemp("runs")
    atoms = np.linalg.qr(np.column_stack([np.ones(8), np.arange(8.0), np.arange(8.0) ** 2]))[0]
    dictionary = Dictionary(atoms, np.full(8, 5e-4), ("a", "b", "c"))
    x = motion(ALL, TIMES)
    return compare(
        reference=write_run(folder / "full"), errors_from=0.1,
        untf=write_run(folder / "untf", x=x * (1 + 1e-6), seconds=1e-3, dictionary=dictionary),
        deim=write_run(folder / "deim", x=(x * 1.01)[:21], times=TIMES[:21], seconds=2e-3,
                       status=Status.DIVERGED))


def test_table_and_json(comparison: Comparison) -> None:
    lines = str(comparison).splitlines()
    assert lines[0].split()[:4] == ["run", "reducer", "status", "ms/step"]
    row = next(line.split() for line in lines if line.startswith("untf"))
    assert row[1:9] == ["sparse", "done", "1", "4", "3.00", "1.98/3", "5", "2.5"]
    assert row[10] == "1.00e-06"
    assert lines[-1] == "deim: diverged, compared up to 0.5 s of 1 s"
    data = json.loads(comparison.to_json())
    assert data["runs"]["deim"]["status"] == "diverged" and data["runs"]["untf"]["rows"] == 5
    assert data["runs"]["untf"]["errors"] == comparison.errors["untf"]
    at = next(i for i, line in enumerate(lines) if line.startswith("first 2% / rest"))
    assert lines[at].split()[4:] == ["combined", "arm.rigid", "arm.elastic", "arm.thermal"]
    assert lines[at + 2].split()[:4] == ["untf", "-", "/", "1.0e-06"]  # steps of 2.5 %
    assert "start-up until 0.02 s" in lines[at + 4]
    steady = data["runs"]["untf"]["steady"]["arm.elastic"]
    assert steady == comparison.measured["untf"].steady["arm.elastic"] > 0.0


@pytest.mark.full
def test_written_tables_and_pictures(comparison: Comparison, tmp_path: Path) -> None:
    files = comparison.write(tmp_path)
    names = {"deformation", "temperature", "angles", "error_over_time", "work_precision",
             "active_atoms_untf"}
    assert {f.name for f in files} == {f"{n}.{k}" for n in names for k in FORMATS} | {
        "errors.csv", "start_up.csv", "error_over_time.csv"}
    with (tmp_path / "errors.csv").open(encoding="utf-8") as text:
        rows = {r["run"]: r for r in csv.DictReader(text)}
    assert float(rows["untf"]["combined"]) == comparison.errors["untf"]["combined"]
    assert comparison.name == "full"
    assert (rows["full"]["combined"], rows["deim"]["status"]) == ("", "diverged")
    assert float(rows["untf"]["offline_s"]) == 2.5
    with (tmp_path / "error_over_time.csv").open(encoding="utf-8") as text:
        series = list(csv.DictReader(text))
    assert len(series) == 41 + 21
    own = comparison.measured["untf"].present["arm.elastic"]
    assert float(series[40]["arm.elastic_present"]) == own[40]
    with (tmp_path / "start_up.csv").open(encoding="utf-8") as text:
        phases = {(r["run"], r["measure"]): r for r in csv.DictReader(text)}
    assert float(phases["deim", "combined"]["steady_present"]) == pytest.approx(0.01)
    assert phases["deim", "angle_rad"]["steady_present"] == ""
    for name in names:
        assert_not_blank(tmp_path / f"{name}.png")
        assert "<svg" in (tmp_path / f"{name}.svg").read_text(encoding="utf-8")


def test_offline_cost_pays_after_so_many_runs(tmp_path: Path) -> None:
    """offline / (online of the reference - own online), rounded up; never when not faster."""
    def run(name: str, status: Status = Status.DONE, **cost: Any) -> RunResult:
        return write_run(tmp_path / name, status=status, cost=cost)

    reference = run("full", wall_s={"offline": 0.1, "online": 1.0})
    made = compare(
        reference=reference,
        quick=run("quick", wall_s={"offline": 2.5, "online": 0.2}),
        cached=run("cached", wall_s={"offline": 0.1, "online": 0.2}, offline_whole_s=1.7),
        slow=run("slow", wall_s={"offline": 0.1, "online": 1.2}),
        blown=run("blown", Status.DIVERGED, wall_s={"offline": 0.1, "online": 0.2}))
    assert made.pays_after == {"quick": 4, "cached": 3, "slow": None, "blown": None}
    head, _, _, *lines = str(made).splitlines()
    # two blanks between columns: "pays after" is one of them
    at = [c.strip() for c in head.split("  ") if c].index("pays after")
    lines = lines[:lines.index("")]  # another table follows
    cells = {c[0]: c for c in ([c.strip() for c in line.split("  ") if c] for line in lines)}
    assert [cells[r][at] for r in ("quick", "cached", "slow")] == ["4", "3", "-"]
    assert [cells[r][at - 1] for r in ("quick", "cached")] == ["2.5", "1.7"]
    runs = json.loads(made.to_json())["runs"]
    assert runs["cached"]["pays_after"] == 3 and runs["full"]["pays_after"] is None
    assert (runs["cached"]["offline_seconds"], runs["cached"]["offline_whole_seconds"]) == (.1, 1.7)
    made.write(tmp_path / "out", charts=False)
    with (tmp_path / "out" / "errors.csv").open(encoding="utf-8") as text:
        rows = {r["run"]: r for r in csv.DictReader(text)}
    assert (rows["quick"]["pays_after"], rows["slow"]["pays_after"]) == ("4", "")
    assert rows["cached"]["offline_whole_s"] == "1.7"


def test_charts_of_others_are_files_of_the_comparison(
    comparison: Comparison, distribute: Callable[..., None], tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Listed as ours, so that they are replaced when they are written again."""
    distribute("bars", {"charts": {"bars": "bars_of_errors:Bars"}}, bars_of_errors=BARS)
    monkeypatch.setattr("sparsemor.plugins.charts.write_charts", lambda *_: iter(()))
    assert [c.usual_files(["a"]) for c in installed_charts()][0] == ["bars.txt"]
    for _ in range(2):
        assert tmp_path / "out/bars.txt" in comparison.write(tmp_path / "out")
    (tmp_path / "out/bars.txt").write_text("of somebody else")
    with pytest.raises(InputError, match="not written by sparsemor"):
        comparison.write(tmp_path / "out")


BARS = """
class Bars:
    @staticmethod
    def usual_files(labels):
        return ["bars.txt"]

    @staticmethod
    def write_charts(comparison, folder):
        file = folder / "bars.txt"
        file.write_text(str(comparison.errors))
        yield file
"""


def assert_not_blank(picture: Path) -> None:
    from matplotlib.image import imread

    pixels = imread(picture)[::2, ::2, :3]
    inked = (pixels < 0.9).any(axis=2)
    assert 0.005 < inked.mean() < 0.6 and len(np.unique(pixels @ [1.0, 300.0, 9e4])) > 20


@pytest.mark.full
@pytest.mark.parametrize(("blocks", "expected"), [
    ((RIGID, PIN), {"angles"}),
    ((RIGID, ELASTIC), {"angles", "deformation"}),
    ((THERMAL,), {"temperature"}),
])
def test_only_pictures_that_make_sense(
    tmp_path: Path, blocks: tuple[Block, ...], expected: set[str]
) -> None:
    files = write_run_charts(write_run(tmp_path / "a", blocks), tmp_path / "p", formats=["png"])
    assert {f.stem for f in files} == expected
    same = compare(reference=open_result(tmp_path / "a"), twin=open_result(tmp_path / "a"))
    assert "error_over_time.png" not in {f.name for f in same.write(tmp_path / "q")}


def test_magnification_is_round(tmp_path: Path) -> None:
    run = write_run(tmp_path / "a")
    assert magnification(run, ["arm"], [40]) == 20.0  # |u| = 1.41 mm on 1 m, wanted 60 mm
    assert magnification(run, ["arm"], [0]) == 1.0
