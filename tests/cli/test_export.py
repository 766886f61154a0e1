"""Exported runs, read back by other programs' readers, pictures, and what is refused."""

import csv
import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from in_process import sparsemor
from sparsemor import InputError, export, load, open_result, simulate
from sparsemor.core.arrays import FloatArray
from sparsemor.core.results.files.written_files import LISTING
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.simulation.cache import Cache

SCENES = Path(__file__).parents[1] / "scenes"
SWING = Path(__file__).parents[1] / "scenes" / "swing.yaml"
WHOLE = "is of the whole run: fields of single bodies go to vtu or xdmf"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    """A reduced run in space: a flexible bar, a rigid body with a mesh, a wheel without."""
    folder = tmp_path_factory.mktemp("space")
    scene = load(SCENES / "everything_in_space.yaml", {"reducer": "galerkin", "time.end": 0.005})
    return simulate(scene, out=folder / "run", cache=Cache(folder / "cache"))


def expected(run: RunResult, body: str, step: int) -> tuple[FloatArray, FloatArray]:
    """Points and displacements in space axes, by another program's rotations."""
    R, p = np.split(run.block(f"{body}.rigid")[step], [3])
    A = Rotation.from_quat(p, scalar_first=True)
    u = run.nodal_displacement(body, step)
    return R + A.apply(run.points(body) + u), A.apply(u)


def vtu_times(series: Path) -> list[tuple[float, Path]]:
    return [(float(e.attrib["timestep"]), series.parent / e.attrib["file"])
            for e in ElementTree.parse(series).iter("DataSet")]


@pytest.mark.full
def test_vtu_read_back(run: RunResult, tmp_path: Path) -> None:
    import meshio

    assert run.reduced("bar.elastic") and run.reduced("bar.thermal")
    done = export(run, tmp_path / "files")
    assert done.fields == {"bar": ("displacement", "temperature"), "solid": ()}
    for body, series in done.files.items():
        written = vtu_times(series)
        assert [t for t, _ in written] == run.times.tolist() == done.times.tolist()
        for step, (_, file) in enumerate(written):
            mesh = meshio.read(file)
            points, u = expected(run, body, step)
            np.testing.assert_allclose(mesh.points, points, rtol=1e-14, atol=1e-15)
            assert np.array_equal(mesh.cells_dict["tetra"], run.cells(body))
            if body == "bar":
                np.testing.assert_allclose(
                    mesh.point_data["displacement"], u, rtol=1e-11, atol=1e-15)
                assert np.array_equal(
                    mesh.point_data["temperature"], run.nodal_temperature(body, step))
    assert np.abs(u).max() == 0.0 and np.ptp(run.nodal_displacement("bar", -1)) > 1e-5


@pytest.mark.full
def test_xdmf_read_back(
    run: RunResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """meshio looks for raw numbers in the working directory, ParaView beside the text."""
    from meshio.xdmf import TimeSeriesReader

    done = export(run, tmp_path / "files", "xdmf", bodies=["bar"], at=[0.0021, 0.005])
    monkeypatch.chdir(done.folder)
    with TimeSeriesReader(done.files["bar"].name) as reader:
        points, cells = reader.read_points_cells()
        np.testing.assert_allclose(points, expected(run, "bar", 2)[0], rtol=1e-14, atol=1e-15)
        assert np.array_equal(cells[0].data, run.cells("bar"))
        assert reader.num_steps == 2
        for number, step in enumerate((2, 5)):
            time, data, _ = reader.read_data(number)
            assert time == run.times[step]
            np.testing.assert_allclose(
                data["displacement"], expected(run, "bar", step)[1], rtol=1e-11, atol=1e-15)
            assert np.array_equal(data["temperature"], run.nodal_temperature("bar", step))
    later = np.fromfile("bar/points_000005.bin", "<f8").reshape(-1, 3)
    np.testing.assert_allclose(later, expected(run, "bar", 5)[0], rtol=1e-14, atol=1e-15)


@pytest.mark.full
@pytest.mark.parametrize("form", ["vtu", "xdmf"])
def test_what_paraview_is_made_of_reads_it(run: RunResult, tmp_path: Path, form: str) -> None:
    pyvista = pytest.importorskip("pyvista")
    done = export(run, tmp_path / "files", form)
    reader = pyvista.get_reader(str(done.files["bar"]))
    assert reader.time_values == run.times.tolist()
    for step, time in enumerate(reader.time_values):
        reader.set_active_time_value(time)
        mesh = reader.read()
        mesh = mesh[0] if isinstance(mesh, pyvista.MultiBlock) else mesh
        np.testing.assert_allclose(mesh.points, expected(run, "bar", step)[0], rtol=1e-14,
                                   atol=1e-15)
        assert np.array_equal(mesh["temperature"], run.nodal_temperature("bar", step))
        assert mesh.n_cells == len(run.cells("bar"))


@pytest.mark.full
def test_a_plane_run_by_the_command(tmp_path: Path) -> None:
    import meshio

    made = simulate(load(SWING, {"reducer": "full", "time.end": 0.02}), out=tmp_path / "run")
    shown = json.loads(sparsemor("export", tmp_path / "run", "--every", 10, "--json").out)
    assert (shown["status"], shown["times"], shown["notes"]) == ("done", 3, [])
    (series,) = map(Path, shown["files"].values())
    assert series == tmp_path / "run" / "vtu" / "arm.pvd"
    time, file = vtu_times(series)[-1]
    mesh = meshio.read(file)
    assert time == made.times[20] == pytest.approx(0.02)
    assert np.array_equal(mesh.points[:, :2], made.positions("arm", -1))
    assert not mesh.points[:, 2].any() and not mesh.point_data["displacement"][:, 2].any()
    again = sparsemor("export", tmp_path / "run", code=2)
    assert again.err == (f"--out: {series.parent}: output directory is not empty: use "
                            "--force to overwrite, or choose another --out\n")
    out = sparsemor("export", tmp_path / "run", "--force", "--at", "0.01", "--fields",
                    "temperature").out
    assert out == f"{series}: {len(made.points('arm'))} points, 1 times, temperature\n"
    assert list(meshio.read(vtu_times(series)[0][1]).point_data) == ["temperature"]


@pytest.mark.parametrize(("asked", "complaints"), [
    ({"to": "csv", "fields": ["stress"]}, [f"fields: csv {WHOLE}"]),
    ({"to": "nc", "bodies": ["bar"]}, [f"body: nc {WHOLE}"]),
    ({"to": "stl"}, ["to: no format is called 'stl': formats: vtu, xdmf, csv, nc"]),
    ({"at": [0.001, 1.0], "bodies": ["wheel"]},
     ["body: no body with a mesh is called 'wheel': bodies with a mesh: bar, solid",
      "at: give times within the run, 0 to 0.005 s (got 1)"]),
    ({"at": [float("nan")]}, ["at: give times within the run, 0 to 0.005 s (got nan)"]),
    ({"fields": ["heat"]},
     ["fields: no field is called 'heat': fields: displacement, temperature, stress, strain"]),
    ({"bodies": ["solid"], "fields": ["temperature"]},
     ["fields: solid has no temperature: the run did not solve for it"]),
    ({"every": 0}, ["every: `every` must be at least 1 (got 0)"]),
    ({"every": 2, "at": [0.001]}, ["every: give times or `every`, not both"]),
])
def test_refused_before_anything_is_written(
    run: RunResult, tmp_path: Path, asked: dict[str, Any], complaints: list[str]
) -> None:
    with pytest.raises(InputError) as caught:
        export(run, tmp_path / "files", **asked)
    assert str(caught.value).splitlines() == complaints
    assert not list(tmp_path.iterdir())


def test_a_field_that_one_body_lacks_is_told(run: RunResult, tmp_path: Path) -> None:
    done = export(run, tmp_path / "files", fields=["temperature"], at=[0.0])
    assert done.fields == {"bar": ("temperature",), "solid": ()}
    assert done.notes == ("solid has no temperature: the run did not solve for it",)


def test_force_replaces_nothing_but_exports(run: RunResult, tmp_path: Path) -> None:
    done = export(run, tmp_path / "files", at=[0.0])
    export(run, tmp_path / "files", "xdmf", at=[0.0], force=True)
    series = {LISTING, "bar", "bar.xdmf", "solid", "solid.xdmf"}
    assert {p.name for p in done.folder.iterdir()} == series
    (done.folder / "notes.txt").write_text("mine", encoding="utf-8")
    export(run, tmp_path / "files", at=[0.0], bodies=["bar"], force=True)
    assert {p.name for p in done.folder.iterdir()} == {LISTING, "bar", "bar.pvd", "notes.txt"}
    (done.folder / "bar.pvd").write_text("mine", encoding="utf-8")
    with pytest.raises(InputError, match=r"bar\.pvd: not written by sparsemor, or changed since"):
        export(run, tmp_path / "files", at=[0.0], force=True)
    assert (done.folder / "bar.pvd").read_text(encoding="utf-8") == "mine"
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "bar.pvd").write_text("mine", encoding="utf-8")
    with pytest.raises(InputError, match="this is something else"):
        export(run, tmp_path / "other", at=[0.0], force=True)


def test_nothing_is_left_of_an_export_that_fails(
    run: RunResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full_disk(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("sparsemor.plugins.export.vtk_and_xdmf.VtuSeries.close", full_disk)
    with pytest.raises(OSError, match="No space"):
        export(run, tmp_path / "files")
    assert not list(tmp_path.iterdir())


def test_one_time_is_held_in_memory(
    run: RunResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []
    block = RunResult.block

    def counted(self: RunResult, name: str, steps: Any = slice(None)) -> FloatArray:
        values = block(self, name, steps)
        asked.append(len(values))
        return values

    monkeypatch.setattr(RunResult, "block", counted)
    export(run, tmp_path / "files")
    assert set(asked) == {1}


def test_time_histories_have_the_names_of_a_stepper(run: RunResult, tmp_path: Path) -> None:
    """With all digits, at the times that are asked for."""
    times = run.times[[0, 2]].tolist()
    file = export(run, tmp_path / "files", "csv", at=times).files["histories"]
    with file.open(newline="", encoding="utf-8") as lines:
        table = list(csv.DictReader(lines))
    assert [float(row["time [s]"]) for row in table] == times
    for c, name in enumerate(("x", "y", "z", "q0")):
        assert [float(row[f"bar.rigid.{name} [{'1' if c == 3 else 'm'}]"]) for row in table] == (
            run.block("bar.rigid")[[0, 2], c].tolist())
    for joint, forces in run.joint_forces().items():
        for (what, unit), values in forces.items():
            column = f"{joint}.{what.replace(' ', '_')} [{unit}]"
            assert [float(row[column]) for row in table] == values[[0, 2]].tolist()


@pytest.mark.full
def test_netcdf_holds_all_arrays(run: RunResult, tmp_path: Path) -> None:
    xr = pytest.importorskip("xarray")
    file = export(run, tmp_path / "files", "nc", every=2).files["result"]
    with xr.open_dataset(file, engine="scipy") as data:
        expected = run.to_xarray().isel(time=slice(None, None, 2))
        assert set(data.variables) == set(expected.variables)
        for name, values in expected.variables.items():
            np.testing.assert_array_equal(data[name].to_numpy(), values.to_numpy(), err_msg=name)
        assert json.loads(data.attrs["scene"]) == run.attributes["scene"]


def test_nothing_to_write(tmp_path: Path) -> None:
    rigid_copy = {"use": "rigid", "mass": 1.0, "inertia": 0.1}
    (tmp_path / "bob.yaml").write_text(json.dumps({
        "format": 1, "bodies": {"bob": rigid_copy}, "time": {"end": 1e-3, "step": 1e-3}}))
    made = simulate(load(tmp_path / "bob.yaml"), out=tmp_path / "run")
    with pytest.raises(InputError) as caught:
        export(made, tmp_path / "files")
    assert str(caught.value) == "no body of this run has a mesh: there are no points to write"


@pytest.mark.full
def test_bad_commands(tmp_path: Path) -> None:
    nowhere = sparsemor("export", tmp_path / "nowhere", code=2)
    assert nowhere.err == f"there is no result in {tmp_path / 'nowhere'}\n"
    shown = json.loads(sparsemor("export", tmp_path, "--json", code=2).out)
    assert shown["status"] == "bad_input"


@pytest.mark.slow
def test_pictures_of_a_stored_run(run: RunResult, tmp_path: Path) -> None:
    folder = tmp_path / "drawn"
    shown = json.loads(sparsemor(
        "pictures", run.path, "--at", "0.002", "--out", folder, "--json").out)
    assert {Path(f).name for f in shown["files"]} == {
        p.name for p in folder.iterdir() if p.suffix != ".jsonl"}
    assert {"temperature_bar.png", "deformation_bar.svg", "positions.png", "angles.png"} <= {
        p.name for p in folder.iterdir()}
    bad = sparsemor("pictures", run.path, "--at", "1", "--out", tmp_path / "no", code=2)
    assert bad.err == "--at: give times within the run, 0 to 0.005 s (got 1)\n"
    assert not (tmp_path / "no").exists()


@pytest.mark.full
def test_a_fixed_frame_is_where_the_scene_put_it(tmp_path: Path) -> None:
    """Its pose is no unknown, so the result keeps it beside the mesh."""
    (tmp_path / "plate.yaml").write_text("""\
format: 1
bodies:
  plate:
    use: flexible
    frame: fixed
    mesh: {use: rectangle, size: [2.0, 1.0], divisions: [2, 1]}
    thickness: 0.1
    material: {rho: 1000, k: 20, c: 500}
    fields: [thermal]
    pose: {position: [3.0, -1.0], angle: 1.5707963267948966}
time: {end: 0.002, step: 1.0e-3}
reducer: full
""", encoding="utf-8")
    made = open_result(simulate(load(tmp_path / "plate.yaml"), out=tmp_path / "run").path)
    low, high = made.positions("plate", -1).min(axis=0), made.positions("plate", -1).max(axis=0)
    np.testing.assert_allclose([low, high], [[2.0, -1.0], [3.0, 1.0]], atol=1e-14)
