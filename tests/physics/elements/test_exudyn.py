"""Large bending against Exudyn's cables and thin plates in absolute nodal coordinates (ANCF)."""

from typing import Any

import numpy as np
import pytest

from sparsemor import load, solve

exudyn = pytest.importorskip("exudyn", reason="Exudyn is not installed")

LENGTH, SIDE, E = 1.0, 0.02, 7e10
BENDING = E * SIDE**4 / 12.0


def exudyn_tip(force: float) -> tuple[float, float]:
    """Displacement of the tip of a cantilever, m, by 16 cables without shear."""
    from exudyn import utilities as item
    from exudyn.beams import GenerateStraightLineANCFCable2D

    system = exudyn.SystemContainer().AddSystem()
    GenerateStraightLineANCFCable2D(
        mbs=system, positionOfNode0=[0, 0, 0], positionOfNode1=[LENGTH, 0, 0], numberOfElements=16,
        cableTemplate=item.Cable2D(massPerLength=1.0, bendingStiffness=BENDING,
                                   axialStiffness=E * SIDE**2),
        massProportionalLoad=[0, 0, 0], fixedConstraintsNode0=[1, 1, 1, 1],
        fixedConstraintsNode1=[0, 0, 0, 0])
    system.AddLoad(item.LoadForceVector(markerNumber=system.AddMarker(
        item.MarkerNodePosition(nodeNumber=16)), loadVector=[0.0, -force, 0.0]))
    system.Assemble()
    settings: Any = exudyn.SimulationSettings()
    settings.staticSolver.numberOfLoadSteps = 10
    settings.staticSolver.newton.relativeTolerance = 1e-9
    settings.staticSolver.verboseMode = 0
    settings.solution.file.write = False
    system.SolveStatic(settings)
    u = system.GetNodeOutput(16, exudyn.OutputVariableType.Displacement)
    return float(u[0]), float(u[1])


@pytest.mark.full
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of the generator of cables
@pytest.mark.parametrize("bend", [0.5, 3.0])
def test_a_cantilever_blade_that_bends_far(bend: float) -> None:
    """Tip force `bend` E I / L^2, 0.16 and 0.60 L down; shear and the clamp differ by (h / L)^2."""
    force = bend * BENDING / LENGTH**2
    scene = load({
        "format": 1, "time": {"end": 1.0, "step": 0.5},
        "bodies": {"b": {
            "use": "flexible", "order": 2, "thickness": SIDE, "fields": ["elastic"],
            "mesh": {"use": "rectangle", "lower": [0.0, -SIDE / 2], "size": [LENGTH, SIDE],
                     "divisions": [32, 2]},
            "material": {"E": E, "nu": 0.0, "rho": 2700.0}, "frame": "fixed",
            "strains": "nonlinear", "reference": {"clamp": "left"}}},
        "loads": {"f": {"use": "traction", "on": ["b:right"], "axes": "space",
                        "traction": [0.0, -force / SIDE**2]}},
        "probes": {"tip": {"body": "b", "at": "right"}}})
    rows = {r["quantity"]: r["value"] for r in solve(scene, "static").rows}
    np.testing.assert_allclose([rows["tip.u_x"], rows["tip.u_y"]], exudyn_tip(force), rtol=2e-3)


WIDTH, NU = 0.5, 0.3


def exudyn_plate(force: float) -> list[float]:
    """Displacements u_x, u_z, m, of the middle and of a corner of the free edge of a plate that is
    clamped opposite, by 8 x 4 thin plates."""
    from exudyn import shells

    system = exudyn.SystemContainer().AddSystem()
    mesh = shells.ShellMesh(
        [[0, -WIDTH / 2, 0], [LENGTH, -WIDTH / 2, 0], [LENGTH, WIDTH / 2, 0], [0, WIDTH / 2, 0]],
        8, 4, E, NU, 2700.0, SIDE)
    mesh.CreateANCFThinPlateElements(system)
    for node in mesh.boundaryNodeNumbers["left"]:  # positions and rotations, not strains
        shells.AddClampToGround(system, node, [1, 1, 1, 0, 1, 1, 1, 0, 1])
    shells.ApplyEdgeLoad(system, mesh, "right", loadVector=[0, 0, -force], distributed=True)
    system.Assemble()
    settings: Any = exudyn.SimulationSettings()
    settings.staticSolver.numberOfLoadSteps = 5
    settings.staticSolver.newton.relativeTolerance = 1e-9
    settings.staticSolver.verboseMode = 0
    settings.solution.file.write = False
    system.SolveStatic(settings)
    edge = mesh.boundaryNodeNumbers["right"]
    found = [system.GetNodeOutput(n, exudyn.OutputVariableType.Displacement)
             for n in (edge[len(edge) // 2], edge[0])]
    return [float(u[i]) for u in found for i in (0, 2)]


@pytest.mark.slow
def test_a_plate_that_bends_far() -> None:
    """Edge force 1.5 E I / L^2, 0.39 L down. One quadratic tetrahedron over the thickness is too
    stiff by 0.8 %."""
    force = 1.5 * E * SIDE**3 * WIDTH / 12.0 / LENGTH**2
    scene = load({
        "format": 1, "time": {"end": 1.0, "step": 0.5},
        "bodies": {"b": {
            "use": "flexible", "order": 2, "fields": ["elastic"],
            "mesh": {"use": "block", "lower": [0.0, -WIDTH / 2, -SIDE / 2],
                     "size": [LENGTH, WIDTH, SIDE], "divisions": [16, 8, 1]},
            "material": {"E": E, "nu": NU, "rho": 2700.0}, "frame": "fixed",
            "strains": "nonlinear", "reference": {"clamp": "left"}}},
        "loads": {"f": {"use": "traction", "on": ["b:right"], "axes": "space",
                        "traction": [0.0, 0.0, -force / (WIDTH * SIDE)]}},
        "probes": {"middle": {"body": "b", "at": [LENGTH, 0.0, 0.0]},
                   "corner": {"body": "b", "at": [LENGTH, -WIDTH / 2, 0.0]}}})
    rows = {r["quantity"]: r["value"] for r in solve(scene, "static").rows}
    found = [rows[f"{probe}.u_{axis}"] for probe in ("middle", "corner") for axis in "xz"]
    np.testing.assert_allclose(found, exudyn_plate(force), rtol=0.015)
