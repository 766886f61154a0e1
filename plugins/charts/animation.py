"""Animation of a run: the moving bodies in space, coloured by a field, as GIF or MP4."""

import shutil
from base64 import b64encode
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.errors import InputError
from sparsemor.core.protocols.layout import Quantity
from sparsemor.core.results.files.written_files import require_ours
from sparsemor.core.results.result_variables import FIELDS, Field
from sparsemor.core.results.run_result import RunResult
from sparsemor.plugins.charts.fields import (
    MAPS,
    field_mesh,
    magnification,
    scale_of,
    shades,
    values_of,
)
from sparsemor.plugins.charts.style import NORMAL, SMALL, new_figure, tidy, unit
from sparsemor.plugins.charts.view_in_space import VIEWS, BodySurface, paint
from sparsemor.plugins.publishing.listed_files import publishing

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FORMATS = (".gif", ".mp4")
RATE = 25
"""Frames per second."""
GREY = "#606060"
Report = Callable[[int, int], None]
"""Called after each frame with its number and the number of all."""


def animate(
    run: RunResult, file: str | Path, field: str = "displacement", *, frames: int = 100,
    at: Sequence[float] | None = None, magnify: float | None = None, report: Report | None = None,
) -> Path:
    """Writes an animation of all bodies as `file`, a .gif, or a .mp4 where ffmpeg is installed.

    field: displacement, temperature, stress or strain; frames: number of stored steps, evenly
    spread over the run; at: instead, times in s, from the first to the last of which it goes;
    magnify: factor of the displacements (default: a round one for which they are visible). Rigid
    bodies without a mesh are drawn by their named points. InputError for a format, field or time
    that does not exist, and for a file that is not an animation of ours.
    """
    path = Path(file)
    _writer(path)  # a format that cannot be written
    require_ours(path.parent, [path.name])
    beside = run.in_memory or run.path.parent != path.parent.absolute()
    # alone: listed in the folder as a file that belongs to no result
    with publishing(path.parent, alone=beside) as fresh:
        _write(run, fresh / path.name, field, frames, at, magnify, report)
    return path


def _write(
    run: RunResult, file: Path, field: str, frames: int, at: Sequence[float] | None,
    magnify: float | None, report: Report | None,
) -> None:
    """Draws the frames and writes them to the file; arguments as of `animate`."""
    if field not in FIELDS:
        raise InputError(f"no field is called {field!r}: give one of {', '.join(FIELDS)}", "field")
    if frames < 2:
        raise InputError(f"give at least 2 (got {frames})", "frames")
    steps = _steps(run, frames, at)
    scene = _Stage.from_run(run, steps, FIELDS[field], magnify)
    figure = new_figure(7.2, 7.2 * min(max(scene.slope, 0.35), 1.2) + 0.5)
    axes, bar = figure.subplots(), None
    writer = _writer(file)
    with writer.saving(figure, str(file), 100):
        for number, step in enumerate(steps, 1):
            axes.clear()
            scene.draw(axes, step)
            if bar is None and scene.label:
                bar = figure.colorbar(scene.colours, ax=axes, shrink=0.8, pad=0.02, aspect=30)
                bar.set_label(scene.label, fontsize=NORMAL)
                bar.ax.tick_params(labelsize=SMALL)
            writer.grab_frame()
            if report is not None:
                report(number, len(steps))


def _writer(path: Path) -> Any:
    from matplotlib.animation import FFMpegWriter, PillowWriter

    if path.suffix not in FORMATS:
        raise InputError(f"the file ends with {' or '.join(FORMATS)} (got {path.name!r})", "out")
    if path.suffix == ".gif":
        return PillowWriter(fps=RATE)
    if shutil.which("ffmpeg") is None:
        raise InputError("mp4 needs the program ffmpeg, which is not installed: write a .gif",
                         "out")
    return FFMpegWriter(fps=RATE)


def _steps(run: RunResult, frames: int, at: Sequence[float] | None) -> list[int]:
    found = run.steps_at(at)
    first, last = int(found[0]), int(found[-1])
    count = min(frames, last - first + 1)
    return [int(i) for i in np.unique(np.linspace(first, last, count).round())]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Animation:
    """Animation in memory: the bytes of a GIF, which notebooks show."""

    gif: bytes

    def save(self, file: str | Path) -> Path:
        """Writes the GIF."""
        Path(file).write_bytes(self.gif)
        return Path(file)

    def _repr_html_(self) -> str:
        return f'<img alt="animation" src="data:image/gif;base64,{b64encode(self.gif).decode()}">'


def animation_of(
    run: RunResult, field: str = "displacement", *, frames: int = 50,
    at: Sequence[float] | None = None, magnify: float | None = None,
) -> Animation:
    """Animation of all bodies, in memory; arguments as of `animate`."""
    with TemporaryDirectory() as folder:
        file = Path(folder, "animation.gif")
        _write(run, file, field, frames, at, magnify, None)
        return Animation(file.read_bytes())


@dataclass(frozen=True, slots=True, eq=False)
class _Stage:
    """Drawing of all frames of an animation: outer facets of bodies with a mesh, points of the
    others, magnification of displacements, colours (label "" where no body has the field), and the
    box in which the bodies move, in the coordinates of the drawing."""

    run: RunResult
    field: Field
    meshes: Mapping[str, tuple[IntArray, IntArray, IntArray]]
    points: Mapping[str, FloatArray]
    solid: bool
    factor: float
    scale: float
    label: str
    limits: tuple[float, float]
    box: FloatArray

    @classmethod
    def from_run(
        cls, run: RunResult, steps: Sequence[int], field: Field, magnify: float | None
    ) -> "_Stage":
        """What is drawn of a run: magnification, colour limits and box are those of all frames.
        factor: magnification; scale: from the SI unit of the field to that of the colour bar."""
        meshes = {b: field_mesh(run, b, field) for b in run.bodies}
        points = _rigid_points(run)
        sizes = {a.shape[1] for a in (*(run.points(b) for b in meshes), *points.values())}
        if not sizes:
            raise InputError("no body of this run has a mesh or named points: nothing to draw")
        colours = [b for b in meshes if run.has(b, field)]
        factor = magnification(run, list(meshes), steps) if magnify is None else magnify
        scale, label = scale_of(run, colours, steps, field) if colours else (1.0, "")
        values = [v * scale for s in steps for b in colours
                  if (v := values_of(run, b, s, field)) is not None]
        limits = shades(np.concatenate(values), field) if values else (0.0, 1.0)
        # first without the box, which is that of all drawn points
        made = cls(run, field, meshes, points, sizes == {3}, factor, scale, label, limits,
                   np.zeros((2, 2)))
        places = np.concatenate([p[:, :2] for s in steps for p in made.places(s).values()])
        low, high = places.min(axis=0), places.max(axis=0)
        margin = 0.05 * float((high - low).max()) or 0.1
        return cls(run, field, meshes, points, made.solid, factor, scale, label, limits,
                   np.stack([low - margin, high + margin]))

    @property
    def slope(self) -> float:
        """Ratio of height to width of the box."""
        width, height = self.box[1] - self.box[0]
        return float(height / width)

    @property
    def colours(self) -> Any:
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import Normalize

        return ScalarMappable(Normalize(*self.limits), MAPS[self.field])

    def places(self, step: int) -> dict[str, FloatArray]:
        """Body -> positions of its nodes or points in the coordinates of the drawing, m."""
        found = {b: self.run.positions(b, step, self.factor)[nodes]
                 for b, (nodes, _, _) in self.meshes.items()}
        found |= {b: self.run.in_space(b, step, z) for b, z in self.points.items()}
        return {b: VIEWS[0].rotated(p) for b, p in found.items()} if self.solid else found

    def draw(self, axes: "Axes", step: int) -> None:
        """Draws the bodies at one stored step."""
        places, clock = self.places(step), unit(float(self.run.times[-1]), "s")
        title = f"t = {clock.factor * self.run.times[step]:.3f} {clock.name}"
        if self.factor != 1.0:
            title += f", displacements × {self.factor:g}"
        names = ("", "") if self.solid else ("x (m)", "y (m)")
        tidy(axes, *names, title)
        if self.solid:
            self._surface(axes, places, step)
            axes.set_axis_off()
        else:
            self._plane(axes, places, step)
        for body in self.points:
            x, y = places[body][:, :2].T
            axes.plot(x, y, "o-", color="black", linewidth=1.5, markersize=4)
        axes.set_aspect("equal")
        axes.set(xlim=self.box[:, 0], ylim=self.box[:, 1])

    def _plane(self, axes: Any, places: Mapping[str, FloatArray], step: int) -> None:
        for body, (_, cells, edges) in self.meshes.items():
            x, y = places[body].T
            values = values_of(self.run, body, step, self.field)
            if values is not None:
                axes.tripcolor(x, y, cells, values * self.scale,
                               shading="gouraud", vmin=self.limits[0], vmax=self.limits[1],
                               cmap=MAPS[self.field])
            axes.plot(x[edges].T, y[edges].T, color=GREY, linewidth=0.5)

    def _surface(self, axes: "Axes", places: Mapping[str, FloatArray], step: int) -> None:
        corners, shown = [], []
        for body, (_, _, triangles) in self.meshes.items():
            values = values_of(self.run, body, step, self.field)
            corners.append(places[body][triangles])
            shown.append(np.full(triangles.shape, self.limits[0]) if values is None
                         else values[triangles] * self.scale)
        if corners:
            paint(axes, BodySurface(np.concatenate(corners), np.concatenate(shown), *self.limits,
                                MAPS[self.field], np.ones(2)))


def _rigid_points(run: RunResult) -> dict[str, FloatArray]:
    """Body without a mesh -> its named points (p, d) in its axes, m."""
    found = {}
    for b in run.layout:
        entry = run.scene["bodies"].get(b.owner, {})
        if b.kind.quantity is Quantity.POSE and b.owner not in run.bodies and (
                given := entry.get("points")):
            found[b.owner] = np.array(list(given.values()), dtype=np.float64)
    return found
