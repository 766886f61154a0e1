"""Pictures of bodies in space: what lies before what, which colour, which angle, which speed."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor import load, simulate
from sparsemor.bodies.terms.field_kinds import BODY_KINDS
from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.facets import outer_facets
from sparsemor.core.protocols.layout import Block
from sparsemor.core.protocols.mesh import Mesh
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.simulation.cache import Cache
from sparsemor.plugins.charts import view_in_space, write_run_charts
from sparsemor.plugins.charts.style import new_figure
from sparsemor.plugins.charts.surface_fields import solid_bodies, surface_figures
from sparsemor.plugins.charts.surface_pyvista_worker import DARKEST, LIGHT
from sparsemor.plugins.charts.time_histories import (
    probe_displacement_figure,
    probe_temperature_figure,
    turning,
)
from sparsemor.plugins.charts.view_in_space import VIEWS, BodySurface, front_facing, paint, rendered
from sparsemor.plugins.comparison.error_norms import measure_errors
from written_runs import TIMES, write_run

SCENE = """\
format: 1
bodies:
  bar:
    use: flexible
    mesh: {use: block, size: [0.4, 0.1, 0.06], divisions: [4, 2, 1]}
    material: {E: 5.0e+8, nu: 0.3, rho: 1100, alpha: 1.0e-4, k: 20, c: 500}
    fields: [elastic, thermal]
    reference: {clamp: left}
  wheel:
    use: rigid
    frame: spinning
    mass: 0.4
    inertia: [1.0e-3, 2.0e-3, 2.5e-3]
    points: {middle: [0.0, 0.0, 0.0]}
    pose: {position: [0.6, 0.05, 0.03], spin: [0.0, 0.0, 5.0]}
joints:
  ball: {use: spherical, between: [ground, "bar:left"]}
  axle: {use: revolute, between: [ground, "wheel:middle"], axis: [0, 0, 1]}
loads:
  weight: {use: gravity, g: [0.0, 0.0, -9.81]}
  sun: {use: heat_flux, on: ["bar:top"], flux: 2.0e+4}
probes:
  near: {body: bar, at: left}
  tip: {body: bar, at: right}
  rim: {body: wheel, at: [0.1, 0.0, 0.0]}
time: {end: 0.02, step: 1.0e-3}
integrator: bdf1
reducer: full
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    folder = tmp_path_factory.mktemp("bar")
    (folder / "bar.yaml").write_text(SCENE, encoding="utf-8")
    return simulate(load(folder / "bar.yaml"), out=folder / "run", cache=Cache(folder / "cache"))


def by_matplotlib(_: object) -> None:
    return None


def block(size: tuple[float, float, float]) -> tuple[FloatArray, Any]:
    """Points and outward triangles of a box about the origin, from two tetrahedra a corner."""
    from sparsemor.bodies.mesh.generators.block import BlockMesh

    mesh = BlockMesh(size=size, divisions=(1, 1, 1)).build(Path())
    return mesh.points - 0.5 * np.array(size), outer_facets(Mesh(mesh.points, mesh.cells))


@pytest.mark.parametrize("view", VIEWS, ids=lambda v: v.name)
def test_three_sides_of_a_box_face_the_eye(view: Any) -> None:
    np.testing.assert_allclose(view.axes @ view.axes.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(view.axes) == pytest.approx(1.0)
    points, triangles = block((1.0, 2.0, 3.0))
    shown = triangles[front_facing(view.rotated(points)[triangles])]
    normals = {tuple(np.sign(np.round(np.cross(b - a, c - a), 9)))
               for a, b, c in points[shown]}
    assert len(shown) == 6
    assert normals == {(1.0, 0, 0), (0, -1.0, 0), (0, 0, 1.0 if "above" in view.name else -1.0)}


def colour_at(surface: BodySurface, where: tuple[float, float]) -> FloatArray:
    """(3,) what matplotlib paints at a place of the panel, 0 to 1."""
    figure = new_figure(2.0, 2.0)
    figure.set_layout_engine("none")
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    w, h = surface.half
    axes.set(xlim=(-w, w), ylim=(-h, h))
    axes.set_axis_off()
    paint(axes, surface)
    canvas: Any = figure.canvas
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())
    row = int((1 - where[1] / h) * pixels.shape[0] / 2)
    column = int((1 + where[0] / w) * pixels.shape[1] / 2)
    return np.asarray(pixels[row, column, :3] / 255.0)


def flat(z: float, value: float) -> tuple[FloatArray, FloatArray]:
    """A large triangle across the view at depth z."""
    return np.array([[[-9.0, -9.0, z], [9.0, -9.0, z], [0.0, 9.0, z]]]), np.full((1, 3), value)


@pytest.mark.full
def test_the_nearer_triangle_hides_the_farther_one() -> None:
    from matplotlib import colormaps

    parts = [flat(0.3, 0.9), flat(-0.2, 0.1), flat(0.1, 0.5)]
    corners, values = (np.concatenate(a) for a in zip(*parts, strict=True))
    surface = BodySurface(corners, values, 0.0, 1.0, "viridis", np.ones(2))
    expected = np.array(colormaps["viridis"](0.9)[:3])
    np.testing.assert_allclose(colour_at(surface, (0.1, -0.2)), expected, atol=0.02)
    away = BodySurface(surface.corners[:, ::-1], surface.values, 0.0, 1.0, "viridis", np.ones(2))
    assert np.all(colour_at(away, (0.1, -0.2)) == 1.0)  # backs are not seen


def ramp(triangles: int) -> BodySurface:
    """A square of about so many triangles whose value is its height, 0 below and 1 above."""
    n = int(np.sqrt(triangles / 2))
    x, y = np.meshgrid(np.linspace(-1, 1, n + 1), np.linspace(-1, 1, n + 1))
    points = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    a = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    b = a + n + 1
    corners = points[np.concatenate([np.stack(t, axis=1) for t in ((a, a + 1, b + 1),
                                                                   (a, b + 1, b))])]
    return BodySurface(corners, 0.5 + 0.5 * corners[..., 1], 0.0, 1.0, "viridis", 1.1 * np.ones(2))


@pytest.mark.full
def test_pyvista_draws_the_same() -> None:
    pytest.importorskip("pyvista")
    from matplotlib import colormaps

    surface = ramp(2000)
    images = rendered([surface])
    if images is None:
        pytest.skip("VTK finds neither a display nor EGL nor OSMesa here")
    (image,) = images
    assert image.shape == (700, 700, 3)
    lit = DARKEST + (1.0 - DARKEST) * LIGHT[2]
    for y in (-0.8, 0.0, 0.6):
        pixel = image[int(350 * (1 - y / 1.1)), 400] / 255.0
        np.testing.assert_allclose(pixel, np.array(colormaps["viridis"](0.5 + 0.5 * y)[:3]) * lit,
                                   atol=0.03)
    assert np.all(image[3, 3] == 255)


@pytest.mark.full
def test_a_renderer_that_crashes_is_no_crash(monkeypatch: pytest.MonkeyPatch) -> None:
    """VTK 9.7 ends with a segmentation fault when it finds nothing to draw with."""
    pytest.importorskip("pyvista")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setenv("VTK_DEFAULT_OPENGL_WINDOW", "vtkXOpenGLRenderWindow")
    assert rendered([ramp(8)]) is None


def test_without_the_extra_matplotlib_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(view_in_space, "find_spec", lambda name: None)
    assert rendered([ramp(8)]) is None
    assert rendered([]) is None


@pytest.mark.full
def test_skins_at_chosen_times(run: RunResult) -> None:
    figures = surface_figures(run, [0.0049, 0.02], by_matplotlib)
    assert set(figures) == {"temperature_bar", "deformation_bar"} and solid_bodies(run) == ["bar"]
    *panels, bar = figures["temperature_bar"].axes
    assert [a.get_title(loc="left") for a in panels] == ["t = 5 ms", "t = 20 ms", "", ""]
    assert [panels[k].get_ylabel() for k in (0, 2)] == ["from above", "from below"]
    assert bar.get_ylabel() == "temperature (K)"
    skin_values = [run.nodal_temperature("bar", k) for k in (5, 20)]  # all points lie on the skin
    assert bar.get_ylim() == (np.min(skin_values), np.max(skin_values))
    *_, bar = figures["deformation_bar"].axes
    assert bar.get_ylabel() == "displacement |u| (µm)" and bar.get_ylim()[0] == 0.0
    u = max(np.linalg.norm(run.nodal_displacement("bar", k), axis=1).max() for k in (5, 20))
    assert bar.get_ylim()[1] == pytest.approx(1e6 * u)
    assert "drawn with displacements × " in figures["deformation_bar"].get_supxlabel()


@pytest.mark.full
def test_pictures_of_a_run_in_space(
    run: RunResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(view_in_space, "find_spec", lambda name: None)
    files = write_run_charts(run, tmp_path, formats=["png"])
    assert {f.stem for f in files} == {
        "angles", "positions", "deformation_bar", "temperature_bar", "probe_displacement",
        "probe_temperature", "joint_forces"}


# --------------------------------------------------------------------------- motion


@pytest.mark.full
def test_probes(run: RunResult) -> None:
    heat, bent = probe_temperature_figure(run), probe_displacement_figure(run)
    assert heat is not None and bent is not None
    assert heat.axes[0].get_ylabel() == "temperature (K)"
    shown = {line.get_label(): np.asarray(line.get_ydata()) for line in heat.axes[0].lines}
    assert set(shown) == {"near", "tip"}  # the wheel has no temperature
    assert np.array_equal(shown["tip"], run.probe("tip")[:, 6])
    tip = run.probe_header("tip")
    assert tip.components == ("x", "y", "z", "u_x", "u_y", "u_z", "temperature")
    assert (tip.body, tip.units) == ("bar", ("m",) * 6 + ("K",))
    assert tip.position == pytest.approx((0.4, 0.05, 0.03))
    assert bent.axes[0].get_ylabel() == "displacement |u| (µm)"
    (line,) = (line for line in bent.axes[0].lines if line.get_label() == "tip")
    np.testing.assert_allclose(
        np.asarray(line.get_ydata()), 1e6 * np.linalg.norm(run.probe("tip")[:, 3:6], axis=1))


def test_the_error_of_angles_is_that_of_bodies_in_space_not_of_massless_frames(
    tmp_path: Path
) -> None:
    blocks = (Block("arm", BODY_KINDS[0], 7), Block("strut.first", BODY_KINDS[0], 7))
    x = np.zeros((3, 14))
    x[:, [3, 10]] = 1.0
    other = x.copy()
    for start, angle in ((3, 0.02), (10, 0.5)):
        other[2, start] = np.cos(0.5 * angle)
        other[2, start + 2] = np.sin(0.5 * angle)
    ran = [write_run(tmp_path / name, x=values, times=TIMES[:3], blocks=blocks,
                     scene={"bodies": {"arm": {}}}) for name, values in (("a", x), ("b", other))]
    assert measure_errors(*ran).worst["angle_rad"] == pytest.approx(0.02)
    assert set(turning(ran[1])) == {("arm", "turned (°)")}
    assert turning(ran[1])["arm", "turned (°)"].values[-1] == pytest.approx(np.degrees(0.02))
