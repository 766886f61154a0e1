"""Runs with different unknowns are compared by what they share, and fields of reduced runs are
drawn next to those of the reference."""

from pathlib import Path

import numpy as np
import pytest

from small_scenes import tiny
from sparsemor import compare, simulate
from sparsemor.core.protocols.layout import Quantity
from sparsemor.core.results.run_result import RunResult
from sparsemor.plugins.charts.planar_fields import deformation_figure
from sparsemor.plugins.charts.time_histories import probe_temperature_figure

pytestmark = pytest.mark.full
TIP = {"tip": {"body": "bar", "at": [0.5, 0.05]}}


@pytest.fixture(scope="module")
def heated() -> RunResult:
    return simulate(tiny().using({"reducer": "full", "probes": TIP}))


@pytest.fixture(scope="module")
def cold() -> RunResult:
    """The same bar without heat and temperatures."""
    return simulate(tiny().using({
        "reducer": "full", "loads.heating": None, "bodies.bar.fields": ["elastic"],
        "probes": TIP, "time.end": 0.03}))


@pytest.fixture(scope="module")
def reduced() -> RunResult:
    return simulate(tiny().using({
        "reducer": {"use": "galerkin", "basis": {"use": "pod", "count": 4}}, "probes": TIP}))


def test_unheated_and_heated_runs_are_compared_by_what_they_share(
    heated: RunResult, cold: RunResult, tmp_path: Path
) -> None:
    done = compare(heated, cold=cold)
    assert "only one run has them" in done.notes["cold"]
    assert "bar.thermal" in done.notes["cold"] and "0.03 s of 0.04" in done.notes["cold"]
    assert set(done.errors["cold"]) >= {"combined", "elastic", "angle_rad"}
    assert done.errors["cold"]["elastic"] > 0.1  # the heat bends the bar
    names = {path.stem for path in done.write(tmp_path)}
    assert {"deformation", "temperature", "angles", "probe_temperature"} <= names


def test_planar_fields_of_all_runs_have_the_reference_s_colours(
    heated: RunResult, cold: RunResult, reduced: RunResult
) -> None:
    others = {"few": reduced, "cold": cold}
    figure = deformation_figure(heated, Quantity.DISPLACEMENT, [0.02, 0.04], others, "whole")
    assert figure is not None
    *panels, bar = figure.axes
    titles = [a.get_title(loc="left") for a in panels]
    assert [t.split("\n")[0] for t in titles] == ["whole", "whole", "few", "few", "cold", "cold"]
    top = max(np.linalg.norm(heated.nodal_displacement("bar", k), axis=1).max() for k in (20, 40))
    assert bar.get_ylim() == (0.0, pytest.approx(1e6 * top))
    largest = 1e6 * np.linalg.norm(cold.nodal_displacement("bar", 20), axis=1).max()
    assert f"max {largest:.4g} µm" in titles[4]
    assert "stopped at 0.03 s" in titles[5] and not panels[5].collections
    assert all(a.collections for a in panels[:5])
    heat = deformation_figure(heated, Quantity.TEMPERATURE, [0.02], others, "whole")
    assert heat is not None and "max" not in heat.axes[2].get_title(loc="left")


def test_probes_of_other_runs_are_thin_lines_over_the_reference(
    heated: RunResult, cold: RunResult, reduced: RunResult
) -> None:
    figure = probe_temperature_figure(heated, {"few": reduced, "cold": cold}, "whole")
    assert figure is not None
    wide, thin = figure.axes[0].lines  # the cold bar has no temperature
    assert wide.get_linewidth() > 3 * thin.get_linewidth()
    assert np.allclose(np.asarray(wide.get_ydata()), np.asarray(thin.get_ydata()), atol=1e-2)
    labels = [t.get_text() for t in figure.legends[0].get_texts()]
    assert labels == ["tip", "wide: whole", "few", "cold"]
