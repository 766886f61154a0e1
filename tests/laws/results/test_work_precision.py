"""The work-precision chart: what it draws, and where."""

from dataclasses import replace
from functools import cache
from typing import Any

import pytest

from sparsemor.bodies.terms.field_kinds import BODY_KINDS
from sparsemor.core.status import Status
from sparsemor.plugins.charts.work_precision import WorkPoint, work_precision_figure

pytestmark = pytest.mark.full

FULL = WorkPoint("full", "", 0.8, {}, Status.DONE)
METHODS = {"galerkin": 0.04, "sparse": 0.055, "deim": 0.075, "gnat, Q-DEIM rows": 0.11}


def point(method: str, atoms: int, status: Status = Status.DONE) -> WorkPoint:
    ms = METHODS[method] * (1.0 + atoms / 50.0)
    error = 10.0 ** (-atoms / 5.0) * METHODS[method]
    return WorkPoint(method, f"{atoms} atoms", ms, {
        "angle_rad": 1e-2 * error, "rigid": error, "elastic": 30 * error, "thermal": error,
        "combined": 0.1 * error}, status, 1.0)


def grid() -> list[WorkPoint]:
    """Budgets out of order, and as text they would sort as 10, 20, 5; one run that diverged."""
    points = [point(m, atoms) for m in METHODS for atoms in (20, 5, 10, 40)]
    return [replace(p, status=Status.DIVERGED) if (p.method, p.budget) == ("deim", "5 atoms") else p
            for p in points]


@cache
def drawn() -> Any:
    """The picture of the grid, which no test changes."""
    return work_precision_figure(grid(), FULL, BODY_KINDS)


def panels(figure: Any) -> dict[str, Any]:
    return {a.get_title(loc="left"): a for a in figure.axes if a.get_visible()}


def curve(axes: Any, colour: str) -> Any:
    """The joined points of one colour: its only line with more than one point."""
    return next(line for line in axes.lines
                if line.get_color() == colour and len(line.get_xdata()) > 1)


def test_one_panel_a_field_and_one_line_a_method() -> None:
    figure = drawn()
    assert list(panels(figure)) == [
        "angle", "elastic displacement", "temperature", "all unknowns together"]
    axes = panels(figure)["temperature"]
    galerkin = curve(axes, "#0072B2")
    wanted = [point("galerkin", atoms) for atoms in (5, 10, 20, 40)]
    assert list(galerkin.get_xdata()) == [p.ms_per_step for p in wanted]
    assert list(galerkin.get_ydata()) == [p.errors["thermal"] for p in wanted]
    legend = [t.get_text() for t in figure.legends[0].get_texts()]
    assert legend == [f"{name}, offline 1 s" for name in METHODS]
    assert axes.get_xscale() == axes.get_yscale() == "log"


def test_speed_up_over_the_reference_is_the_axis_above() -> None:
    figure = drawn()
    figure.draw_without_rendering()
    for axes in panels(figure).values():
        above = axes.child_axes[0]
        assert above.get_xlabel() == "speed-up over full"
        for gain in (1.0, 5.0, 20.0):  # above 0.8, 0.16 and 0.04 ms
            here, there = (a.transData.transform((x, 1.0))[0]
                           for a, x in ((above, gain), (axes, 0.8 / gain)))
            assert here == pytest.approx(there, abs=1e-6)
        assert any(list(line.get_xdata()) == [0.8, 0.8] for line in axes.lines)
    rigid_copy = work_precision_figure(grid(), None, BODY_KINDS)
    assert rigid_copy is not None and not any(a.child_axes for a in rigid_copy.axes)


def test_stopped_runs_are_hollow_at_the_edge_and_named() -> None:
    figure = drawn()
    for axes in panels(figure).values():
        hollow = [line for line in axes.lines if line.get_markerfacecolor() == "white"]
        assert len(hollow) == 1
        assert list(hollow[0].get_ydata()) == [axes.get_ylim()[1]]
        assert list(hollow[0].get_xdata()) == [point("deim", 5).ms_per_step]
        assert len(curve(axes, "#009E73").get_xdata()) == 3  # the line leaves it out
    note = figure.get_supxlabel()
    assert note.splitlines() == [
        "hollow, stopped early: deim 5 atoms (diverged)", "crossed out: error above 0.1"]


def test_nothing_to_draw() -> None:
    assert work_precision_figure([], FULL, BODY_KINDS) is None
    timeless = replace(point("sparse", 5), ms_per_step=None)
    exact = replace(point("sparse", 5), errors={"thermal": 0.0})
    assert work_precision_figure([timeless], FULL, BODY_KINDS) is None
    assert work_precision_figure([exact], None, BODY_KINDS) is None
    rigid = replace(point("sparse", 5), errors={"rigid": 1e-3})
    only = work_precision_figure([rigid], None, BODY_KINDS)
    assert only is not None and list(panels(only)) == ["rigid motion"]


def test_names_with_dollar_signs_are_drawn_as_written() -> None:
    """An even number of them began a formula, whose fault came after the table was written."""
    odd = [replace(p, method=r"a $\frac{ b$", budget="$5$") for p in grid()[:2]]
    figure = work_precision_figure(odd, replace(FULL, method="$x$"), BODY_KINDS)
    figure.draw_without_rendering()
    shown = {t.get_text().replace(r"\$", "$") for a in figure.axes for t in a.texts}
    assert {"$x$ "} < shown
