"""Charts, tables and labelled arrays of results. Charts are drawn by the entry point `charts` of
the group `sparsemor.charts`."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from sparsemor.core.registry.registry import Registry
from sparsemor.core.results.files.temporary_folders import NAME as TEMPORARY
from sparsemor.core.scene.html import html_table

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

CHARTS = "charts"
"""Group of the entry points of charts, and the name of the one that draws single charts."""


class Drawn:
    """Base of what charts show: runs and comparisons."""

    __slots__ = ()

    def plot(self, chart: str | None = None, times: Sequence[float] | None = None) -> "Figure":
        """Chart by its name, a figure that notebooks show (`sparsemor.plot`). times: at which
        fields are drawn, s. InputError for another name and where there are no data."""
        made: Figure = drawing().figure_of(self, chart, times)
        return made


def drawing() -> Any:
    """What draws single charts and animations."""
    return Registry().load(CHARTS, CHARTS)


def html_of(run: Any) -> str:
    """Main facts of a run as a table."""
    times, folder = run.times, "" if run.in_memory else run.path.parent.name
    rows = [["run", "temporary" if TEMPORARY.fullmatch(folder) else folder or "in memory"],
            ["status", run.status.value], ["reducer", run.reducer],
            ["stored", f"{len(times)} steps" + (f" to {times[-1]:g} s" if len(times) else "")],
            ["blocks", ", ".join(f"{b.name} ({b.size})" for b in run.layout)],
            ["bodies with a mesh", ", ".join(run.bodies) or "none"],
            ["probes", ", ".join(run.probes) or "none"],
            *(["warning", note] for note in run.summary.get("notes", ()))]
    return html_table(rows)


def history_of(run: Any, name: str) -> "xr.DataArray":
    """Array over time of a result, its last dimension called `component`, `unknown` or `atom`."""
    stored = run.to_xarray()
    import xarray as xr

    for key in (name, f"probe.{name}", f"{name}.multiplier", f"force.{name}"):
        if key in stored and stored[key].dims[0] == "time":
            found: xr.DataArray = stored[key]
            return found.rename({d: str(d).rpartition(".")[2] for d in found.dims if d != "time"})
    return xr.DataArray(run.block(name), {"time": run.times}, ("time", "unknown"), name=name)
