"""Placement of labels next to points such that they overlap neither points nor each other."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.plugins.charts.style import SMALL

_NEAR = [(0, 5, "center", "bottom"), (0, -5, "center", "top"), (6, 0, "left", "center"),
         (-6, 0, "right", "center"), (5, 4, "left", "bottom"), (-5, 4, "right", "bottom"),
         (5, -4, "left", "top"), (-5, -4, "right", "top")]
_FAR = [(dx, dy, side, "center") for dy in (13, -13, 22, -22, 31, -31, 40, -40)
        for dx, side in ((9, "left"), (-9, "right"))]
_LEADER = {"arrowstyle": "-", "linewidth": 0.4, "shrinkA": 0.0, "shrinkB": 3.0}


def place_labels(
    axes: Any, texts: Sequence[tuple[float, float, str, str]], drop: bool = False,
    lines: Sequence[FloatArray] = (),
) -> None:
    """Places labels next to points, without overlap where possible.

    texts: (x, y, label, colour) in data coordinates; an empty label only keeps its point free.
    lines: (j, 2) vertices of polylines that labels avoid. The layout of the figure must be final.

    Positions around each point are tried, the farther ones with a leader line, and the first free
    one inside the axes is taken; if none is free, the one with the least overlap, or with `drop`
    none.
    """
    from matplotlib.text import Text

    renderer = axes.figure.canvas.get_renderer()
    frame = axes.get_window_extent(renderer).extents[None]
    radius = 0.055 * axes.figure.dpi
    centres = [axes.transData.transform((x, y)) for x, y, _, _ in texts]
    taken = _squares(np.array(centres).reshape(-1, 2), radius)
    for line in lines:
        along = _along(axes.transData.transform(line), 0.5 * radius)
        taken = np.concatenate([taken, _squares(along, 0.3 * radius)])
    for x, y, label, colour in (t for t in texts if t[2]):
        best: tuple[float, Any, Any] | None = None
        for place in _NEAR + (_FAR[:8] if drop else _FAR):
            dx, dy, ha, va = place
            end = (0.0, 0.5) if ha == "left" else (1.0, 0.5)
            leader = _LEADER | {"color": colour, "relpos": end} if place in _FAR else None
            text = axes.annotate(label, (x, y), (dx, dy), textcoords="offset points", ha=ha, va=va,
                                 fontsize=SMALL, color=colour, annotation_clip=False,
                                 arrowprops=leader)
            text.set_in_layout(False)
            text.update_positions(renderer)
            box = Text.get_window_extent(text, renderer)  # of the words, not of the leader
            cost = float(_overlap(box, taken).sum())
            cost += 3.0 * (box.width * box.height - float(_overlap(box, frame)[0]))
            if best is None or cost < best[0]:
                if best is not None:
                    best[1].remove()
                best = (cost, text, box)
            else:
                text.remove()
            if cost < 1e-6:
                break
        if best is not None and drop and best[0] >= 1e-6:
            best[1].remove()
        elif best is not None:
            taken = np.concatenate([taken, [best[2].extents]])


def _along(corners: FloatArray, spacing: float) -> FloatArray:
    """(m, 2) points on a polyline, in pixels, at most `spacing` apart."""
    parts = [np.linspace(a, b, 2 + int(np.hypot(*(b - a)) / spacing))
             for a, b in zip(corners[:-1], corners[1:], strict=True)]
    return np.concatenate([np.zeros((0, 2)), *parts])


def _squares(centres: FloatArray, half: float) -> FloatArray:
    """(m, 4) squares x0, y0, x1, y1 around centres (m, 2), in pixels."""
    return np.hstack([centres - half, centres + half])


def _overlap(box: Any, others: FloatArray) -> FloatArray:
    """(m,) areas of the intersections of a box with other boxes (m, 4), in square pixels."""
    width = np.minimum(box.x1, others[:, 2]) - np.maximum(box.x0, others[:, 0])
    height = np.minimum(box.y1, others[:, 3]) - np.maximum(box.y0, others[:, 1])
    return np.asarray(np.maximum(0.0, width) * np.maximum(0.0, height))
