"""Quadrilaterals, wedges, hexahedra and curved cells of second order: exact integrals, files,
orders of convergence, bending."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from sparsemor.bodies.fem import elasticity, element_matrices, integrals
from sparsemor.bodies.fem.integrals import on_facets
from sparsemor.bodies.fem.quadratic_cells import with_midpoints
from sparsemor.bodies.fem.stress import CellStress
from sparsemor.bodies.material import Isotropic
from sparsemor.bodies.mesh.mesh_checks_and_repairs import check_mesh
from sparsemor.bodies.mesh.mesh_file import MeshFile
from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.errors import InputError
from sparsemor.core.model.facets import linear_surface, outer_facets
from sparsemor.core.protocols.cells import KINDS, by_kind
from sparsemor.core.protocols.mesh import Mesh
from tiers import quick

STEEL = Isotropic(E=2e11, nu=0.3, rho=1000, alpha=1e-5)


SPLIT = {"triangle": ((0, 1, 2), (0, 2, 3)), "wedge": ((0, 1, 2, 4, 5, 6), (0, 2, 3, 4, 6, 7))}
"""Parts of a quadrilateral or hexahedron."""


def grid(kind: str, divisions: tuple[int, ...], size: tuple[float, ...]) -> Mesh:
    """Box of one kind of cells, or of several: `mixed` has the kinds in turn along x."""
    d = len(size)
    n = np.array(divisions)
    at = np.stack(np.meshgrid(*(np.arange(k + 1) for k in n), indexing="ij"), axis=-1)
    number = np.arange(at[..., 0].size).reshape(at.shape[:-1])
    corners = [tuple(c) for c in np.array(KINDS[d, 2**d].places, dtype=int)]
    rows = []
    for cell in np.ndindex(*n):
        box = [int(number[tuple(np.add(cell, c))]) for c in corners]
        which = kind if kind != "mixed" else (("quad", "triangle"), ("hexahedron", "wedge"))[
            d - 2][cell[0] % 2]
        rows += [[box[i] for i in part] for part in SPLIT.get(which, (range(2**d),))]
    wide = max(map(len, rows))
    cells = np.array([[*r, *[r[-1]] * (wide - len(r))] for r in rows])
    X = (at.reshape(-1, d) / n) * size
    ends = {"left": np.flatnonzero(X[:, 0] == 0.0), "right": np.flatnonzero(X[:, 0] == size[0])}
    return Mesh(X, cells, ends)


KIND = [("quad", 2), ("wedge", 3), ("hexahedron", 3), ("mixed", 2), ("mixed", 3)]


def sheared(mesh: Mesh) -> Mesh:
    """The mesh under a quadratic map, with straight edges."""
    X = mesh.points + 0.1 * mesh.points[:, ::-1] * mesh.points[:, [1, *range(mesh.dimension)[1:]]]
    return Mesh(X, mesh.cells, mesh.point_sets)


@pytest.fixture(params=quick(KIND, ("mixed", 2)), ids=lambda p: f"{p[0]}{p[1]}")
def linear(request: pytest.FixtureRequest) -> Mesh:
    kind, d = request.param
    return grid(kind, (3, 2, 2)[:d], (1.0, 0.6, 0.4)[:d])


@pytest.mark.parametrize("order", [1, 2])
def test_linear_fields_have_exact_integrals(linear: Mesh, order: int) -> None:
    """Patch test on distorted cells: volume, surface, rigid motion and constant strain."""
    mesh = sheared(linear)
    check_mesh(mesh)
    mesh = with_midpoints(mesh) if order == 2 else mesh
    d, X = mesh.dimension, mesh.points
    M, K = integrals.scalar_mass(mesh, 1.0), integrals.conductivity(mesh, 1.0)
    outer = outer_facets(mesh)
    normals = integrals.surface_normal_load(mesh, outer)
    volume = float(np.sum(normals * X) / d)  # divergence theorem
    assert M.sum() == pytest.approx(volume, rel=1e-12)
    assert integrals.surface_mass(mesh, outer, 1.0).sum() == pytest.approx(
        integrals.facet_measures(mesh, outer).sum(), rel=1e-12)
    assert integrals.surface_load(mesh, outer).sum() == pytest.approx(
        integrals.facet_measures(mesh, outer).sum(), rel=1e-12)
    slope = np.arange(1.0, d + 1.0)
    np.testing.assert_allclose(K @ (X @ slope), normals @ slope, atol=1e-13)
    model: elasticity.Model = "solid" if d == 3 else "plane_strain"
    stiff = elasticity.elastic_stiffness(mesh, STEEL, 1.0, model)
    strain = np.arange(1.0, d * d + 1.0).reshape(d, d)
    strain = strain + strain.T
    law = elasticity.law(STEEL, model)
    stress = law.lam * np.trace(strain) * np.eye(d) + 2.0 * law.mu * strain
    u = (X @ strain).ravel()
    np.testing.assert_allclose(stiff @ u, (normals @ stress).ravel(),
                               atol=1e-12 * np.abs(stress).max())
    push = elasticity.thermoelastic_coupling(mesh, STEEL, 1.0, model) @ np.ones(len(X))
    np.testing.assert_allclose(push, law.beta * normals.ravel(), atol=1e-13 * law.beta)
    found = CellStress(X, mesh.nodes, np.array([[law.lam, law.mu, law.beta, law.lam, law.beta]]),
                       np.zeros(len(mesh.cells), np.int64)).stress(
        u.reshape(-1, d), np.zeros(len(X)))
    np.testing.assert_allclose(found[:, :d, :d], np.broadcast_to(stress, (len(X), d, d)),
                               rtol=1e-9)
    whole = element_matrices.elements(element_matrices.conduction, mesh, 0, weight=1.0)
    again = np.zeros((len(X), len(X)))
    for cell, local in zip(mesh.nodes, whole, strict=True):
        np.add.at(again, np.ix_(cell, cell), local)
    np.testing.assert_allclose(again, K.toarray(), atol=1e-13)


def test_files_of_every_kind_are_read(linear: Mesh, tmp_path: Path) -> None:
    """Written by meshio, of first order, and of second with curved edges: the same mesh."""
    d = linear.dimension

    def build(mesh: Mesh, name: str) -> Mesh:
        blocks = [(KINDS[d, own.shape[1]].names[0] if mesh.order == 1 else {
            6: "triangle6", 9: "quad9", 18: "wedge18", 27: "hexahedron27"}[own.shape[1]], own)
            for _, own in mesh.parts]
        points = np.pad(mesh.points, ((0, 0), (0, 3 - d)))
        meshio.Mesh(points, blocks).write(tmp_path / name)
        return MeshFile(path=name).build(tmp_path)

    found = build(linear, "a.vtu")
    volume = np.prod(np.ptp(linear.points, axis=0))
    assert integrals.scalar_mass(found, 1.0).sum() == pytest.approx(volume)
    mesh = with_midpoints(linear)
    bent = mesh.points + 0.05 * np.sin(3.0 * mesh.points[:, ::-1])
    first = found.order
    curved = build(Mesh(bent, mesh.cells, midpoints=mesh.midpoints), "b.vtu")
    assert (first, curved.order) == (1, 2)
    own = Mesh(bent, mesh.cells, midpoints=mesh.midpoints)
    volume = integrals.scalar_mass(own, 1.0).sum()
    assert integrals.scalar_mass(curved, 1.0).sum() == pytest.approx(volume, rel=1e-3)


def ring(kind: str, n: int) -> Mesh:
    """Ring 1 <= r <= 2 (of thickness 0.5 in space), a quarter, with curved cells of second order:
    wedges and triangles have curved diagonals."""
    d = 2 if kind in ("triangle", "quad") else 3
    flat = grid(kind, (n, 2 * n, max(n // 2, 1))[:d], (1.0, 1.0, 0.5)[:d])
    mesh = with_midpoints(flat)
    r, angle = 1.0 + mesh.points[:, 0], 0.5 * np.pi * mesh.points[:, 1]
    X = np.column_stack([r * np.cos(angle), r * np.sin(angle), *mesh.points.T[2:]])
    return Mesh(X, mesh.cells, midpoints=mesh.midpoints)


def errors(mesh: Mesh) -> tuple[float, float]:
    """Errors of u (L2, m) and of the stress at the nodes (rms, relative to mu), of a quarter of a
    ring whose boundary has the displacements of the solution u = grad log r."""
    d, X = mesh.dimension, mesh.points
    law = elasticity.law(STEEL, "solid" if d == 3 else "plane_strain")

    def exact(x: FloatArray) -> FloatArray:  # div u = 0, curl-free: in equilibrium
        r2 = x[:, 0] ** 2 + x[:, 1] ** 2
        u = np.zeros_like(x)
        u[:, :2] = x[:, :2] / r2[:, None]
        return u

    u = exact(X)
    held = np.unique(boundary(mesh))
    K = elasticity.elastic_stiffness(mesh, STEEL, 1.0, "solid" if d == 3 else "plane_strain")
    fixed = (d * held[:, None] + np.arange(d)).ravel()
    free = np.setdiff1d(np.arange(d * len(X)), fixed)
    found = u.ravel().copy()
    found[free] = spsolve(K[free][:, free].tocsc(), -(K[free][:, fixed] @ found[fixed]))
    at = element_matrices.cell_quadratures(mesh, 4)
    error, whole = 0.0, 0.0
    for _, q in at:
        x = q.coordinates.reshape(d, -1).T
        local = np.einsum("eiq,eid->eqd", np.broadcast_to(q.shape.values, (
            len(q.weights), *q.shape.values.shape[1:])), found.reshape(-1, d)[q.shape.nodes])
        error += float(q.weights.ravel() @ ((local.reshape(-1, d) - exact(x)) ** 2).sum(axis=1))
        whole += float(q.weights.sum())
    stress = CellStress(X, mesh.nodes, np.array([[law.lam, law.mu, law.beta, law.lam, law.beta]]),
                        np.zeros(len(mesh.cells), np.int64)).stress(
        found.reshape(-1, d), np.zeros(len(X)))
    x, y = X[:, 0], X[:, 1]
    r4 = (x**2 + y**2) ** 2
    right = np.zeros((len(X), 3, 3))
    right[:, 0, 0], right[:, 1, 1] = (y**2 - x**2) / r4, (x**2 - y**2) / r4
    right[:, 0, 1] = right[:, 1, 0] = -2.0 * x * y / r4
    off = np.sqrt(np.mean((stress - 2.0 * law.mu * right) ** 2)) / law.mu
    return float(np.sqrt(error / whole)), float(off)


def boundary(mesh: Mesh) -> IntArray:
    """Nodes of the boundary."""
    return np.unique(linear_surface(mesh.nodes, mesh.dimension))


@pytest.mark.full
@pytest.mark.parametrize("kind", ["triangle", "quad", "wedge", "hexahedron"])
def test_curved_cells_of_second_order_converge(kind: str) -> None:
    """Displacements of order 3, stress of order 2."""
    sizes = (4, 8, 16) if kind in ("triangle", "quad") else (2, 4, 6)
    found = [errors(ring(kind, n)) for n in sizes]
    for (n, (u, s)), (m, (v, t)) in pairwise(zip(sizes, found, strict=True)):
        assert np.log(u / v) / np.log(m / n) > 2.7
        assert np.log(s / t) / np.log(m / n) > 1.7


def body(kind: str, d: int, tmp_path: Path, **options: Any) -> dict[str, Any]:
    """Cantilever of length 1 and height 0.1 with one cell over the height."""
    mesh = grid(kind, (10, 1, 1)[:d], (1.0, 0.1, 0.1)[:d])
    meshio.Mesh(np.pad(mesh.points, ((0, 0), (0, 3 - d))), [
        (KINDS[d, own.shape[1]].names[0], own) for _, own in mesh.parts]).write(tmp_path / "b.vtu")
    return {"use": "flexible", "mesh": {"use": "file", "path": str(tmp_path / "b.vtu")},
            "material": {"E": 2e11, "nu": 0.3, "rho": 7800.0}, "fields": ["elastic"],
            **({"thickness": 0.1} if d == 2 else {}),
            "sets": {"left": {"where": "x < 1e-9"}, "right": {"where": "x > 0.999999999"}},
            "reference": {"clamp": "left"}, "frame": "fixed", **options}


@pytest.mark.full
@pytest.mark.parametrize(("kind", "d"), KIND)
def test_a_cantilever_with_one_cell_over_its_height(kind: str, d: int, tmp_path: Path) -> None:
    """By default of second order: the deflection is that of beam theory, with shear, within 2 %."""
    from sparsemor.bodies.floating_body import FloatingBody
    from sparsemor.core.model.assembly import assemble
    from sparsemor.core.testing.in_memory_run import scene_of

    made = assemble(scene_of({"bodies": {"b": body(kind, d, tmp_path)},
                              "time": {"end": 1.0, "step": 1.0}})).parts["b"]
    assert isinstance(made, FloatingBody) and made.elasticity is not None
    assert made.mesh is not None and made.mesh.order == 2
    free = made.elasticity.free
    right = integrals.boundary_facets(made.mesh, made.points["right"])
    load = integrals.surface_load(made.mesh, right, 0.1 if d == 2 else 1.0) / 0.01
    f = np.zeros(made.mesh.points.shape)
    f[:, 1] = load
    u = np.zeros(f.size)
    u[free] = spsolve(made.elasticity.stiffness[free][:, free].tocsc(), f.ravel()[free])
    tip = float(load @ u.reshape(f.shape)[:, 1])
    beam = 1.0 / (3.0 * 2e11 * 0.1**4 / 12.0) + 1.0 / (5.0 / 6.0 * 2e11 / 2.6 * 0.01)
    assert tip == pytest.approx(beam, rel=0.025 if kind == "wedge" else 0.02)


EDGES = {
    "wedge15": {
        "msh": ((0, 1), (0, 2), (0, 3), (1, 2), (1, 4), (2, 5), (3, 4), (3, 5), (4, 5)),
        "bdf": ((0, 1), (1, 2), (2, 0), (0, 3), (1, 4), (2, 5), (3, 4), (4, 5), (5, 3)),
        "inp": ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5))},
    "hexahedron20": {
        "msh": ((0, 1), (0, 3), (0, 4), (1, 2), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 7),
                (5, 6), (6, 7)),
        "bdf": ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 5), (2, 6), (3, 7), (4, 5), (5, 6),
                (6, 7), (7, 4)),
        "inp": ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5),
                (2, 6), (3, 7))}}
"""Edges of the nodes after the corners, by the manuals of Gmsh, Nastran and Abaqus."""


@pytest.mark.parametrize("ending", ["msh", "bdf", "inp"])
@pytest.mark.parametrize("kind", EDGES)
def test_serendipity_cells_have_their_edges_in_the_order_of_the_format(
    kind: str, ending: str, tmp_path: Path
) -> None:
    """One bent cell: its nodes are on their edges, and those that the file lacks follow."""
    p = 6 if kind == "wedge15" else 8
    corners = np.array(KINDS[3, p].places)
    X = np.array([*corners, *(corners[list(e)].mean(axis=0) for e in EDGES[kind][ending])])
    X[:, 2] += 0.1 * np.sin(3.0 * X[:, 0]) + 0.1 * X[:, 1] ** 2
    nodes = [f"{x:.7f},{y:.7f},{z:.7f}" for x, y, z in X]
    ids = ",".join(str(i + 1) for i in range(len(X)))
    text = {
        "inp": "*NODE\n" + "".join(f"{i},{n}\n" for i, n in enumerate(nodes, 1))
        + f"*ELEMENT, TYPE=C3D{len(X)}\n1,{ids}\n",
        "bdf": "BEGIN BULK\n" + "".join(f"GRID,{i},,{n}\n" for i, n in enumerate(nodes, 1))
        + "".join(f"{'C' + ('PENTA' if p == 6 else 'HEXA') + ',1,1' if not k else ''},"
                  + ",".join(part) + "\n" for k, part in enumerate(
                      [ids.split(",")[:6], ids.split(",")[6:14], ids.split(",")[14:]]) if part),
        "msh": f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{len(X)}\n" + "".join(
            f"{i} {n.replace(',', ' ')}\n" for i, n in enumerate(nodes, 1))
        + f"$EndNodes\n$Elements\n1\n1 {18 if p == 6 else 17} 2 0 1 "
        + f"{ids.replace(',', ' ')}\n$EndElements\n"}[ending]
    (tmp_path / f"one.{ending}").write_text(text)
    mesh = MeshFile(path=f"one.{ending}").build(tmp_path)
    assert mesh.nodes.shape == (1, {6: 18, 8: 27}[p]) and not mesh.notes
    edges = {tuple(sorted(e)): x for e, x in zip(EDGES[kind][ending], X[p:], strict=True)}
    for edge, node in zip(KINDS[3, p].edges, mesh.midpoints[0], strict=False):
        np.testing.assert_allclose(mesh.points[node], edges[tuple(sorted(edge))], atol=1e-7)
    bent = KINDS[3, p].nodes
    x, y = bent[:, 0], bent[:, 1]
    free = bent[:, 2] + 0.1 * y**2  # quadratic functions are interpolated exactly
    np.testing.assert_allclose(mesh.points[mesh.nodes[0], 2] - 0.1 * np.sin(3.0 * x), free,
                               atol=0.02)


@pytest.mark.full
def test_exports_and_contact_of_second_order(tmp_path: Path) -> None:
    """A block of mixed cells rests on a plate: its weight is the contact force at each order, and
    its export is the mesh that was read."""
    from sparsemor import export, simulate
    from sparsemor.core.testing.in_memory_run import scene_of

    found = []
    for order in (1, 2):
        folder = tmp_path / str(order)
        folder.mkdir()
        for name, low in (("block", 0.0), ("plate", -0.1)):
            mesh = grid("mixed", (2, 2, 1), (0.2, 0.2, 0.1))
            points = mesh.points + [0.0, 0.0, low]
            meshio.Mesh(points, [(KINDS[3, own.shape[1]].names[0], own)
                                 for _, own in mesh.parts]).write(folder / f"{name}.vtu")
        solid: dict[str, Any] = {
            "use": "flexible", "material": {"E": 1e9, "nu": 0.3, "rho": 1000.0}, "order": order,
            "fields": ["elastic"], "damping": {"mass": 20.0}}
        run = simulate(scene_of({
            "bodies": {
                "block": {**solid, "mesh": {"use": "file", "path": str(folder / "block.vtu")},
                          "reference": {"clamp": "high"}, "sets": {
                              "low": {"where": "z < 1e-9"}, "high": {"where": "z > 0.0999"}}},
                "plate": {**solid, "mesh": {"use": "file", "path": str(folder / "plate.vtu")},
                          "reference": {"clamp": "base"}, "frame": "fixed", "sets": {
                              "high": {"where": "z > -1e-9"}, "base": {"where": "z < -0.0999"}}}},
            "joints": {"guide": {"use": "prismatic", "between": ["ground", "block:high"],
                                 "axis": [0, 0, 1]}},
            "loads": {"weight": {"use": "gravity", "g": [0.0, 0.0, -9.81], "bodies": ["block"]}},
            "contacts": {"rest": {"use": "polygonal", "surfaces": "deformed",
                                  "between": ["block:low", "plate:high"],
                                  "normal": {"use": "elastic_foundation", "stiffness": 1e8,
                                             "damping": 1e6, "damping_depth": 1e-7}}},
            "time": {"end": 0.5, "step": 0.01}, "integrator": "bdf1"}), out=folder / "run")
        found.append(run)
        export(run, folder / "vtu", fields=["displacement", "stress"], at=[0.5])
        (file,) = (folder / "vtu" / "block").glob("*.vtu")
        again = MeshFile(path=file.name).build(file.parent)
        assert again.order == order
        assert integrals.scalar_mass(again, 1.0).sum() == pytest.approx(0.004, rel=1e-4)
    for run in found:
        low = run.points("block")[:, 2] < 1e-9
        assert run.nodal_displacement("block", -1)[low, 2].std() < 1e-7
        depth = -run.positions("block", -1)[low, 2].mean() + run.positions("plate", -1)[
            run.points("plate")[:, 2] > -1e-9, 2].mean()
        assert depth * 1e8 * 0.04 == pytest.approx(0.004 * 1000.0 * 9.81, rel=0.02)


def test_gradients_on_facets(linear: Mesh) -> None:
    """A law on a surface may read the gradient of a field: of a linear one it is exact."""
    mesh = with_midpoints(sheared(linear))
    slope = np.arange(1.0, mesh.dimension + 1.0)
    for at in on_facets(mesh, outer_facets(mesh), 1, gradients=True):
        assert at.shape.gradients is not None
        nodal = mesh.points[at.shape.nodes] @ slope
        value = np.einsum("ei,eiq->eq", nodal, np.broadcast_to(at.shape.values, (
            len(nodal), *at.shape.values.shape[1:])))
        np.testing.assert_allclose(value, np.einsum("j,jeq->eq", slope, at.coordinates))
        found = np.einsum("ei,eijq->ejq", nodal, at.shape.gradients)
        np.testing.assert_allclose(found, np.broadcast_to(slope[:, None], found.shape), rtol=1e-9)


@pytest.mark.parametrize("turn", range(4))
def test_collapsed_hexahedra_are_wedges(turn: int, tmp_path: Path) -> None:
    mesh = grid("wedge", (2, 1, 1), (1.0, 0.5, 0.25))
    rows = np.array([[*np.roll([a, b, c, c], turn), *np.roll([d, e, f, f], turn)]
                     for a, b, c, d, e, f in mesh.cells])
    meshio.Mesh(mesh.points, [("hexahedron", rows)]).write(tmp_path / "a.vtu")
    found = MeshFile(path="a.vtu").build(tmp_path)
    assert [own.shape for _, own in by_kind(found.cells, 3)] == [(4, 6)]
    assert integrals.scalar_mass(found, 1.0).sum() == pytest.approx(0.125)
    rows[0, 4] = rows[0, 0]
    meshio.Mesh(mesh.points, [("hexahedron", rows)]).write(tmp_path / "b.vtu")
    with pytest.raises(InputError, match="1 cells of type hexahedron name a corner twice: 0"):
        MeshFile(path="b.vtu").build(tmp_path)


def test_tetrahedra_on_a_face_of_a_hexahedron_are_refused() -> None:
    box = grid("hexahedron", (1, 1, 1), (1.0, 1.0, 1.0))
    hexahedron = box.cells[0]
    X = np.vstack([box.points, [[2.0, 0.5, 0.5]]])
    face = hexahedron[[1, 2, 6, 5]]
    tets = [[face[0], face[1], face[2], 8], [face[0], face[2], face[3], 8]]
    cells = np.array([hexahedron, *([*t, *t[-1:] * 4] for t in tets)])
    with pytest.raises(InputError, match="2 triangular faces lie on quadrilateral ones"):
        check_mesh(Mesh(X, cells))


