"""XDMF 3: a text file that describes binary data files by name, shape and time.

`meshio.xdmf.TimeSeriesWriter` is not used because it keeps the points at their initial positions
and writes its data files to the working directory.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sparsemor.core.arrays import IntArray
from sparsemor.plugins.export.snapshot import BodySnapshot, named_cells

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
        self.file = folder / f"{body}.xdmf"
        self._body = body
        (folder / body).mkdir()
        kinds = named_cells(cells, d)
        name = _TOPOLOGY[kinds[0][0]][0] if len(kinds) == 1 else "Mixed"
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
