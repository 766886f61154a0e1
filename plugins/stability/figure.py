"""Stability map: variants of a reduced model against random seeds, coloured by the excess
growth."""

from typing import TYPE_CHECKING, Any

import numpy as np

from sparsemor.plugins.charts.style import PAGE, SMALL, new_figure, tidy
from sparsemor.plugins.stability.stability_check import LIMIT

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sparsemor.plugins.stability.survey import Survey

TOP = 3.0
"""Upper end of the colour scale: log10 of (excess spectral radius) x (number of steps)."""
_PANEL = ("sampler", "required", "integrator")
_LINE = ("rows", "atoms", "step")


def stability_figure(found: "Survey") -> "Figure":
    """Stability map of a survey.

    One panel per sampler, treatment of required rows (always sampled or not) and integrator; in it
    one row per combination of numbers of sampled rows and basis vectors and time step, and one
    column per seed. Stable cells are pale, unstable ones the darker the faster they grow; a cross
    marks a model whose time step fails.
    """
    from matplotlib.colors import LinearSegmentedColormap, TwoSlopeNorm

    panels: dict[tuple[str, ...], list[Any]] = {}
    for e in found.entries:
        panels.setdefault(tuple(e.settings[k] for k in _PANEL), []).append(e)
    varied = [k for k in _LINE if len({e.settings[k] for e in found.entries}) > 1] or ["rows"]
    heights = [len(entries) for entries in panels.values()]
    figure = new_figure(PAGE, 0.6 + sum(0.45 + 0.17 * n for n in heights))
    axes_of = figure.subplots(len(panels), 1, squeeze=False, height_ratios=[
        n + 2 for n in heights])[:, 0]
    # the hue changes at the limit, not about it
    colours = LinearSegmentedColormap.from_list("gate", [
        (0.0, "#eef4f9"), (0.5, "#8fbcd9"), (0.5, "#f3b183"), (0.75, "#D55E00"), (1.0, "#5a1e00")])
    norm = TwoSlopeNorm(np.log10(LIMIT), -1.0, TOP)
    image = None
    for axes, (name, entries) in zip(axes_of, panels.items(), strict=True):
        gates = np.array([[f.judgement.gate for f in e.findings] for e in entries])
        shown = np.log10(np.clip(gates, 0.1, 10.0**TOP))
        image = axes.imshow(shown, aspect="auto", cmap=colours, norm=norm,
                            interpolation="nearest")
        broken = np.argwhere(~np.isfinite(gates))
        edges = np.arange(1, gates.shape[1]) - 0.5, np.arange(1, len(entries)) - 0.5
        axes.vlines(edges[0], -0.5, len(entries) - 0.5, color="white", linewidth=0.5)
        axes.hlines(edges[1], -0.5, gates.shape[1] - 0.5, color="white", linewidth=0.5)
        axes.plot(broken[:, 1], broken[:, 0], "x", color="white", markersize=3.5)
        title = ", ".join(part for part in _words(name) if part != "-")
        tidy(axes, title=title)
        axes.grid(False)
        labels = [f"{', '.join(e.settings[k] for k in varied)}: {e.stable}/{len(e.findings)}"
                  for e in entries]
        axes.set_yticks(range(len(entries)), labels, fontsize=SMALL)
        every = max(1, gates.shape[1] // 15)
        seeds = range(0, gates.shape[1], every)
        axes.set_xticks(seeds, [str(s + 1) for s in seeds], fontsize=SMALL)
    axes_of[-1].set_xlabel(f"seed  (lines: {', '.join(varied)}: stable of all)", fontsize=SMALL)
    if image is not None:
        ticks = [-1.0, np.log10(LIMIT), 2.0, TOP]
        bar = figure.colorbar(image, ax=list(axes_of), ticks=ticks, shrink=0.9, pad=0.01)
        bar.ax.set_yticklabels(["0.1", f"{LIMIT:g}", "100", f"{10**TOP:g}"], fontsize=SMALL)
        bar.set_label("(excess radius) x steps", fontsize=SMALL)
    return figure


def _words(name: tuple[str, ...]) -> tuple[str, ...]:
    sampler, required, integrator = name
    return sampler, f"required rows {required}" if required != "-" else "-", integrator
