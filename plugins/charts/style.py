"""Style of all charts: colours, line styles, sizes, units. No global matplotlib setting is
changed."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from sparsemor.core.arrays import FloatArray
from sparsemor.core.status import Status
from sparsemor.plugins.publishing.listed_files import publishing

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMN, PAGE = 3.5, 7.2
"""Widths of a figure, inches: one column, and the full page."""
SMALL, NORMAL = 7.0, 8.0
"""Font sizes, points."""
SCREEN = 100
"""Pixels per inch of figures in notebooks, which get twice as many for fine screens."""
LINE = 0.17
"""Height of a line of small text, inches."""
REFERENCE_COLOUR = "#b0b0b0"
TRACE = "#d0d0d0"
LIMIT_COLOUR = "#8b0000"
"""Colour of errors above a limit."""

# Okabe and Ito's set without its yellow, which is lost on white paper.
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
_DASHES: tuple[Any, ...] = (
    "-", (0, (5, 1.5)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)), (0, (3, 1, 1, 1, 1, 1)),
    (0, (8, 3)))
_MARKERS = ("o", "s", "^", "D", "v", "P")


@dataclass(frozen=True, slots=True)
class LineStyle:
    """Line style of one run in all charts; dashes and markers distinguish runs in black-and-white
    print."""

    colour: str
    dash: Any
    marker: str


def style_of(number: int) -> LineStyle:
    """Line style of run `number`; repetitions of a colour have other dashes."""
    turn = number // len(_COLOURS)
    return LineStyle(_COLOURS[number % len(_COLOURS)], _DASHES[(number + turn) % len(_DASHES)],
        _MARKERS[(number + turn) % len(_MARKERS)])


def dash_of(number: int) -> Any:
    """Dashes of run `number`, for lines whose colour has another meaning."""
    return _DASHES[number % len(_DASHES)]


def plain(text: str) -> str:
    """Text with escaped dollar signs, so that matplotlib does not interpret it as a formula."""
    return text.replace("$", r"\$")


def label_of(name: str, status: Status) -> str:
    """Name of the run, followed by its status if it did not end successfully."""
    name = plain(name)
    return name if status.ok else f"{name} ({status.value.replace('_', ' ')})"


@cache
def _figure_class() -> "type[Figure]":
    """Class of figures that notebooks show, without pyplot and magic commands."""
    from matplotlib.figure import Figure

    class ChartFigure(Figure):
        def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
            picture = BytesIO()
            self.savefig(picture, format="png", dpi=2 * SCREEN)
            width, height = SCREEN * self.get_size_inches()
            return picture.getvalue(), {"width": round(width), "height": round(height)}

    return ChartFigure


def new_figure(width: float, height: float) -> "Figure":
    """Empty figure with its own Agg canvas and constrained layout; width and height in inches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = _figure_class()(
        figsize=(width, height), layout="constrained", dpi=200, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


class AxisUnit(NamedTuple):
    """Unit `name` for the label of an axis: a value in SI units times `factor` is the value in this
    unit."""

    factor: float
    name: str


_SMALL = ((1e9, "n"), (1e6, "µ"), (1e3, "m"), (1.0, ""))
_LARGE = ((1e-3, "k"), (1e-6, "M"), (1e-9, "G"))
_ONLY_SMALL = ("s", "m", "rad")
"""Units without prefixes for large values: no kiloseconds or megametres."""


def unit(largest: float, si: str) -> AxisUnit:
    """Unit with the prefix for which `largest` (SI unit `si`, either sign) is between 0.5 and
    500."""
    sizes = _SMALL if si in _ONLY_SMALL else _SMALL + _LARGE
    if largest == 0.0:
        return AxisUnit(1.0, si)
    factor, prefix = next((s for s in sizes if abs(largest) * s[0] < 500.0), sizes[-1])
    return AxisUnit(factor, prefix + si)


def tidy(axes: "Axes", xlabel: str = "", ylabel: str = "", title: str = "") -> None:
    """Formats axes: labels and title, light grid, no frame at the top and right."""
    axes.set_xlabel(xlabel, fontsize=NORMAL)
    axes.set_ylabel(ylabel, fontsize=NORMAL)
    if title:
        axes.set_title(title, fontsize=NORMAL, loc="left")
    axes.tick_params(labelsize=SMALL, width=0.6, length=3)
    axes.grid(True, color="#e6e6e6", linewidth=0.5)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for spine in axes.spines.values():
        spine.set_linewidth(0.6)


def time_panels(
    labels: Sequence[tuple[str, str]], end: float, height: float, above: float = 0.55
) -> "tuple[Figure, list[Axes], AxisUnit]":
    """Panels above each other with a common time axis up to `end` (s): figure, panels, unit of
    time.

    labels: (label of the vertical axis, title) of each panel; height: of a panel, above: of the
    space above the panels, inches.
    """
    clock, count = unit(end, "s"), len(labels)
    figure = new_figure(COLUMN, above + height * count)
    panels = list(figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0])
    for axes, (label, title) in zip(panels, labels, strict=True):
        tidy(axes, f"time ({clock.name})" if axes is panels[-1] else "", label, title)
        axes.ticklabel_format(axis="y", useOffset=False)  # full numbers, no differences from one
    return figure, panels, clock


@dataclass(frozen=True, slots=True, eq=False)
class LinePanel:
    """Panel of lines over time. what, si: quantity and SI unit of the vertical axis; lines: name ->
    times (j,), s, and values (j,)."""

    what: str
    si: str
    title: str
    lines: Mapping[str, tuple[FloatArray, FloatArray]]


def lines_figure(
    panels: Sequence[LinePanel], order: Sequence[str], height: float
) -> "Figure | None":
    """Panels of lines over time from the start of the run, each in its own unit, with one legend;
    None without steps. order: names of the lines, in that of the legend; height: of a panel,
    inches."""
    ends = [float(times[-1]) for p in panels for times, _ in p.lines.values() if len(times)]
    if max(ends, default=0.0) <= 0.0:
        return None
    order, end = list(dict.fromkeys(order)), max(ends)
    scales = [unit(max((float(abs(v).max()) for _, v in p.lines.values()), default=0.0), p.si)
              for p in panels]
    figure, axes, clock = time_panels(
        [(f"{p.what} ({scale.name})", p.title) for p, scale in zip(panels, scales, strict=True)],
        end, height)
    for panel, scale, ax in zip(panels, scales, axes, strict=True):
        for name, (times, values) in panel.lines.items():
            draw_line(ax, clock.factor * times, scale.factor * values, order.index(name), name)
        ax.set_xlim(0.0, clock.factor * end)
    legend_above(figure, handles_of(axes, order))
    return figure


def draw_line(
    axes: "Axes", x: FloatArray, y: FloatArray, number: int, label: str = ""
) -> None:
    """A thin line in the style of run `number`."""
    style = style_of(number)
    axes.plot(x, y, color=style.colour, linestyle=style.dash, linewidth=1.1, label=label)


def handles_of(panels: "Iterable[Axes]", labels: Iterable[str]) -> "list[Artist]":
    """Legend handles of the lines with these labels, in this order, each once."""
    found = {h.get_label(): h for axes in panels for h in axes.get_legend_handles_labels()[0]}
    return [found[label] for label in labels if label in found]


def legend_above(figure: "Figure", handles: "Sequence[Artist]", columns: int = 3) -> None:
    """Draws one legend for all panels above them, so that it never covers data."""
    figure.legend(
        handles=handles, loc="outside upper left", ncols=min(columns, len(handles)),
        fontsize=SMALL, frameon=False, handlelength=3.2, columnspacing=1.2, borderaxespad=0.2)


def save(figure: "Figure", folder: Path, name: str, formats: Iterable[str]) -> list[Path]:
    """Writes the figure as name.png, name.svg, ..; returns the paths."""
    files, layout = [], figure.get_layout_engine()
    for kind in formats:
        file = folder / f"{name}.{kind}"
        metadata = {"Date": None} if kind == "svg" else None  # the same run, the same file
        figure.savefig(file, format=kind, dpi=300, metadata=metadata)
        figure.set_layout_engine("none")  # all formats have the layout of the first one
        files.append(file)
    figure.set_layout_engine(layout)
    return files


def saved(figure: "Figure", folder: Path, name: str, formats: Iterable[str]) -> list[Path]:
    """Writes the figure as `save`, atomically, and lists its files as ours; returns their paths.
    Raises InputError instead of replacing a file that is not ours."""
    with publishing(folder) as fresh:
        files = save(figure, fresh, name, formats)
    return [folder / file.name for file in files]
