"""Mesh of a geometry file by Gmsh: STEP, IGES, BREP, or Gmsh's own scripts (extra `gmsh`).

C. Geuzaine and J.-F. Remacle, Gmsh: a three-dimensional finite element mesh generator, Int. J.
Numer. Meth. Eng. 79 (2009), doi 10.1002/nme.2579.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from sparsemor.bodies.mesh.mesh_file import MeshFile
from sparsemor.core import FloatArray, InputError, Mesh, MeshPlugin, Plugin

ENDINGS = (".step", ".stp", ".iges", ".igs", ".brep", ".geo")
IGES = (".iges", ".igs")
"""Endings of files of faces, which are sewn to solids."""
NO_STEP = ("ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\nFILE_NAME('','',(''),(''),'',"
           "'','');\nFILE_SCHEMA(('AUTOMOTIVE_DESIGN'));\nENDSEC;\nDATA;\n"
           "#1=CARTESIAN_POINT('',(0.,0.,0.));\nENDSEC;\nEND-ISO-10303-21;\n")
"""STEP file without a shape."""
GAP = 0.01
"""Gap between faces of one solid, relative to the edge length, up to which they are sewn."""
ROUND = 12
"""Edges around a full circle, at least."""
LARGEST = 5_000_000
"""Number of cells above which a geometry is refused: its scale or size is wrong."""
SAME = 1e-4
"""Difference of radii and axes, relative to the radius, up to which cylinders are the same."""


class FaceRule(Plugin):
    """Faces of a solid by a rule: cylinders of a radius or rank, and of those, or of all faces, the
    nearest to a point. All faces of one cylinder belong together, as the two halves of a bore."""

    cylinder: int | None = Field(default=None, ge=1)
    """Rank by radius: 1 for the largest cylinder, 2 for the next smaller radius."""
    radius: float | None = Field(default=None, gt=0)
    """Radius of the cylinder, m."""
    nearest: tuple[float, float, float] | None = None
    """Point, m: the face that has the closest node."""

    @model_validator(mode="after")
    def _some(self) -> "FaceRule":
        if (self.cylinder, self.radius, self.nearest) == (None, None, None) or (
                self.cylinder is not None and self.radius is not None):
            raise InputError("takes `cylinder` or `radius`, `nearest`, or one of them and nearest")
        return self


class GmshMesh(MeshPlugin):
    """Mesh of a geometry file by Gmsh: triangles of a plane geometry, tetrahedra of a solid.

    STEP (step, stp), IGES (iges, igs), BREP (brep) and Gmsh scripts (geo), which may run other
    programs: mesh only those that you trust. Physical groups of a script are sets, and `faces`
    names faces of a solid by rules. Bores stay round: cells are of second order by default, and
    edges are short enough for twelve around a circle.
    """

    geometry: str = Field(min_length=1)
    """The file, relative to the scene's folder."""
    size: float = Field(gt=0)
    """Largest edge length of the cells, m."""
    scale: float | None = Field(default=None, gt=0)
    """Metres per length unit of a script or BREP file, 1 when not given; STEP and IGES have their
    unit."""
    order: Literal[1, 2] = 2
    """Order of the cells."""
    faces: dict[str, FaceRule] = {}
    """Sets of faces of a solid by rules."""

    def files(self, base: Path) -> tuple[Path, ...]:
        """The geometry file: its content identifies a run and its cached results."""
        return (base / self.geometry,)

    def build(self, base: Path) -> Mesh:
        """The mesh of the geometry `base / geometry`; InputError if it cannot be made."""
        full = base / self.geometry
        if full.suffix.lower() not in ENDINGS:
            raise InputError(f"'{self.geometry}' is no geometry: its name must end in "
                             f"{', '.join(ENDINGS)}; a mesh takes {{use: file, path: ...}}",
                             "geometry")
        if not full.is_file():
            raise InputError(f"there is no file '{self.geometry}'; paths start at the folder of "
                             "the scene", "geometry")
        has_unit = full.suffix.lower() in ENDINGS[:4]
        if has_unit and self.scale is not None:
            raise InputError("STEP and IGES files have their unit: drop it", "scale")
        scale = self.scale or 1.0
        with _session() as gmsh, TemporaryDirectory() as folder:
            try:
                faces_alone = full.suffix.lower() in IGES
                if faces_alone:  # units are unknown to its reader until that of STEP has been used
                    (Path(folder) / "no.step").write_text(NO_STEP)
                    gmsh.merge(str(Path(folder) / "no.step"))
                gmsh.option.setString("Geometry.OCCTargetUnit", "M" if has_unit else "")
                gmsh.open(str(full))
                if faces_alone and not gmsh.model.getEntities(3):
                    gmsh.model.occ.healShapes(tolerance=GAP * self.size, makeSolids=True)
                    gmsh.model.occ.synchronize()
                gmsh.option.setNumber("Mesh.MeshSizeMax", self.size / scale)
                gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", ROUND)
                gmsh.option.setNumber("Mesh.ElementOrder", self.order)
                gmsh.option.setNumber("Mesh.HighOrderOptimize", int(self.order == 2))
                d = max((entity[0] for entity in gmsh.model.getEntities()), default=0)
                if d < 2:
                    raise InputError(f"'{self.geometry}' has neither solids nor faces", "geometry")
                if d == 2 and self.faces:
                    raise InputError("the geometry has no solid whose faces could be named: in "
                                     "the plane, name curves by physical groups", "faces")
                self._check_size(gmsh, d, scale)
                gmsh.model.mesh.generate(d)
                if not gmsh.model.getPhysicalGroups(d):
                    gmsh.model.addPhysicalGroup(d, [t for _, t in gmsh.model.getEntities(d)],
                                                name="body")
                if self.faces:
                    self._name(_Faces(gmsh, scale))
                gmsh.write(str(Path(folder) / "mesh.msh"))
            except InputError:
                raise
            except Exception as error:  # Gmsh raises no other type
                reason = " ".join(str(error).replace(str(full), self.geometry).split())[:200]
                raise InputError(f"Gmsh cannot mesh '{self.geometry}': {reason}",
                                 "geometry") from None
            try:
                return MeshFile(path="mesh.msh", scale=scale).build(Path(folder))
            except InputError as error:
                raise InputError(f"the mesh of '{self.geometry}' by Gmsh cannot be used: "
                                 f"{error.faults[0].message}", "geometry") from None

    def _check_size(self, gmsh: Any, d: int, scale: float) -> None:
        """InputError for more cells than `LARGEST`, of regular triangles or tetrahedra of the edge
        length `size`, m, some 2.3 or 8.5 in a square or cube of this edge; scale: metres per unit
        of the geometry, d: its dimension."""
        whole = 0.0
        for entity in gmsh.model.getEntities(d):
            try:
                whole += gmsh.model.occ.getMass(*entity)
            except Exception:  # Gmsh raises no other type: of its own kernel, which has no areas
                box = np.array(gmsh.model.getBoundingBox(*entity)).reshape(2, 3)
                whole += float(np.prod(np.sort(np.ptp(box, axis=0))[-d:]))
        cells = whole * (scale / self.size) ** d * (8.5 if d == 3 else 2.3)
        if cells > LARGEST:
            raise InputError(f"'{self.geometry}' has {whole * scale**d:.3g} m{d}: some {cells:.1g} "
                             f"cells of {self.size:g} m, and at most {LARGEST:,} are meshed; a "
                             "script or BREP file in mm takes `scale: 1.0e-3`", "size")

    def _name(self, faces: "_Faces") -> None:
        """Adds a physical group of faces (dimension 2) for each rule, which becomes a set of the
        mesh. InputError under its name."""
        model = faces.gmsh.model
        named = {model.getPhysicalName(*group) for group in model.getPhysicalGroups()}
        for name, rule in self.faces.items():
            if name in named:
                raise InputError(f"'{self.geometry}' has a group '{name}' already: take another "
                                 "name", f"faces.{name}")
            try:
                found = faces.found(rule)
            except InputError as error:
                raise error.under(f"faces.{name}") from None
            model.addPhysicalGroup(2, found, name=name)


class _Faces:
    """Faces of a meshed solid, by their tags in Gmsh; scale: metres per unit of the geometry."""

    def __init__(self, gmsh: Any, scale: float) -> None:
        """gmsh: the module, with the meshed model; cylinders are sorted by falling radius."""
        self.gmsh, self.scale = gmsh, scale
        self.all = [tag for _, tag in gmsh.model.getEntities(2)]
        self.round: list[tuple[float, FloatArray, FloatArray, list[int]]] = []
        """Radius, point on the axis, direction and faces of each cylinder."""
        for tag in self.all:
            if gmsh.model.getType(2, tag) == "Cylinder":
                self._add(tag)
        self.round.sort(key=lambda one: -one[0])

    def _add(self, tag: int) -> None:
        """Adds a cylindrical face to those of the same cylinder, or as the first of a new one.

        From its middle point x with normal n, the larger principal curvature 1/r and the direction
        of the other, its axis: the axis goes through x + r n or x - r n, that which is at the
        distance r from another point of the face as well. round: radius, point of the axis, axis
        and faces of each cylinder.
        """
        model = self.gmsh.model
        low, high = model.getParametrizationBounds(2, tag)
        at = [(a + b) / 2 for a, b in zip(low, high, strict=True)]  # parameters of its middle
        most, least, bent, along = model.getPrincipalCurvatures(tag, at)
        curvature, axis = max((abs(most[0]), along), (abs(least[0]), bent), key=lambda c: c[0])
        radius, axis = 1.0 / curvature, np.array(axis)
        x, normal = np.array(model.getValue(2, tag, at)), np.array(model.getNormal(tag, at))
        second_at = [low[0] + 0.4 * (high[0] - low[0]), at[1]]
        second_point = np.array(model.getValue(2, tag, second_at))
        distance_errors = [
            abs(np.linalg.norm(np.cross(second_point - x - s * radius * normal, axis)) - radius)
            for s in (1.0, -1.0)]
        centre = x + (1.0 if distance_errors[0] < distance_errors[1] else -1.0) * radius * normal
        for r, c, a, tags in self.round:
            if max(abs(r - radius), float(np.linalg.norm(np.cross(c - centre, a))),
                   r * float(np.linalg.norm(np.cross(a, axis)))) < SAME * radius:
                tags.append(tag)
                return
        self.round.append((radius, centre, axis, [tag]))

    def found(self, rule: FaceRule) -> list[int]:
        """Tags of the faces of a rule; InputError where there are none, or several cylinders.
        round: radius, in units of the geometry, axis and faces of each cylinder, by falling radius;
        groups: faces that belong together, of each cylinder, and single ones."""
        groups = [one[3] for one in self.round]
        radii = [one[0] * self.scale for one in self.round]
        known_radii = ", ".join(f"{r:.6g}" for r in radii) or "none"
        if rule.cylinder is not None:
            distinct = [r for i, r in enumerate(radii) if not i or r < radii[i - 1] * (1 - SAME)]
            if rule.cylinder > len(distinct):
                raise InputError(f"the solid has {len(distinct)} different radii of cylinders "
                                 f"({known_radii} m)", "cylinder")
            wanted: float | None = distinct[rule.cylinder - 1]
        else:
            wanted = rule.radius
        if wanted is not None:
            groups = [g for g, r in zip(groups, radii, strict=True)
                      if abs(r - wanted) < 10 * SAME * wanted]
            if not groups:
                raise InputError(f"no cylinder has this radius; radii: {known_radii} m", "radius")
        else:
            cylindrical = {tag for group in groups for tag in group}
            groups = groups + [[tag] for tag in self.all if tag not in cylindrical]
        if rule.nearest is None:
            if len(groups) > 1:
                raise InputError(f"{len(groups)} cylinders have this radius: choose one by "
                                 "`nearest`")
            return groups[0]
        point = np.array(rule.nearest) / self.scale
        return min(groups, key=lambda tags: min(self._distance(tag, point) for tag in tags))

    def _distance(self, tag: int, point: FloatArray) -> float:
        """Distance of a point from the nearest node of a face, in units of the geometry."""
        nodes = self.gmsh.model.mesh.getNodes(2, tag, includeBoundary=True)[1].reshape(-1, 3)
        return float(np.linalg.norm(nodes - point, axis=1).min()) if len(nodes) else np.inf


@contextmanager
def _session() -> Iterator[Any]:
    """Gmsh with an empty model of its own, without its messages and settings; it runs in one
    thread, so that a mesh is always the same."""
    try:
        import gmsh
    except (ImportError, OSError) as error:  # a library of the system may be missing
        raise InputError(f"needs the package gmsh ({str(error)[:200]}): "
                         "pip install 'sparsemor[gmsh]'") from None
    running = bool(gmsh.isInitialized())
    if not running:
        gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("General.NumThreads", 1)
        gmsh.model.add("sparsemor")
        yield gmsh
    finally:
        gmsh.model.remove()
        if not running:
            gmsh.finalize()
