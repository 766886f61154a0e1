"""Chart of the active basis vectors (atoms) over time (as Figs. 6, 13 and 21 of the paper)."""

from typing import TYPE_CHECKING

import numpy as np

from sparsemor.core.results.run_result import RunResult
from sparsemor.plugins.charts.style import COLUMN, NORMAL, new_figure, plain, style_of, tidy, unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST_COLUMNS = 120


def active_atoms_figure(run: RunResult, name: str) -> "Figure | None":
    """Chart with one panel per reduced block and a dot for each active basis vector (atom) at each
    time.

    None for runs without row sampling or selection of basis vectors. Of long runs every m-th stored
    step is drawn, as the title states.
    """
    # of blocks with coefficients: those with sampled rows or a selection of atoms
    blocks = [b for b in run.layout if b.name in run.solver_layout and run.reduced(b.name)]
    blocks = [b for b in blocks if run.rows(b.name).size or not run.support(b.name).all()]
    if not blocks or len(run.times) == 0:
        return None
    every = max(1, -(-len(run.times) // _MOST_COLUMNS))
    times, clock = run.times, unit(float(run.times[-1]), "s")
    columns = 2 if len(blocks) > 2 else 1
    rows = -(-len(blocks) // columns)
    figure = new_figure(COLUMN * (2 if columns == 2 else 1), 0.5 + 1.75 * rows)
    panels = figure.subplots(rows, columns, sharex=True, squeeze=False).ravel()
    for axes in panels[len(blocks):]:
        axes.set_visible(False)
    for number, (b, axes) in enumerate(zip(blocks, panels, strict=False)):
        active = run.support(b.name)[::every]
        step, atom = np.nonzero(active)
        axes.scatter(clock.factor * times[::every][step], atom + 1, s=1.6, marker="o", linewidths=0,
                     color=style_of(0).colour, rasterized=step.size > 5000)
        low = number + columns >= len(blocks)
        tidy(axes, f"time ({clock.name})" if low else "", "atom", _title(run, b.name))
        axes.tick_params(labelbottom=True)
        axes.set_xlim(clock.factor * times[0], clock.factor * times[-1])
        highest = int(np.flatnonzero(active.any(axis=0)).max(initial=0)) + 1
        axes.set_ylim(0, 1.04 * highest + 1)
        axes.yaxis.get_major_locator().set_params(integer=True)
    thinned = f", one of {every} stored steps" if every > 1 else ""
    figure.suptitle(f"{plain(name)}: atoms in use{thinned}", fontsize=NORMAL, x=0.01, ha="left")
    return figure


def _title(run: RunResult, block: str) -> str:
    active = run.support(block)
    return f"{block}: {active.sum(axis=1).mean():.0f} of {active.shape[1]} at a time"
