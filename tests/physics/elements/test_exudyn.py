"""Large bending against Exudyn's cables in absolute nodal coordinates (ANCF)."""

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
