"""Radiation between surfaces: view factors in closed form, heat between rings and between plates,
closed cavities, reduced and kept models."""

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from sparsemor import load, reduce, simulate
from sparsemor.bodies.fem.view_factors import Facets, closed, exchange_areas
from sparsemor.bodies.loads.surface_heat import STEFAN_BOLTZMANN as SIGMA
from sparsemor.core.errors import InputError


def face(corner: Any, u: Any, v: Any, n: int) -> np.ndarray:
    """Triangles of a square, with the normal u x v."""
    o, u, v = (np.array(a, dtype=np.float64) for a in (corner, u, v))
    found = []
    for i in range(n):
        for j in range(n):
            a, b, c, d = (o + (u * k + v * m) / n for k, m in (
                (i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)))
            found += [[a, b, c], [a, c, d]]
    return np.array(found)


@pytest.mark.full
def test_a_cube() -> None:
    """F = 0.199825 between opposite faces, and the rows have the sum 1."""
    x, y, z = np.eye(3)
    faces = [face(0 * x, x, y, 2), face(z, y, x, 2), face(0 * x, y, z, 2), face(x, z, y, 2),
             face(0 * x, z, x, 2), face(y, x, z, 2)]
    F = exchange_areas(Facets.from_corners(np.concatenate(faces)), np.repeat(np.arange(6), 8), 0)
    assert F[0, 1] == pytest.approx(0.199825, abs=1e-6)
    assert F[0, 2] == pytest.approx(0.2000437, abs=1e-6)
    assert np.allclose(F.sum(axis=1), 1.0, atol=1e-5) and np.allclose(F, F.T, atol=1e-12)


def segments(a: Any, b: Any, n: int) -> np.ndarray:
    x = np.linspace(a, b, n + 1)
    return np.stack([x[:-1], x[1:]], axis=1)


def test_plates_and_a_wall_between() -> None:
    """Plates of width and distance 1 in the plane: sqrt(2) - 1; a wall of the half width in the
    middle between them leaves what crossed strings around it give."""
    plates = [segments([1, 0], [0, 0], 8), segments([0, 1], [1, 1], 8)]
    S = exchange_areas(Facets.from_corners(np.concatenate(plates)), np.repeat([0, 1], 8), 0)
    assert S[0, 1] == pytest.approx(np.sqrt(2) - 1, rel=1e-12)
    wall = [segments([0.0, 0.5], [0.5, 0.5], 4), segments([0.5, 0.5], [0.0, 0.5], 4)]
    S = exchange_areas(Facets.from_corners(np.concatenate([*plates, *wall])),
                       np.concatenate([np.arange(16), np.full(8, 16)]), 0)
    # strings: straight ones of 1 on the right, around the wall's end on the left
    want = 0.5 * (2 * np.sqrt(2) - 1 - 2 * np.hypot(0.5, 0.5))
    assert S[:8, 8:16].sum() == pytest.approx(want, rel=0.02)


def sphere(radius: float, divisions: int, inwards: bool) -> np.ndarray:
    """Triangles of a divided octahedron on a sphere."""
    T = np.array([[[1, 0, 0], [0, 1, 0], [0, 0, 1]]], dtype=np.float64)
    for _ in range(divisions):
        m = 0.5 * (T + T[:, [1, 2, 0]])
        T = np.concatenate([
            np.stack(c, axis=1) for c in (
                (T[:, 0], m[:, 0], m[:, 2]), (m[:, 0], T[:, 1], m[:, 1]),
                (m[:, 2], m[:, 1], T[:, 2]), (m[:, 0], m[:, 1], m[:, 2]))])
    T /= np.linalg.norm(T, axis=2)[:, :, None]
    parts = []
    for signs in np.stack(np.meshgrid(*[[1, -1]] * 3), axis=-1).reshape(-1, 3):
        parts.append(T * signs if signs.prod() > 0 else (T * signs)[:, ::-1])
    found = radius * np.concatenate(parts)
    return found[:, ::-1] if inwards else found


@pytest.mark.full
def test_concentric_spheres() -> None:
    """F_12 = 1, F_21 = (r_1 / r_2)^2, F_22 = 1 - F_21, with the
    areas of the polyhedra."""
    one, two = sphere(0.5, 1, False), sphere(1.0, 2, True)
    facets = Facets.from_corners(np.concatenate([one, two]))
    patch = np.concatenate([np.arange(len(one)) // 4, len(one) // 4 + np.arange(len(two)) // 16])
    S, k = exchange_areas(facets, patch, 0), len(one) // 4
    A = np.bincount(patch, facets.areas)
    assert S[:k].sum() == pytest.approx(A[:k].sum(), rel=1e-3)
    ratio = A[:k].sum() / A[k:].sum()
    assert S[k:, :k].sum() / A[k:].sum() == pytest.approx(ratio, rel=1e-3)
    assert S[k:, k:].sum() / A[k:].sum() == pytest.approx(1 - ratio, rel=0.02)
    rows = closed(S, A).sum(axis=1)
    assert np.allclose(rows, A, rtol=1e-12)


def ring(path: Path, inner: float, outer: float, n: int) -> dict[str, Any]:
    """Mesh of quadrilaterals between two circles."""
    a = np.arange(n) * 2 * np.pi / n
    X = np.concatenate([r * np.stack([np.cos(a), np.sin(a)], axis=1) for r in (
        inner, 0.5 * (inner + outer), outer)])
    i, j = np.arange(n), (np.arange(n) + 1) % n
    cells = np.concatenate([np.stack([i, n + i, n + j, j], axis=1) + k * n for k in (0, 1)])
    meshio.write(path, meshio.Mesh(np.c_[X, 0 * X[:, 0]], [("quad", cells)]))
    return {"use": "flexible", "mesh": {"use": "file", "path": str(path)}, "thickness": 0.1,
            "material": {"rho": 1000.0, "k": 1e5, "c": 1000.0}, "fields": ["thermal"],
            "frame": "fixed",
            "sets": {"in": {"where": f"x*x + y*y < {(1.001 * inner) ** 2}"},
                     "out": {"where": f"x*x + y*y > {(0.999 * outer) ** 2}"}}}


def rings(folder: Path, **more: Any) -> dict[str, Any]:
    """A hot ring inside a cold one."""
    one, two = (ring(folder / f"{r}.vtu", r, r + 0.1, 32) for r in (0.1, 0.4))
    one["initial_temperature"] = 900.0
    return {"format": 1, "bodies": {"hot": one, "cold": two}, "reducer": "full",
            "integrator": "bdf1",
            "loads": {"gap": {"use": "cavity_radiation", "on": ["hot:out", "cold:in"],
                              "emissivity": 0.8, "emissivities": {"cold:in": 0.5}}},
            "time": {"end": 100.0, "step": 20.0}, **more}


@pytest.mark.full
def test_heat_between_rings(tmp_path: Path) -> None:
    """A_1 sigma (T_1^4 - T_2^4) / (1 / eps_1 + A_1 / A_2 (1 / eps_2 - 1)) leaves one and arrives at
    the other, for black and grey surfaces."""
    for eps_1, eps_2 in ((1.0, 1.0), (0.8, 0.5)):
        data = rings(tmp_path, time={"end": 0.01, "step": 0.01})
        data["loads"]["gap"] |= {"emissivity": eps_1, "emissivities": {"cold:in": eps_2}}
        run = simulate(load(data))
        heat = run.summary["heat_balance"]
        went, came = (heat[f"{n}.thermal"]["stored"] for n in ("hot", "cold"))
        A = 32 * 2 * 0.2 * np.sin(np.pi / 32) * 0.1
        want = A * SIGMA * (900.0**4 - 293.15**4) / (1 / eps_1 + 0.5 * (1 / eps_2 - 1))
        assert -went / 0.01 == pytest.approx(want, rel=1e-4)
        assert came == pytest.approx(-went, rel=1e-6)
    assert any("view factors were corrected by up to" in n for n in run.summary["information"])


@pytest.mark.full
@pytest.mark.parametrize("reducer", ["sparse", "ecsw"])
def test_reduced_and_kept_models(tmp_path: Path, reducer: str) -> None:
    data = rings(tmp_path)
    for body in data["bodies"].values():
        body["material"]["k"] = 50.0
    data["time"] = {"end": 2000.0, "step": 100.0}
    data["loads"]["sun"] = {"use": "heat_flux", "on": ["hot:in"], "flux": 2e4}
    scene = load(data)
    full = simulate(scene)
    small = scene.using({"reducer": {"use": reducer, "basis": {"use": "pod", "count": 8}}})
    for run in (simulate(small), reduce(small).run()):
        for name in ("hot", "cold"):
            T = full.nodal_temperature(name, -1)
            assert np.abs(run.nodal_temperature(name, -1) - T).max() < 1e-3 * abs(T - 900).max()


def plates(angle: float = 0.0, **more: Any) -> dict[str, Any]:
    """Two square plates in space at a distance of their side, hot and cold, turned about x."""
    def plate(z: float, T: float) -> dict[str, Any]:
        return {"use": "flexible", "mesh": {"use": "block", "lower": [0.0, 0.0, 0.0],
                                            "size": [1.0, 1.0, 0.1], "divisions": [2, 2, 1]},
                "material": {"rho": 1000.0, "k": 1e5, "c": 1000.0}, "fields": ["thermal"],
                "frame": "fixed", "initial_temperature": T, "pose": {
                    "position": [0.0, -z * np.sin(angle), z * np.cos(angle)],
                    "axis": [1.0, 0.0, 0.0], "angle": angle}}
    return {"format": 1, "bodies": {"below": plate(-0.1, 900.0), "above": plate(1.0, 500.0)},
            "loads": {"gap": {"use": "cavity_radiation", "on": ["below:top", "above:bottom"],
                              "emissivity": 1.0, "surroundings": 300.0}},
            "reducer": "full", "integrator": "bdf1", "time": {"end": 0.01, "step": 0.01}, **more}


@pytest.mark.full
def test_plates_in_space() -> None:
    """Black: sigma (T_1^4 - F T_2^4 - (1 - F) T_a^4), F = 0.199825; grey as two equations give."""
    F = 0.199825
    for eps, angle in ((1.0, 0.0), (0.6, 0.7)):
        data = plates(angle)
        data["loads"]["gap"]["emissivity"] = eps
        heat = simulate(load(data)).summary["heat_balance"]
        E, Ea = SIGMA * np.array([900.0, 500.0]) ** 4, SIGMA * 300.0**4
        J = np.linalg.solve([[1, -(1 - eps) * F], [-(1 - eps) * F, 1]],
                            eps * E + (1 - eps) * (1 - F) * Ea)
        want = J - F * J[::-1] - (1 - F) * Ea
        found = [-heat[f"{n}.thermal"]["stored"] / 0.01 for n in ("below", "above")]
        assert found == pytest.approx(want.tolist(), rel=2e-4)


@pytest.mark.full
def test_an_open_cavity_needs_surroundings(tmp_path: Path) -> None:
    data = plates()
    del data["loads"]["gap"]["surroundings"]
    with pytest.raises(InputError, match=r"the cavity is open: .* add up to 0\.2"):
        simulate(load(data))
    data = rings(tmp_path)
    data["bodies"]["cold"]["thickness"] = 0.2
    with pytest.raises(InputError, match="different thicknesses"):
        simulate(load(data))
    data = rings(tmp_path)
    data["loads"]["gap"]["emissivities"] = {"cold:out": 0.5}
    with pytest.raises(InputError, match="is none of the surfaces"):
        simulate(load(data))


def test_bodies_of_revolution_are_refused(tmp_path: Path) -> None:
    body = {"use": "flexible", "mesh": {"use": "rectangle", "lower": [0.1, 0.0], "size": [0.1, 0.1],
                                        "divisions": [2, 2]}, "axisymmetric": True,
            "material": {"rho": 1000.0, "k": 1.0, "c": 1000.0}, "fields": ["thermal"],
            "frame": "fixed"}
    data = rings(tmp_path, bodies={"tube": body})
    data["loads"]["gap"] = {"use": "cavity_radiation", "on": ["tube:left"], "emissivity": 0.5}
    with pytest.raises(InputError, match="of axisymmetric bodies"):
        simulate(load(data))
