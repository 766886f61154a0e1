"""Bodies over time for visualization programs, in three coordinates and space axes: VTK XML files
(one unstructured grid per time, and a collection that lists them), and XDMF 3 (a text file that
describes binary data files by name, shape and time).

`meshio.xdmf.TimeSeriesWriter` is not used because it keeps the points at their initial positions
and writes its data files to the working directory.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.protocols.cells import KINDS, by_kind, corners_of
from sparsemor.core.results.run_result import RunResult


@dataclass(frozen=True, slots=True, eq=False)
class BodySnapshot:
    """Snapshot of one body. points (P, 3): current positions, m; fields: name -> (P,), (P, 3) or
    (P, 9) values there."""

    points: FloatArray
    fields: Mapping[str, FloatArray]


def frame_at(run: RunResult, body: str, step: int, fields: Sequence[str]) -> BodySnapshot:
    """Snapshot of a body: nodes at R + A (X + u), displacement A u in space axes, temperature.

    Warping the points by the displacement field magnifies the deformation. Planar bodies lie in z =
    0. Points are those of `exported_mesh`: nodal fields are read at their `nodes`, stress and
    strain come at these points already.
    """
    nodes = exported_mesh(run, body, fields)[0]
    u = run.nodal_displacement(body, step)
    values: dict[str, FloatArray] = {}
    if "displacement" in fields:
        values["displacement"] = _in_three(run.turned(body, step, u))[nodes]
    if "temperature" in fields:
        values["temperature"] = run.nodal_temperature(body, step)[nodes]
    if "stress" in fields:
        values["stress"] = run.von_mises(body, step)
        values["stress_tensor"] = _turned(run, body, step, run.stress(body, step))
    if "strain" in fields:
        values["strain"] = run.equivalent_strain(body, step)
        values["strain_tensor"] = _turned(run, body, step, run.strain(body, step))
    return BodySnapshot(_in_three(run.in_space(body, step, run.points(body) + u))[nodes], values)


def exported_mesh(run: RunResult, body: str, fields: Sequence[str]) -> tuple[IntArray, IntArray]:
    """Nodes (P,) of the points and cells (E, q) of an export: with stress or strain, nodes between
    materials have a point for each of them."""
    if {"stress", "strain"} & set(fields):
        return run.stress_mesh(body)
    return np.arange(len(run.points(body))), run.cells(body)


def named_cells(cells: IntArray, d: int) -> list[tuple[str, IntArray]]:
    """Name in meshio and nodes (n, q) of the cells of each kind among cells (E, q)."""
    return [(KINDS[d, p].names[own.shape[1] > p], own) for _, own in by_kind(cells, d)
            for p in [corners_of(d, own.shape[1])]]


def _turned(run: RunResult, body: str, step: int, tensors: FloatArray) -> FloatArray:
    """(P, 9) tensors (P, 3, 3) given in body axes, in space axes, by rows."""
    d = run.points(body).shape[1]
    A = np.eye(3)
    A[:d, :d] = run.turned(body, step, np.eye(d)).T
    return np.ascontiguousarray((A @ tensors @ A.T).reshape(-1, 9))


def _in_three(vectors: FloatArray) -> FloatArray:
    """(N, 3) vectors: (N, 2) vectors padded by zeros, (N, 3) vectors unchanged."""
    return np.ascontiguousarray(np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1]))))


class VtuSeries:
    """Writer of `body.pvd` and `body/body_STEP.vtu` (compressed float64 data)."""

    def __init__(self, folder: Path, body: str, cells: IntArray, d: int) -> None:
        """cells (E, q): nodes of the cells; d: dimension of the body."""
        self.file = folder / f"{body}.pvd"
        self._folder = folder / body
        self._folder.mkdir()
        self._cells = [(name, own.astype("int32")) for name, own in named_cells(cells, d)]
        self._lines: list[str] = []

    def write(self, step: int, time: float, frame: BodySnapshot) -> None:
        from meshio import Mesh
        from meshio.vtu import write

        name = f"{self._folder.name}/{self._folder.name}_{step:06d}.vtu"
        mesh = Mesh(frame.points, self._cells, point_data=dict(frame.fields))
        write(self.file.parent / name, mesh)
        self._lines.append(f'<DataSet timestep="{time!r}" part="0" file={quoteattr(name)}/>')

    def close(self) -> None:
        self.file.write_text("\n".join([
            '<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1">', "<Collection>",
            *self._lines, "</Collection>", "</VTKFile>", ""]), encoding="utf-8")


_KINDS = {1: "Scalar", 3: "Vector", 9: "Tensor"}
_TOPOLOGY = {"triangle": ("Triangle", 4), "triangle6": ("Triangle_6", 36),
             "quad": ("Quadrilateral", 5), "quad9": ("Quadrilateral_9", 35),
             "tetra": ("Tetrahedron", 6), "tetra10": ("Tetrahedron_10", 38),
             "wedge": ("Wedge", 8), "wedge18": ("Wedge_18", 41),
             "hexahedron": ("Hexahedron", 9), "hexahedron27": ("Hexahedron_27", 50)}
"""Name of each kind of cells, and its number in mixed topologies."""


class XdmfSeries:
    """Writer of `body.xdmf` and little-endian binary files in `body/`: cells once, points and
    fields per step."""

    def __init__(self, folder: Path, body: str, cells: IntArray, d: int) -> None:
        """cells (E, q): nodes of the cells, which are written once; d: dimension of the body."""
        self.file = folder / f"{body}.xdmf"
        self._body = body
        (folder / body).mkdir()
        kinds = named_cells(cells, d)
        name = _TOPOLOGY[kinds[0][0]][0] if len(kinds) == 1 else "Mixed"
        # in a mixed topology the number of its kind is in front of the nodes of each cell; cells
        # stand kind by kind, as no field is by cells
        rows = kinds[0][1] if len(kinds) == 1 else np.concatenate([np.insert(
            own, 0, _TOPOLOGY[kind][1], axis=1).ravel() for kind, own in kinds])
        self._topology = (
            f'<Topology TopologyType="{name}" NumberOfElements="{len(cells)}">'
            f"{self._item('cells', rows.astype('<i4'))}</Topology>")
        self._grids: list[str] = []

    def write(self, step: int, time: float, frame: BodySnapshot) -> None:
        points = self._item(f"points_{step:06d}", frame.points)
        attributes = [
            f'<Attribute Name="{name}" AttributeType="{_KINDS[v[0].size]}" '
            f'Center="Node">{self._item(f"{name}_{step:06d}", v)}</Attribute>'
            for name, v in frame.fields.items()]
        self._grids.append("\n".join([
            f'<Grid Name="{self._body}" GridType="Uniform">', f'<Time Value="{time!r}"/>',
            self._topology, f'<Geometry GeometryType="XYZ">{points}</Geometry>',
            *attributes, "</Grid>"]))

    def close(self) -> None:
        self.file.write_text("\n".join([
            '<?xml version="1.0"?>', '<Xdmf Version="3.0">', "<Domain>",
            f'<Grid Name="{self._body}" GridType="Collection" CollectionType="Temporal">',
            *self._grids, "</Grid>", "</Domain>", "</Xdmf>", ""]), encoding="utf-8")

    def _item(self, name: str, values: NDArray[np.generic]) -> str:
        """Writes an array to a binary file and returns the XML element that refers to it."""
        place = f"{self._body}/{name}.bin"
        integers = values.dtype.kind == "i"
        stored = values.astype("<i4" if integers else "<f8")
        stored.tofile(self.file.parent / place)
        return (f'<DataItem DataType="{"Int" if integers else "Float"}" Format="Binary" '
                f'Precision="{stored.dtype.itemsize}" Endian="Little" '
                f'Dimensions="{" ".join(map(str, stored.shape))}">{place}</DataItem>')
