"""Conduction in a slab under a heat flux, against the series solution, and the heat balance."""

from pathlib import Path

import numpy as np
import pytest
from scipy.sparse.linalg import splu

from sparsemor.bodies.fem import integrals
from sparsemor.bodies.mesh.generators.rectangle import Rectangle
from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols.mesh import Mesh

FLUX = 1e6


def series(s: float, length: float, k: float, rho_c: float, t: float) -> float:
    """Rise (K) at s of a slab insulated at 0 and heated by FLUX at `length` (Carslaw, Jaeger)."""
    fourier = k / rho_c * t / length**2
    n = np.arange(1, 400)
    tail = (-1.0) ** n / n**2 * np.exp(-((n * np.pi) ** 2) * fourier)
    steady = fourier + (3 * s**2 - length**2) / (6 * length**2)
    waves = 2 / np.pi**2 * np.sum(tail * np.cos(n * np.pi * s / length))
    return float(FLUX * length / k * (steady - waves))


def heated(mesh: Mesh, k: float, rho_c: float, h: float, steps: list[int]) -> list[FloatArray]:
    """Rises by implicit Euler with one factorised matrix, at the given steps."""
    capacity, conduction = integrals.capacity(mesh, rho_c, 1.0), integrals.conductivity(mesh, k)
    top = integrals.boundary_facets(mesh, mesh.point_sets["top"])
    heat = FLUX * integrals.surface_load(mesh, top)
    solver = splu((capacity / h + conduction).tocsc())
    rise, found = np.zeros(len(mesh.points)), []
    for step in range(1, max(steps) + 1):
        rise = solver.solve(capacity @ rise / h + heat)
        if step in steps:
            found.append(rise)
    return found


def slab(length: float, divisions: int) -> Mesh:
    return Rectangle(size=(length / divisions, length), divisions=(1, divisions)).build(Path())


@pytest.mark.parametrize(
    "s,t,rise",
    [(1.25e-3, 1.275e-3, 2.11038), (1.25e-3, 2.55e-3, 2.98455), (1.25e-3, 3.75e-3, 3.61980),
     (0.0, 3.75e-3, 0.23579)],
)
def test_series_of_the_slider(s: float, t: float, rise: float) -> None:
    assert series(s, 1.25e-3, 150.0, 2.43e6, t) == pytest.approx(rise, abs=2e-5)


def test_slider_slab() -> None:
    mesh = slab(1.25e-3, 50)
    found = heated(mesh, 150.0, 2.43e6, 1.25e-6, [1020, 2040, 3000])
    surface = [float(rise[mesh.point_sets["top"]].mean()) for rise in found]
    assert surface == pytest.approx([2.11038, 2.98455, 3.61980], rel=1e-3)
    assert found[-1][mesh.point_sets["bottom"]].mean() == pytest.approx(0.23579, rel=1e-2)


def test_link_slab() -> None:
    times = [1.0, 2.332, 3.73, 4.0]
    exact = [series(0.17, 0.17, 44.5, 475e3, t) for t in times]
    assert exact == pytest.approx([245.43, 374.79, 474.00, 490.86], abs=6e-3)
    mesh = slab(0.17, 100)
    found = heated(mesh, 44.5, 475e3, 1e-3, [round(1e3 * t) for t in times])
    assert [float(rise.max()) for rise in found] == pytest.approx(exact, rel=2e-3)


def test_all_heat_that_enters_is_stored() -> None:
    mesh = slab(0.17, 20)
    width = 0.17 / 20
    rise = heated(mesh, 44.5, 475e3, 1e-2, [100])[0]
    stored = float(np.sum(integrals.capacity(mesh, 475e3, 1.0) @ rise))
    assert stored == pytest.approx(FLUX * width * 1.0, rel=1e-11)
