"""Names beside points, placed so that they cover neither points nor each other."""

from collections.abc import Sequence
from typing import Any

from sparsemor.core.charts.style import SMALL

_NEAR = [(0, 5, "center", "bottom"), (0, -5, "center", "top"), (6, 0, "left", "center"),
         (-6, 0, "right", "center"), (5, 4, "left", "bottom"), (-5, 4, "right", "bottom"),
         (5, -4, "left", "top"), (-5, -4, "right", "top")]
_FAR = [(dx, dy, side, "center") for dy in (13, -13, 22, -22, 31, -31, 40, -40)
        for dx, side in ((9, "left"), (-9, "right"))]
_LEADER = {"arrowstyle": "-", "linewidth": 0.4, "shrinkA": 0.0, "shrinkB": 3.0}


def place_labels(axes: Any, texts: Sequence[tuple[float, float, str, str]]) -> None:
    """texts: (x, y, label, colour) in data coordinates. Needs a figure whose layout stands.

    Tries places around each point, the farther ones with a leader line, and takes the first free
    one inside the axes; if none is free, the one with the least overlap.
    """
    from matplotlib.text import Text
    from matplotlib.transforms import Bbox

    renderer = axes.figure.canvas.get_renderer()
    frame = axes.get_window_extent(renderer)
    radius = 0.055 * axes.figure.dpi
    centres = [axes.transData.transform((x, y)) for x, y, _, _ in texts]
    taken = [Bbox.from_extents(cx - radius, cy - radius, cx + radius, cy + radius)
             for cx, cy in centres]
    for x, y, label, colour in texts:
        best: tuple[float, Any, Any] | None = None
        for place in _NEAR + _FAR:
            dx, dy, ha, va = place
            end = (0.0, 0.5) if ha == "left" else (1.0, 0.5)
            leader = _LEADER | {"color": colour, "relpos": end} if place in _FAR else None
            text = axes.annotate(label, (x, y), (dx, dy), textcoords="offset points", ha=ha, va=va,
                                 fontsize=SMALL, color=colour, annotation_clip=False,
                                 arrowprops=leader)
            text.set_in_layout(False)
            text.update_positions(renderer)
            box = Text.get_window_extent(text, renderer)  # of the words, not of the leader
            cost = sum(_overlap(box, other) for other in taken)
            cost += 3.0 * (box.width * box.height - _overlap(box, frame))
            if best is None or cost < best[0]:
                if best is not None:
                    best[1].remove()
                best = (cost, text, box)
            else:
                text.remove()
            if cost < 1e-6:
                break
        if best is not None:
            taken.append(best[2])


def _overlap(a: Any, b: Any) -> float:
    width = min(a.x1, b.x1) - max(a.x0, b.x0)
    height = min(a.y1, b.y1) - max(a.y0, b.y0)
    return float(max(0.0, width) * max(0.0, height))
