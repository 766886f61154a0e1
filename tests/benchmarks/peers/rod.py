"""Task 1, a clamped rod from its matrices, and task 2, a slider-crank with that rod, by each code.

The functions that a user of a code would write begin with its name; their lines are counted.
"""

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import skfem
from scipy import sparse
from scipy.sparse.linalg import splu
from skfem.helpers import dot
from skfem.models.elasticity import lame_parameters, linear_elasticity

from sparsemor import load, simulate
from sparsemor.core.arrays import FloatArray

sys.path.append(str(Path(__file__).parents[2] / "support"))
import calculix

E, NU, RHO = 2.1e11, 0.3, 7800.0
LENGTH, SIDE = 0.5, 0.02
ALPHA, BETA = 20.0, 1e-6
FORCE, END, STEP = 100.0, 0.05, 5e-5
RADIUS, SPEED, TURN = 0.1, 100.0, 0.05
"""Of the crank, m and rad/s; length of the run of the mechanism, s."""


def cpu_of_steps(scene: Any) -> tuple[Any, float]:
    """A run of the product, and the CPU time of its median step: seconds by the clock times the
    share of the processor that the run had."""
    cpu, clock = time.process_time(), time.perf_counter()
    run = simulate(scene)
    share = min(1.0, (time.process_time() - cpu) / (time.perf_counter() - clock))
    return run, share * float(np.median(run.step_seconds[1:]))


class Rod:
    """Matrices of second-order tetrahedra, unknowns node by node; X (N, 3), m."""

    def __init__(self, folder: Path, cells: tuple[int, int, int]) -> None:
        mesh = calculix.block((0.0, -SIDE / 2, -SIDE / 2), (LENGTH, SIDE, SIDE), cells, {
            "a": "x < 1e-9", "b": f"x > {LENGTH} - 1e-9"})
        n = mesh.nodes[:, :4].max() + 1
        basis = skfem.Basis(skfem.MeshTet(mesh.X[:n].T, mesh.nodes[:, :4].T),
                            skfem.ElementVector(skfem.ElementTetP2()), intorder=4)
        K = linear_elasticity(*lame_parameters(E, NU)).assemble(basis)
        M = RHO * skfem.BilinearForm(lambda u, v, _: dot(u, v)).assemble(basis)
        order = np.concatenate([basis.nodal_dofs, basis.edge_dofs], axis=1).T.ravel()
        self.X = np.ascontiguousarray(basis.doflocs[:, order[::3]].T)
        self.M, self.K = (sparse.csr_matrix(A[order][:, order]) for A in (M, K))
        self.a, self.b = (np.flatnonzero(np.abs(self.X[:, 0] - x) < 1e-9) for x in (0.0, LENGTH))
        self.free = np.setdiff1d(np.arange(self.X.size), (3 * self.a[:, None] + range(3)).ravel())
        self.push = np.zeros(self.X.size)
        self.push[3 * self.b + 2] = 1.0 / len(self.b)  # mean of the end along z
        self.folder = folder
        np.save(folder / "nodes.npy", self.X)
        for name, A in (("mass", self.M), ("stiffness", self.K)):
            sparse.save_npz(folder / f"{name}.npz", A)


def newmark(M: Any, D: Any, K: Any, b: FloatArray, c: FloatArray) -> FloatArray:
    """c x at each step of M x'' + D x' + K x = b from rest, by the average acceleration."""
    lu = splu(sparse.csc_matrix(M + STEP / 2 * D + STEP**2 / 4 * K))
    x = v = np.zeros(len(b))
    a = splu(sparse.csc_matrix(M)).solve(b)
    found = [0.0]
    for _ in range(round(END / STEP)):
        x, v = x + STEP * v + STEP**2 / 4 * a, v + STEP / 2 * a
        a = lu.solve(b - D @ v - K @ x)
        x, v = x + STEP**2 / 4 * a, v + STEP / 2 * a
        found.append(float(c @ x))
    return np.array(found)


def reference(rod: Rod) -> FloatArray:
    """Displacement of the end at full order."""
    K, M = (A[rod.free][:, rod.free] for A in (rod.K, rod.M))
    b = rod.push[rod.free]
    return newmark(M, ALPHA * M + BETA * K, K, FORCE * b, b)


def sparsemor_rod(rod: Rod, size: int) -> tuple[FloatArray, float]:
    np.save(rod.folder / "push.npy", rod.push)
    scene = load({
        "format": 1, "time": {"end": END, "step": STEP},
        "integrator": {"use": "generalized_alpha", "rho_inf": 1.0},
        "bodies": {"rod": {
            "use": "matrices", "nodes": str(rod.folder / "nodes.npy"),
            "mass": str(rod.folder / "mass.npz"), "stiffness": str(rod.folder / "stiffness.npz"),
            "sets": {"a": {"nodes": (rod.a + 1).tolist()}, "b": {"nodes": (rod.b + 1).tolist()}},
            "reference": {"clamp": "a"}, "frame": "fixed",
            "damping": {"mass": ALPHA, "stiffness": BETA}}},
        "loads": {"push": {"use": "point_force", "on": "rod:b", "force": [0.0, 0.0, FORCE]}},
        "probes": {"end": {"body": "rod", "at": "b"}},
        "reducer": {"use": "galerkin", "basis": {
            "use": "modal", "count": size - 1, "correction": True}}})
    run, seconds = cpu_of_steps(scene)
    return run.probe("end")[:, 5], seconds


def pymor_rod(rod: Rod, size: int) -> tuple[FloatArray, float]:
    from pymor.models.iosys import SecondOrderModel
    from pymor.reductors.basic import SOLTIPGReductor
    from pymor.reductors.interpolation import SOBHIReductor

    K, M = (A[rod.free][:, rod.free].tocsc() for A in (rod.K, rod.M))
    b = rod.push[rod.free][:, None]
    full = SecondOrderModel.from_matrices(M, ALPHA * M + BETA * K, K, b, b.T)
    points = 1j * np.geomspace(100.0, 6e4, size // 2)
    ones = np.ones((size, 1))
    reductor = SOBHIReductor(full)
    reductor.reduce(np.concatenate([points, -points]), ones, ones, projection="orth")
    small = SOLTIPGReductor(full, reductor.V, reductor.V).reduce()
    M, D, K, B, C = small.to_matrices()[:5]
    begun = time.process_time()
    found = newmark(M, D, K, FORCE * np.ravel(B), np.ravel(C))
    return found, (time.process_time() - begun) / len(found)


def exudyn_rod(rod: Rod, size: int) -> tuple[FloatArray, float]:
    import exudyn as exu
    from exudyn import utilities as item
    from exudyn.FEM import ObjectFFRFreducedOrderInterface

    system = exu.SystemContainer().AddSystem()
    fem = exudyn_modes(rod, size)
    flexible = ObjectFFRFreducedOrderInterface(fem).AddObjectFFRFreducedOrder(
        system, stiffnessProportionalDamping=BETA, massProportionalDamping=ALPHA)
    ground = system.AddMarker(item.MarkerNodeCoordinate(nodeNumber=system.AddNode(
        item.NodePointGround()), coordinate=0))
    for k in (0, 1, 2, 4, 5, 6):  # the frame is that of the clamped end
        system.AddObject(item.CoordinateConstraint(markerNumbers=[ground, system.AddMarker(
            item.MarkerNodeCoordinate(nodeNumber=flexible["nRigidBody"], coordinate=k))]))
    end = system.AddMarker(item.MarkerSuperElementPosition(
        bodyNumber=flexible["oFFRFreducedOrder"], meshNodeNumbers=rod.b.tolist(),
        weightingFactors=[1.0 / len(rod.b)] * len(rod.b)))
    system.AddLoad(item.LoadForceVector(markerNumber=end, loadVector=[0.0, 0.0, FORCE]))
    sensor = system.AddSensor(item.SensorMarker(
        markerNumber=end, storeInternal=True, outputVariableType=exu.OutputVariableType.Position))
    return exudyn_solve(system, sensor, END)


def exudyn_modes(rod: Rod, size: int) -> Any:
    from exudyn.FEM import FEMinterface, HCBstaticModeSelection

    fem = FEMinterface()
    fem.nodes["Position"] = rod.X
    fem.massMatrix, fem.stiffnessMatrix = rod.M, rod.K
    fem.ComputeHurtyCraigBamptonModes(
        [rod.a.tolist(), rod.b.tolist()], size - 6,
        computationMode=HCBstaticModeSelection.RBE2)
    return fem


def exudyn_solve(system: Any, sensor: int, end: float) -> tuple[FloatArray, float]:
    import exudyn as exu

    system.Assemble()
    s = exu.SimulationSettings()
    s.timeIntegration.numberOfSteps, s.timeIntegration.endTime = round(end / STEP), end
    s.timeIntegration.generalizedAlpha.spectralRadius = 1.0
    s.timeIntegration.newton.relativeTolerance = s.timeIntegration.newton.absoluteTolerance = 1e-9
    s.timeIntegration.verboseMode = 0
    s.solution.sensors.writePeriod = STEP
    s.solution.file.write = False
    begun = time.process_time()
    system.SolveDynamic(s)
    steps = time.process_time() - begun
    return np.array(system.GetSensorStoredData(sensor))[:, 1:], steps * STEP / end


def sparsemor_crank(rod: Rod, size: int, compiled: str = "off") -> tuple[FloatArray, float]:
    """x of the slider, and x and y of the middle of the rod, m, (m, 3)."""
    turn = [0.0, 0.0, -RADIUS * SPEED / LENGTH]
    scene = load({
        "format": 1, "time": {"end": TURN, "step": STEP},
        "integrator": {"use": "generalized_alpha", "rho_inf": 1.0},
        "bodies": {
            "crank": {"use": "rigid", "mass": 1.0, "inertia": [1.0, 1.0, 1.0],
                      "points": {"o": [0.0, 0.0, 0.0], "pin": [RADIUS, 0.0, 0.0]},
                      "pose": {"spin": [0.0, 0.0, SPEED]}},
            "rod": {
                "use": "matrices", "nodes": str(rod.folder / "nodes.npy"),
                "mass": str(rod.folder / "mass.npz"),
                "stiffness": str(rod.folder / "stiffness.npz"),
                "sets": {"a": {"nodes": (rod.a + 1).tolist()},
                         "b": {"nodes": (rod.b + 1).tolist()}},
                "reference": {"clamp": "a"}, "damping": {"stiffness": BETA},
                "pose": {"position": [RADIUS, 0.0, 0.0], "spin": turn,
                         "velocity": [0.0, RADIUS * SPEED, 0.0]}},
            "slider": {"use": "rigid", "mass": 0.5, "inertia": [1e-3, 1e-3, 1e-3],
                       "points": {"o": [0.0, 0.0, 0.0]},
                       "pose": {"position": [RADIUS + LENGTH, 0.0, 0.0]}}},
        "joints": {
            "main": {"use": "revolute", "between": ["crank:o", "ground"], "axis": [0, 0, 1]},
            "pin": {"use": "revolute", "between": ["crank:pin", "rod:a"], "axis": [0, 0, 1]},
            "wrist": {"use": "spherical", "between": ["rod:b", "slider:o"]},
            "guide": {"use": "cylindrical", "between": ["slider:o", "ground"], "axis": [1, 0, 0]}},
        "probes": {"slider": {"body": "slider", "at": "o"},
                   "middle": {"body": "rod", "at": [LENGTH / 2, 0.0, 0.0]}},
        "reducer": {"use": "galerkin", "compiled": compiled,
                    "basis": {"use": "craig_bampton", "count": size}}})
    run, seconds = cpu_of_steps(scene)
    return (np.stack([run.probe("slider")[:, 0], *run.probe("middle")[:, :2].T], axis=1),
            seconds)


def exudyn_crank(rod: Rod, size: int) -> tuple[FloatArray, float]:
    import exudyn as exu
    from exudyn import utilities as item
    from exudyn.FEM import ObjectFFRFreducedOrderInterface

    system = exu.SystemContainer().AddSystem()
    ground = system.AddMarker(item.MarkerBodyRigid(bodyNumber=system.AddObject(
        item.ObjectGround())))
    crank = system.CreateRigidBody(inertia=item.RigidBodyInertia(1.0, np.eye(3)),
                                   initialAngularVelocity=[0.0, 0.0, SPEED])
    slider = system.CreateRigidBody(inertia=item.RigidBodyInertia(0.5, 1e-3 * np.eye(3)),
                                    referencePosition=[RADIUS + LENGTH, 0.0, 0.0])
    flexible = ObjectFFRFreducedOrderInterface(
        exudyn_modes(rod, size)).AddObjectFFRFreducedOrder(
            system, positionRef=[RADIUS, 0.0, 0.0], initialVelocity=[0.0, RADIUS * SPEED, 0.0],
            initialAngularVelocity=[0.0, 0.0, -RADIUS * SPEED / LENGTH],
            stiffnessProportionalDamping=BETA)

    def of_rod(nodes: Any) -> Any:
        return system.AddMarker(item.MarkerSuperElementRigid(
            bodyNumber=flexible["oFFRFreducedOrder"], meshNodeNumbers=nodes.tolist(),
            weightingFactors=[1.0 / len(nodes)] * len(nodes)))

    def of_body(body: int, at: list[float]) -> Any:
        return system.AddMarker(item.MarkerBodyRigid(bodyNumber=body, localPosition=at))

    turning, sliding, free = [1, 1, 1, 1, 1, 0], [0, 1, 1, 0, 1, 1], [1, 1, 1, 0, 0, 0]
    for one, other, held in (
            (ground, of_body(crank, [0.0, 0.0, 0.0]), turning),
            (of_body(crank, [RADIUS, 0.0, 0.0]), of_rod(rod.a), turning),
            (of_rod(rod.b), of_body(slider, [0.0, 0.0, 0.0]), free),
            (system.AddMarker(item.MarkerBodyRigid(
                bodyNumber=system.AddObject(item.ObjectGround()),
                localPosition=[RADIUS + LENGTH, 0.0, 0.0])),
             of_body(slider, [0.0, 0.0, 0.0]), sliding)):
        system.AddObject(item.GenericJoint(markerNumbers=[one, other], constrainedAxes=held))
    middle = int(np.argmin(np.linalg.norm(rod.X - [LENGTH / 2, 0.0, 0.0], axis=1)))
    kind = {"storeInternal": True, "outputVariableType": exu.OutputVariableType.Position}
    sensors = [system.AddSensor(item.SensorBody(bodyNumber=slider, **kind)),
               system.AddSensor(item.SensorSuperElement(
                   bodyNumber=flexible["oFFRFreducedOrder"], meshNodeNumber=middle, **kind))]
    x, seconds = exudyn_solve(system, sensors[0], TURN)
    return np.column_stack([x[:, 0], np.array(system.GetSensorStoredData(sensors[1]))[:, 1:3]]), (
        seconds)
