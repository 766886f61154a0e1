"""Task 3, transient heat with k(T), by hyper-reduction in each code; lines counted as in rod.py."""

import time
from pathlib import Path
from typing import Any

import numpy as np
import skfem
from rod import cpu_of_steps
from scipy.sparse.linalg import splu
from skfem.helpers import dot, grad

from sparsemor import load
from sparsemor.core.arrays import FloatArray

SIZE, RHO, C, K0, SLOPE, T0 = 0.1, 7800.0, 500.0, 40.0, 0.002, 300.0
"""m; k = K0 (1 + SLOPE (T - T0)), W/(m K)."""
FLUX, END, STEP = 2e5, 60.0, 0.5


class Plate:
    """Square with T0 on the left, a flux on the top; nonlinear force by skfem."""

    def __init__(self, cells: int) -> None:
        at = np.linspace(0.0, SIZE, cells + 1)
        self.mesh = skfem.MeshTri.init_tensor(at, at)
        self.basis = skfem.Basis(self.mesh, skfem.ElementTriP1(), intorder=2)
        self.M = RHO * C * skfem.BilinearForm(lambda u, v, _: u * v).assemble(self.basis)
        edge = skfem.FacetBasis(self.mesh, self.basis.elem, facets=self.mesh.facets_satisfying(
            lambda x: x[1] > SIZE - 1e-9))
        self.f = FLUX * skfem.LinearForm(lambda v, _: v / 2.0).assemble(edge)
        self.free = np.setdiff1d(np.arange(self.basis.N), self.basis.get_dofs(
            lambda x: x[0] < 1e-9).all())
        self.M, self.f = self.M[self.free][:, self.free].tocsc(), self.f[self.free]

    def force(self, u: FloatArray, cells: Any = None) -> FloatArray:
        """k(T) grad T . grad v, u = T - T0 of the free unknowns."""
        basis, whole = self._of(cells), np.zeros(self.basis.N)
        whole[self.free] = u
        form = skfem.LinearForm(lambda v, w: K0 * (1 + SLOPE * w["u"]) * dot(grad(w["u"]), grad(v)))
        return np.asarray(form.assemble(basis, u=basis.interpolate(whole))[self.free])

    def tangent(self, u: FloatArray, cells: Any = None) -> Any:
        basis, whole = self._of(cells), np.zeros(self.basis.N)
        whole[self.free] = u
        form = skfem.BilinearForm(lambda t, v, w: K0 * (1 + SLOPE * w["u"]) * dot(
            grad(t), grad(v)) + K0 * SLOPE * t * dot(grad(w["u"]), grad(v)))
        A = form.assemble(basis, u=basis.interpolate(whole))
        return A[self.free][:, self.free].tocsc()

    def _of(self, cells: Any) -> Any:
        if cells is None:
            return self.basis
        key = tuple(cells)
        if key not in self._small:
            self._small[key] = skfem.Basis(self.mesh, self.basis.elem, elements=cells, intorder=2)
        return self._small[key]

    _small: dict[Any, Any] = {}

    def touching(self, rows: Any) -> Any:
        """Cells of the rows."""
        return np.flatnonzero(np.isin(self.mesh.t, self.free[rows]).any(axis=0))


def euler(M: Any, force: Any, tangent: Any, f: FloatArray, solve: Any) -> FloatArray:
    """States (m, n) of M u' + force(u) = f by the implicit Euler method, Newton in each step."""
    u, found = np.zeros(len(f)), []
    for _ in range(round(END / STEP)):
        old = u
        for _ in range(20):
            r = M @ (u - old) / STEP + force(u) - f
            du = solve(M / STEP + tangent(u), r)
            u = u - du
            if np.abs(du).max() < 1e-9 * max(np.abs(u).max(), 1e-9):
                break
        found.append(u)
    return np.array(found)


def reference(p: Plate) -> FloatArray:
    return euler(p.M, p.force, p.tangent, p.f, lambda A, b: splu(A.tocsc()).solve(b))


def sparsemor_heat(p: Plate, X: FloatArray, size: int, folder: Path, use: str) -> Any:
    import meshio

    meshio.write_points_cells(folder / "plate.vtu", np.pad(p.mesh.p.T, ((0, 0), (0, 1))),
                              [("triangle", p.mesh.t.T)])
    scene = load({
        "format": 1, "time": {"end": END, "step": STEP}, "integrator": "bdf1",
        "bodies": {"p": {
            "use": "flexible", "mesh": {"use": "file", "path": str(folder / "plate.vtu")},
            "order": 1, "thickness": 1.0, "fields": ["thermal"], "frame": "fixed",
            "sets": {"left": {"where": "x < 1e-9"}, "top": {"where": f"y > {SIZE} - 1e-9"}},
            "material": {"rho": RHO, "c": C, "k": {"temperatures": [T0, T0 + 1e3],
                         "values": [K0, K0 * (1 + SLOPE * 1e3)]}},
            "initial_temperature": T0}},
        "joints": {"cold": {"use": "prescribed_temperature", "on": ["p:left"], "temperature": T0}},
        "loads": {"hot": {"use": "heat_flux", "on": ["p:top"], "flux": FLUX / 2}},
        "reducer": use if use == "full" else {
            "use": use, "basis": {"use": "pod", "count": size}}})
    run, seconds = cpu_of_steps(scene)
    T = np.stack([run.nodal_temperature("p", k) for k in range(1, len(run.times))])
    return (T - T0)[:, p.free], seconds


def pymor_heat(p: Plate, X: FloatArray, size: int) -> Any:
    from pymor.algorithms.ei import deim
    from pymor.algorithms.pod import pod
    from pymor.vectorarrays.numpy import NumpyVectorSpace

    space = NumpyVectorSpace(len(p.free))
    V = pod(space.from_numpy(X.T), modes=size)[0].to_numpy()
    F = np.array([p.force(x) for x in X])
    rows, collateral, _ = deim(space.from_numpy(F.T), modes=size + 4)
    return projected(p, V, np.asarray(rows), collateral.to_numpy())


def romtools_heat(p: Plate, X: FloatArray, size: int) -> Any:
    from romtools.hyper_reduction.deim import deim_get_indices
    from romtools.vector_space import VectorSpaceFromPOD
    from romtools.vector_space.utils import BasisSizeTruncater

    def of(values: FloatArray, count: int) -> FloatArray:
        return np.asarray(VectorSpaceFromPOD(
            snapshots=values.T[None], truncater=BasisSizeTruncater(count)).get_basis()[0])

    V = of(X, size)
    U = of(np.array([p.force(x) for x in X]), size + 4)
    return projected(p, V, np.asarray(deim_get_indices(U)), U)


def projected(p: Plate, V: FloatArray, rows: Any, U: FloatArray) -> Any:
    """Galerkin projection with the forces of the sampled rows alone."""
    left, cells = V.T @ U @ np.linalg.inv(U[rows]), p.touching(rows)
    M, f = V.T @ (p.M @ V), V.T @ p.f
    begun = time.process_time()
    q = euler(M, lambda q: left @ p.force(V @ q, cells)[rows],
              lambda q: left @ (p.tangent(V @ q, cells)[rows] @ V), f, np.linalg.solve)
    return q @ V.T, (time.process_time() - begun) / len(q)
