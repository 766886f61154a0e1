"""Bodies from matrices: the same motion as `flexible`, whose matrices they are."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.sparse import diags_array

from exported_matrices import built, instead
from reduced_runs import learnt
from sparsemor.bodies.flexible import Flexible
from sparsemor.bodies.floating_body import FloatingBody
from sparsemor.bodies.frames.mass_moments import MassProperties
from sparsemor.bodies.matrices.matrix_body import MatrixBody
from sparsemor.core.testing.in_memory_run import march, scene_of

CRANK: dict[str, Any] = {
    "bodies": {
        "crank": {"use": "rigid", "mass": 1.2, "inertia": 4e-3,
                  "points": {"hub": [0.0, 0.0], "pin": [0.1, 0.0]}},
        "rod": {"use": "flexible", "fields": ["elastic"], "thickness": 0.01, "order": 2,
                "mesh": {"use": "rectangle", "lower": [0.0, -0.01], "size": [0.4, 0.02],
                         "divisions": [6, 2]},
                "sets": {"a": {"nearest": [0.0, 0.0]}, "b": {"nearest": [0.4, 0.0]}},
                "material": {"E": 2e9, "nu": 0.3, "rho": 7850}, "reference": {"chord": ["a", "b"]},
                "damping": {"stiffness": 1e-5, "ratio": 0.01, "modes": 4},
                "pose": {"position": [0.1, 0.0]}},
        "piston": {"use": "rigid", "mass": 0.8, "inertia": 1e-3, "points": {"pin": [0.0, 0.0]},
                   "pose": {"position": [0.5, 0.0]}}},
    "joints": {
        "hub": {"use": "revolute", "between": ["ground", "crank:hub"]},
        "crank_pin": {"use": "revolute", "between": ["crank:pin", "rod:a"]},
        "wrist_pin": {"use": "revolute", "between": ["rod:b", "piston:pin"]},
        "guide": {"use": "prismatic", "between": ["ground", "piston:pin"], "axis": [1.0, 0.0]}},
    "loads": {"motor": {"use": "torque", "on": "crank:hub", "torque": 25.0},
              "push": {"use": "point_force", "on": "rod:top", "force": [0.0, -20.0]},
              "weight": {"use": "gravity"}},
    "time": {"end": 0.02, "step": 1e-3}, "probes": {"tip": {"body": "rod", "at": "top"}}}
SPACE: dict[str, Any] = {
    "bodies": {"bar": {
        "use": "flexible", "fields": ["elastic"], "material": {"E": 2e8, "nu": 0.3, "rho": 1100},
        "mesh": {"use": "block", "lower": [-0.1, -0.05, -0.03], "size": [0.5, 0.1, 0.06],
                 "divisions": [3, 1, 1]},
        "reference": {"chord": ["left_front_bottom", "right_front_bottom", "left_back_bottom"]},
        "pose": {"position": [0.3, -0.2, 0.1], "axis": [1, 2, 3], "angle": 0.4,
                 "spin": [1.0, -2.0, 4.0]}}},
    "joints": {"hinge": {"use": "spherical", "between": ["ground", "bar:left"]}},
    "loads": {"weight": {"use": "gravity", "g": [0.0, 0.0, -9.81]}},
    "time": {"end": 0.02, "step": 1e-3}, "probes": {"tip": {"body": "bar", "at": "right"}}}


def both(tree: dict[str, Any], name: str, folder: Path, reducer: dict[str, Any] | None = None,
         kind: str = "npz") -> tuple[Any, Any]:
    """Paths of the tip of a flexible body, and of that from its matrices."""
    paths = []
    for one in (tree, instead(tree, name, built(scene_of(tree), name), folder, kind)):
        full = march(scene_of({**one, "reducer": {"use": "full"}}))
        got = full if reducer is None else march(
            scene_of({**one, "reducer": reducer}), model=full.model, snapshots=learnt(full))
        probe, maps = full.model.probes[0], got.solver.dictionaries
        u = got.block(f"{name}.elastic")
        if f"{name}.elastic" in maps:
            m = maps[f"{name}.elastic"]
            u = m.offset + u @ m.atoms.T
        paths.append(np.hstack([got.block(f"{name}.rigid"), u @ probe.displacement]))
    return paths[0], paths[1]


REDUCERS: dict[str, dict[str, Any]] = {
    "galerkin": {"use": "galerkin", "basis": {"use": "pod", "count": 4}},
    "modal": {"use": "galerkin", "basis": {"use": "modal", "count": 6}},
    "craig_bampton": {"use": "galerkin", "basis": {"use": "craig_bampton", "count": 6}},
    "static": {"use": "galerkin", "basis": {"use": "static"}},
    "deim": {"use": "deim", "basis": {"use": "pod", "count": 4}},
    "ecsw": {"use": "ecsw", "basis": {"use": "pod", "count": 4}},
    "lspg": {"use": "lspg", "basis": {"use": "pod", "count": 4}},
    "gnat": {"use": "gnat", "basis": {"use": "pod", "count": 4}},
    "sparse": {"use": "sparse", "basis": {"use": "pod", "count": 4}}}


def same(one: Any, two: Any, share: float = 1e-8) -> None:
    assert np.ptp(one[:, -1]) > 1e-6  # it bends
    np.testing.assert_allclose(two, one, rtol=0.0, atol=share * np.ptp(one, axis=0).max())


@pytest.mark.full
@pytest.mark.parametrize("kind", ["npz", "mtx", "mat"])
def test_a_crank_with_a_rod_from_its_matrices(kind: str, tmp_path: Path) -> None:
    same(*both(CRANK, "rod", tmp_path, None, kind))


@pytest.mark.full
def test_a_bar_in_space_from_its_matrices(tmp_path: Path) -> None:
    same(*both(SPACE, "bar", tmp_path))


@pytest.mark.full
@pytest.mark.parametrize("name, scene", [
    (name, ("plane", "space")[i % 2]) for i, name in enumerate(REDUCERS)])
def test_reduced_runs_are_those_of_the_mesh(name: str, scene: str, tmp_path: Path) -> None:
    tree, body = (CRANK, "rod") if scene == "plane" else (SPACE, "bar")
    # the least squares of GNAT leave a residual, so its iteration ends at its own tolerance
    same(*both(tree, body, tmp_path, REDUCERS[name]), 1e-6 if name == "gnat" else 1e-8)


class Lumped(Flexible):
    """The same body with a lumped mass matrix."""

    def build(self, name: str, base: Path) -> FloatingBody:
        body = super().build(name, base)
        m = diags_array(np.asarray(body.mass_matrix.sum(axis=1)).ravel(), format="csr")
        return replace(body, mass_matrix=m, inertia=MassProperties.of_mesh(m, body.X))


@pytest.mark.full
def test_lumped_masses(tmp_path: Path) -> None:
    tree, name = SPACE, "bar"
    simple = tree["bodies"][name] | {"order": 1, "damping": {}}
    both_of = {**tree, "bodies": {**tree["bodies"], name: simple}}
    body = Lumped(**dict(scene_of(both_of).bodies[name]))
    given = instead(both_of, name, body.build(name, Path()), tmp_path)
    paths = [march(scene_of(one)).block(f"{name}.rigid") for one in (
        {**tree, "bodies": {**tree["bodies"], name: body}}, given)]
    np.testing.assert_allclose(paths[1], paths[0], rtol=0.0, atol=1e-9)


@pytest.mark.full
def test_a_hot_rod(tmp_path: Path) -> None:
    """Heat that is let in at one end, expansion, prescribed temperature: as with a mesh."""
    rod = CRANK["bodies"]["rod"]
    hot = {**CRANK, "bodies": {**CRANK["bodies"], "rod": rod | {
        "fields": ["elastic", "thermal"], "initial_temperature": "300 + 50 * x", "material": {
            **rod["material"], "alpha": 1e-5, "k": 4e4, "c": 480}}}}
    hot["joints"] = {**CRANK["joints"], "ice": {
        "use": "prescribed_temperature", "on": ["rod:left"], "temperature": 273.0}}
    ends = [march(scene_of(one)) for one in (
        hot, instead(hot, "rod", built(scene_of(hot), "rod"), tmp_path))]
    for block in ("rod.rigid", "rod.elastic", "rod.thermal"):
        one, two = (e.block(block) for e in ends)
        assert np.ptp(one, axis=0).max() > 1e-5
        np.testing.assert_allclose(two, one, rtol=1e-8, atol=1e-8 * np.abs(one).max())


SCENES = Path(__file__).parents[2] / "scenes"
BAR: dict[str, Any] = {
    "use": "matrices", "nodes": str(SCENES / "matrices" / "bar.inp"),
    "mass": str(SCENES / "matrices" / "bar.mas"),
    "stiffness": str(SCENES / "matrices" / "bar.sti"),
    "units": {"length": 1e-3, "mass": 1e3}, "reference": {"clamp": "Left"}}
"""Free bar 0.2 x 0.02 x 0.02 m of two C3D8 by CalculiX 2.20, in mm, t and s."""


def alone(body: dict[str, Any]) -> Any:
    return scene_of({"bodies": {"bar": body}, "time": {"end": 0.01, "step": 1e-3}})


def held(body: Any) -> Any:
    """Angular frequencies of the free unknowns, rad/s."""
    F = body.elasticity.free
    M = body.mass if isinstance(body, MatrixBody) else None
    assert M is not None
    K, M = (A[F][:, F].toarray() for A in (body.elasticity.stiffness, M))
    return np.sqrt(eigh(K, M, eigvals_only=True))


def test_matrices_of_calculix() -> None:
    """Its own lowest frequency of this bar, clamped at the left end, is 8371.030 rad/s."""
    body = built(alone(BAR), "bar")
    m, a, h = 7850 * 0.2 * 0.02 * 0.02, 0.2, 0.02
    assert body.inertia is not None
    np.testing.assert_allclose(body.inertia.mass, m, rtol=1e-9)
    np.testing.assert_allclose(body.inertia.moment, [m * a / 2, m * h / 2, m * h / 2], rtol=1e-9)
    np.testing.assert_allclose(np.diag(body.inertia.second), m / 3 * np.array([a, h, h])**2,
                               rtol=1e-9)
    np.testing.assert_allclose(held(body)[:2], 8371.030, rtol=1e-6)


def test_matrices_of_abaqus(tmp_path: Path) -> None:
    """The entries of the same bar in the two formats of `*MATRIX GENERATE`."""
    labels = [line.split(".") for line in (SCENES / "matrices" / "bar.dof").read_text().split()]
    one = built(alone(BAR), "bar")
    for form in ("input", "coordinate"):
        options = {**BAR, "units": BAR["units"]}
        for key, name in (("mass", "bar.mas"), ("stiffness", "bar.sti")):
            lines = []
            for line in (SCENES / "matrices" / name).read_text().splitlines():
                i, j, v = line.split()
                if form == "input":
                    (a, b), (c, e) = labels[int(i) - 1], labels[int(j) - 1]
                    lines.append(f"{a},{b}, {c},{e}, {v}")
                else:
                    lines.append(f"   {i}  {j}  {v}")
            options[key] = str(tmp_path / f"{form}_{key.upper()}1.mtx")
            Path(options[key]).write_text("\n".join(lines) + "\n")
        two = built(alone(options), "bar")
        assert one.elasticity is not None and two.elasticity is not None
        np.testing.assert_array_equal(two.elasticity.free, one.elasticity.free)
        assert abs(two.elasticity.stiffness - one.elasticity.stiffness).max() == 0.0


def punch(name: str, A: Any, labels: Any) -> str:
    """Matrix in DMIG cards of 16 columns, one triangle, as EXTSEOUT writes them."""
    lines = [f"DMIG    {name:<8}{0:>8}{6:>8}{2:>8}{0:>8}{'':8}{len(A):>8}"]
    for j, (node, way) in enumerate(labels):
        lines.append(f"DMIG*   {name:<16}{node:>16}{way:>16}")
        for i in range(j + 1):
            if A[i, j]:
                value = f"{A[i, j]:.9E}".replace("E", "D")
                lines.append(f"*       {labels[i][0]:>16}{labels[i][1]:>16}{value:>16}")
    return "\n".join(lines) + "\n"


def test_matrices_of_nastran(tmp_path: Path) -> None:
    one, n = built(alone(BAR), "bar"), 12
    assert isinstance(one, MatrixBody) and one.elasticity is not None and one.mass is not None
    labels = [tuple(map(int, line.split("."))) for line in
              (SCENES / "matrices" / "bar.dof").read_text().split()]
    K, M = one.elasticity.stiffness.toarray(), one.mass.toarray()
    (tmp_path / "bar.pch").write_text(punch("KAAX", K, labels) + punch("MAAX", M, labels))
    ids = list(dict.fromkeys(node for node, _ in labels))
    (tmp_path / "bar.bdf").write_text("".join(
        f"GRID,{node},,{x[0]},{x[1]},{x[2]}\n" for node, x in zip(ids, one.X, strict=True)))
    two = built(alone({
        "use": "matrices", "nodes": str(tmp_path / "bar.bdf"),
        "mass": str(tmp_path / "bar.pch:MAAX"), "stiffness": str(tmp_path / "bar.pch:KAAX"),
        "sets": {"Left": {"nodes": ids[: n // 3]}}, "reference": {"clamp": "Left"}}), "bar")
    assert isinstance(two, MatrixBody) and two.elasticity is not None and two.mass is not None
    np.testing.assert_allclose(two.elasticity.stiffness.toarray(), K, rtol=1e-8, atol=1.0)
    np.testing.assert_allclose(two.mass.toarray(), M, rtol=1e-8, atol=1e-12)


def test_matrices_of_ansys(tmp_path: Path) -> None:
    """Example of ansys-mapdl-reader, a clamped beam of 321 nodes, and its frequencies, Hz, as in
    the reader's manual."""
    reader = pytest.importorskip("ansys.mapdl.reader")
    folder = Path(reader.__file__).parent / "examples"
    result = reader.read_binary(str(folder / "file.rst"))
    rows = np.column_stack([result.mesh.nnum, result.mesh.nodes])
    np.savetxt(tmp_path / "nodes.csv", rows, fmt=["%d", "%.17g", "%.17g", "%.17g"], delimiter=",")
    body = built(alone({
        "use": "matrices", "nodes": str(tmp_path / "nodes.csv"), "frame": "fixed",
        "mass": str(folder / "file.full:M"), "stiffness": str(folder / "file.full:K")}), "bar")
    found = held(body)[:4] / (2.0 * np.pi)
    np.testing.assert_allclose(found, [1283.200, 1283.200, 5781.975, 6919.399], rtol=1e-6)


