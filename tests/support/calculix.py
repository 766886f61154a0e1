"""CalculiX (`ccx`) for comparisons on one mesh of second-order tetrahedra: mesh, decks, numbers."""

import os
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sparsemor.bodies.mesh.generators.block import BlockMesh
from sparsemor.core.arrays import FloatArray, IntArray

PRESENT = shutil.which("ccx") is not None
MID = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
"""Edges of a tetrahedron in the order of C3D10."""
FACES = ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0))
"""Corners of the faces 1 to 4 of a tetrahedron."""


@dataclass(frozen=True)
class Solid:
    """Second-order tetrahedra: X (N, 3), m; nodes (E, 10); sets: nodes by name."""

    X: FloatArray
    nodes: IntArray
    sets: Mapping[str, IntArray]

    def write(self, file: Path) -> None:
        """The mesh in Abaqus format; CalculiX reads 20 characters of a number."""
        lines = ["*NODE, NSET=NALL"]
        lines += [f"{i + 1}, {x:.13g}, {y:.13g}, {z:.13g}"
                  for i, (x, y, z) in enumerate(self.X.tolist())]
        lines += ["*ELEMENT, TYPE=C3D10, ELSET=EALL"]
        lines += [", ".join(map(str, (e + 1, *r))) for e, r in enumerate((self.nodes + 1).tolist())]
        for name, at in self.sets.items():
            lines += [f"*NSET, NSET={name}", *(f"{i + 1}," for i in at.tolist())]
        file.write_text("\n".join(lines) + "\n", encoding="utf-8")

    def on_faces(self, name: str, card: str) -> str:
        """Lines `element, card` of all faces of a set; # in the card is the number of the face."""
        inside = np.isin(self.nodes[:, :4], self.sets[name])
        return "\n".join(f"{e + 1}, {card.replace('#', str(f + 1))}"
                         for f, corners in enumerate(FACES)
                         for e in np.flatnonzero(inside[:, corners].all(axis=1)).tolist())


def solid(points: FloatArray, cells: IntArray, sets: Mapping[str, str] | None = None) -> Solid:
    """Straight second-order tetrahedra on those of first order; sets: conditions in x, y, z."""
    edges, place = np.unique(np.sort(cells[:, np.array(MID)], axis=2).reshape(-1, 2), axis=0,
                             return_inverse=True)
    nodes = np.column_stack([cells, len(points) + place.reshape(-1, 6)])
    X = np.concatenate([points, points[edges].mean(axis=1)])
    x, y, z = X.T
    names = {"x": x, "y": y, "z": z, "abs": np.abs}
    return Solid(X, nodes, {name: np.flatnonzero(eval(rule, names))
                            for name, rule in (sets or {}).items()})


def block(lower: Sequence[float], size: Sequence[float], divisions: Sequence[int],
          sets: Mapping[str, str]) -> Solid:
    """A box along the axes."""
    mesh = BlockMesh(lower=tuple(lower), size=tuple(size),
                     divisions=tuple(divisions)).build(Path())
    return solid(mesh.points, mesh.cells, sets)


def by_ccx(folder: Path, deck: str) -> list[str]:
    """Lines of the .dat file of a deck, which may include `mesh.inp` of the folder."""
    (folder / "job.inp").write_text(deck, encoding="utf-8")
    done = subprocess.run(["ccx", "-i", "job"], cwd=folder, capture_output=True, text=True,
                          env=os.environ | {"OMP_NUM_THREADS": "1"})
    assert done.returncode == 0 and "*ERROR" not in done.stdout, done.stdout
    return (folder / "job.dat").read_text(encoding="utf-8").splitlines()


def table(lines: Sequence[str], heading: str, which: int = 0) -> FloatArray:
    """Rows of numbers below the line number `which` that contains a heading."""
    at = [i for i, line in enumerate(lines) if heading in line][which]
    rows: list[list[float]] = []
    for line in lines[at + 1:]:
        try:
            row = [float(w) for w in line.split()]
        except ValueError:
            if rows:
                break
            continue
        if row:
            rows.append(row)
        elif rows:
            break
    return np.array(rows)


def material(E: float, nu: float, rho: float, more: str = "") -> str:
    """Cards of one material of all elements."""
    return (f"*MATERIAL, NAME=M\n*ELASTIC\n{E:.16g}, {nu:.16g}\n*DENSITY\n{rho:.16g}\n{more}"
            "*SOLID SECTION, ELSET=EALL, MATERIAL=M\n")


def nodal(folder: Path, name: str) -> FloatArray:
    """(N, c) last values at all nodes of a field (`STRESS`, `NDTEMP`) of the .frd file."""
    found: list[list[float]] = []
    inside = False
    for line in (folder / "job.frd").read_text(encoding="utf-8").splitlines():
        if line.startswith(" -4 "):
            inside = line.split()[1] == name
            found = [] if inside else found
        elif line.startswith(" -3"):
            inside = False
        elif inside and line.startswith(" -1"):
            found.append([float(line[k:k + 12]) for k in range(13, len(line.rstrip()), 12)])
    return np.array(found)
