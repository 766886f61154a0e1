"""The chart of `scaling.py`: time of a step and memory over the unknowns, both logarithmic."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sparsemor.plugins.charts.style import (
    PAGE,
    SMALL,
    legend_above,
    new_figure,
    save,
    style_of,
    tidy,
)

TITLES = {"both": "displacements and heat", "heat": "heat alone"}
QUANTITIES = {"least": "CPU ms a step", "peak": "largest memory, GB"}


def chart(rows: Sequence[Mapping[str, Any]], file: Path) -> None:
    """One column of panels for each choice of fields; slopes of the fitted lines are written at
    their ends."""
    rows = [r for r in rows if r["ms"] is not None]
    fields = [f for f in TITLES if any(r["fields"] == f for r in rows)]
    if not fields:
        return
    from matplotlib.ticker import NullFormatter

    names = list(dict.fromkeys(r["method"] for r in rows))
    figure = new_figure(PAGE, 5.2)
    panels = figure.subplots(len(QUANTITIES), len(fields), squeeze=False, sharex="col")
    handles: dict[str, Any] = {}
    for line, (key, label) in zip(panels, QUANTITIES.items(), strict=True):
        for axes, name in zip(line, fields, strict=True):
            for number, method in enumerate(names):
                one = [r for r in rows if (r["fields"], r["method"]) == (name, method)]
                if one:
                    handles[method] = _drawn(axes, one, key, number, method)
            last = key == "peak"
            tidy(axes, "unknowns of full order" if last else "", label,
                 "" if last else TITLES[name])
            axes.set_xscale("log")
            axes.set_yscale("log")
            axes.margins(x=0.18)
            for axis in (axes.xaxis, axes.yaxis):
                axis.set_minor_formatter(NullFormatter())
    legend_above(figure, list(handles.values()), columns=4)
    file.parent.mkdir(parents=True, exist_ok=True)
    save(figure, file.parent, file.stem, [file.suffix.lstrip(".") or "png"])


def _drawn(
    axes: Any, rows: Sequence[Mapping[str, Any]], key: str, number: int, method: str
) -> Any:
    look = style_of(number)
    x, y = np.array([r["unknowns"] for r in rows]), np.array([r[key] for r in rows])
    (handle,) = axes.plot(x, y, color=look.colour, linestyle=look.dash, marker=look.marker,
                          markersize=3.5, linewidth=1.1, label=method)
    if len(x) > 1 and key == "least":
        slope = np.polyfit(np.log(x), np.log(y), 1)[0]
        if method.startswith("full"):  # the reduced ones lie on each other: the table has them
            axes.annotate(f"{slope:.2f}", (x[-1], y[-1]), (4, -2), textcoords="offset points",
                          fontsize=SMALL, color=look.colour)
    return handle
