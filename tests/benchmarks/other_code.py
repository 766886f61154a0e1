"""Flexible pendulums computed by other codes: where the tip is, and how far apart.

    python tests/benchmarks/other_code.py [--quick] [--without-exudyn] [--out other_code.json]

One bar on a hinge, and two bars in a chain, released from rest under gravity, plane stress, 48
triangles a bar, 1 s. Exudyn (`pip install exudyn`, no part of the product) has a floating frame
too, in space: its ObjectFFRF gets the mass and stiffness matrices and takes the same steps. The
other computation has absolute coordinates, finite strains and an explicit method of order 4
(tests/support/absolute_pendulum.py): strains are small in one theory and finite in the other, so
that the distance falls as the bars get stiffer.
"""

import argparse
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

import common  # noqa: F401  # before NumPy: it limits linear algebra to one thread
import numpy as np
from modules import report
from scipy import sparse

from sparsemor.bodies.floating_body import FloatingBody
from sparsemor.core.arrays import FloatArray
from sparsemor.core.testing.in_memory_run import March

sys.path.append(str(Path(__file__).parents[1] / "support"))
from absolute_pendulum import (
    G,
    absolute_tip,
    bodies_of,
    displacements,
    nodes_of,
    swing,
    tip,
)

INTERVAL = 0.01
"""Of the compared positions, s."""
LIMIT = 1e-6
CASES = {"one bar": 1, "two bars": 2}


def apart(a: FloatArray, b: FloatArray) -> float:
    """Largest distance of two tips (M, 2), m."""
    return float(np.linalg.norm(a - b, axis=1).max())


def exudyn_tip(start: March, h: float, end: float) -> FloatArray:
    """Positions (M, 2) of the tip by Exudyn, from the initial states and matrices of a run."""
    import exudyn as exu
    from exudyn import utilities as item

    system = exu.SystemContainer().AddSystem()
    before = system.AddMarker(item.MarkerBodyPosition(
        bodyNumber=system.AddObject(item.ObjectGround())))
    zero = system.AddMarker(item.MarkerNodeCoordinate(
        nodeNumber=system.AddNode(item.NodePointGround()), coordinate=0))

    def fix(node: Any, coordinate: int) -> None:
        marker = system.AddMarker(item.MarkerNodeCoordinate(
            nodeNumber=node, coordinate=coordinate))
        system.AddObject(item.CoordinateConstraint(markerNumbers=[zero, marker]))

    for body in bodies_of(start):
        x, y, angle = start.block(f"{body.name}.rigid")[0]
        frame = system.AddNode(item.NodeRigidBodyEP(referenceCoordinates=[
            x, y, 0, np.cos(angle / 2), 0, 0, np.sin(angle / 2)]))
        nodes = [system.AddNode(item.NodePoint(referenceCoordinates=[*p, 0])) for p in body.X]
        mass, stiffness = in_space(body)
        held = [exu.MatrixContainer(), exu.MatrixContainer()]
        for container, matrix in zip(held, (mass, stiffness), strict=True):
            container.SetWithSparseMatrix(matrix, useDenseMatrix=False)
        flexible = system.AddObject(item.ObjectFFRF(
            nodeNumbers=[frame, *nodes], massMatrixFF=held[0], stiffnessMatrixFF=held[1]))
        assert body.elasticity is not None
        for k in np.setdiff1d(np.arange(2 * len(nodes)), body.elasticity.free):
            fix(nodes[k // 2], int(k % 2))
        for coordinate in (2, 4, 5):  # the frame stays in the plane
            fix(frame, coordinate)

        def mean(weights: FloatArray, of: Any = flexible) -> Any:
            return system.AddMarker(item.MarkerSuperElementPosition(
                bodyNumber=of, meshNodeNumbers=np.flatnonzero(weights).tolist(),
                weightingFactors=weights[weights != 0].tolist()))

        def end_of(name: str, body: FloatingBody = body) -> FloatArray:
            at = nodes_of(body, name)
            return np.bincount(at, minlength=len(body.X)) / len(at)

        weights = np.asarray(body.mass_matrix.sum(axis=1)).ravel()
        system.AddLoad(item.LoadForceVector(
            markerNumber=mean(weights / weights.sum()), loadVector=[0, -G * weights.sum(), 0]))
        system.AddObject(item.SphericalJoint(
            markerNumbers=[before, mean(end_of("bore_a"))], constrainedAxes=[1, 1, 0]))
        before, last, number = mean(end_of("bore_b")), flexible, int(nodes_of(body, "chord_b")[0])
    sensor = system.AddSensor(item.SensorSuperElement(
        bodyNumber=last, meshNodeNumber=number, storeInternal=True,
        outputVariableType=exu.OutputVariableType.Position))
    system.Assemble()
    system.SolveDynamic(settings(exu, h, end))
    found: FloatArray = np.array(system.GetSensorStoredData(sensor))[:, 1:3]
    return found


def in_space(body: FloatingBody) -> tuple[Any, Any]:
    """Mass and stiffness (3 N, 3 N) with a third displacement that nothing excites."""
    assert body.mass_matrix is not None and body.elasticity is not None
    K = sparse.coo_matrix(body.elasticity.stiffness)
    N = len(body.X)
    rows, columns = (3 * (i // 2) + i % 2 for i in (K.row, K.col))
    across = sparse.diags(np.tile([0.0, 0.0, K.diagonal().max()], N))
    return (sparse.csr_matrix(sparse.kron(body.mass_matrix, np.eye(3))),
            sparse.csr_matrix((K.data, (rows, columns)), shape=(3 * N, 3 * N)) + across)


def settings(exu: Any, h: float, end: float) -> Any:
    """Generalized-alpha with spectral radius 1, as the product's runs."""
    s = exu.SimulationSettings()
    s.timeIntegration.numberOfSteps, s.timeIntegration.endTime = round(end / h), end
    s.timeIntegration.generalizedAlpha.spectralRadius = 1.0
    s.timeIntegration.newton.useModifiedNewton = True
    s.timeIntegration.newton.relativeTolerance = s.timeIntegration.newton.absoluteTolerance = 1e-10
    s.timeIntegration.verboseMode = 0
    s.solution.sensors.writePeriod = INTERVAL
    s.solution.file.write = False
    s.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    return s


def fill(out: report.Report, given: argparse.Namespace) -> None:
    out.settings |= {"end": f"{given.end:g} s, tips compared every {INTERVAL:g} s",
                     "product": "full order, generalized_alpha, rho_inf 1"}
    runs: dict[tuple[int, float, float], March] = {}

    def product(links: int, E: float, h: float) -> March:
        key = links, E, h
        if key not in runs:
            report.progress(f"{links} bars, E {E:g}, step {h:g}")
            runs[key] = swing(links, E, h, given.end, INTERVAL)
        return runs[key]

    if not given.without_exudyn:
        out.settings["other code"] = f"Exudyn {version('exudyn')}, ObjectFFRF, the same integrator"
        table = out.table("Exudyn, the same steps: m", E=".1e", step=".1e")
        tips = out.table("Tip by Exudyn, m", E=".1e", step=".1e", t=".2f", x=".9f", y=".9f")
        for name, links in CASES.items():
            for E in given.exudyn:
                earlier = None
                for h in given.steps[:-1]:
                    run = product(links, E, h)
                    theirs = exudyn_tip(run, h, given.end)
                    table.add(case=name, E=E, step=h, difference=apart(tip(run), theirs),
                              halving=None if earlier is None else apart(earlier, theirs))
                    earlier = theirs
                for k in range(1, 5):
                    at = round(k * given.end / 4 / INTERVAL)
                    tips.add(case=name, E=E, step=h, t=at * INTERVAL, x=theirs[at, 0],
                             y=theirs[at, 1])
                out.at_most(f"{name}, E {E:.1e}: distance to Exudyn, m", table.rows[-1][
                    "difference"], LIMIT)
    table = out.table("Absolute coordinates, finite strains: m", E=".1e")
    for name, links in CASES.items():
        for E in given.moduli:
            coarse, fine = (product(links, E, h) for h in given.steps[-2:])
            a, b = tip(coarse), tip(fine)
            x, _ = absolute_tip(fine, E, given.end, INTERVAL)
            y, _ = absolute_tip(fine, E, given.end, INTERVAL, halved=1)
            table.add(case=name, E=E, deflection=max(float(np.linalg.norm(
                displacements(fine, body), axis=2).max()) for body in bodies_of(fine)),
                halving_product=apart(a, b), halving_other=apart(x, y),
                difference=apart(b, y), extrapolated=apart(b + (b - a) / 3, y))
            if E >= given.stiff:
                out.at_most(f"{name}, E {E:.1e}: distance to absolute coordinates, m",
                            table.rows[-1]["extrapolated"], LIMIT)


def arguments() -> argparse.Namespace:
    parser = report.options("other_code", __doc__)
    parser.add_argument("--without-exudyn", action="store_true")
    parser.add_argument("--end", type=float, default=1.0)
    parser.add_argument("--steps", type=float, nargs="+", default=[4e-4, 2e-4, 1e-4, 5e-5])
    parser.add_argument("--exudyn", type=float, nargs="+", default=[7e7, 7e8])
    parser.add_argument("--moduli", type=float, nargs="+", default=[7e7, 2.1e8, 7e8])
    parser.add_argument("--stiff", type=float, default=7e8, help="E from which the limit holds")
    given = parser.parse_args()
    if given.quick:
        given.end, given.steps, given.moduli = 0.05, [4e-4, 2e-4], [7e8]
        given.exudyn, given.without_exudyn = [7e8], True
    return given


if __name__ == "__main__":
    sys.exit(report.run_plan("other_code", fill, arguments()))
