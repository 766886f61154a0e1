"""VTK XML files: one unstructured grid (.vtu) per time, and a collection (.pvd) that lists them."""

from pathlib import Path
from xml.sax.saxutils import quoteattr

from sparsemor.core.arrays import IntArray
from sparsemor.plugins.export.snapshot import BodySnapshot, named_cells


class VtuSeries:
    """Writer of `body.pvd` and `body/body_STEP.vtu` (compressed float64 data)."""

    def __init__(self, folder: Path, body: str, cells: IntArray, d: int) -> None:
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
