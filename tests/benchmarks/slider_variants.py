"""What the slider's temperature depends on: other drives, shares of heat and contact conductances.

    python tests/benchmarks/slider_variants.py [--quick] [--out slider_variants.json]

Each variant is the packaged scene `slider_plate` with overrides, full order, heat alone (the
temperatures do not depend on the elastic field). Beside it the temperature that a prototype found
on a structured mesh of 26 x 26 quads, and for the scene as packaged those of the literature.
"""

import argparse
import sys
import tempfile
from pathlib import Path
from typing import Any

import common  # noqa: F401  # before NumPy: it limits linear algebra to one thread
from modules import report

from sparsemor import load, simulate
from sparsemor.core.results.run_result import RunResult

HEAT_ALONE = {"reducer": "full", "bodies.slider.fields": ["thermal"],
              "bodies.plate.fields": ["thermal"]}
UPRIGHT = {"joints.drive": {
    "use": "prescribed_motion", "of": "slider:top", "angle": 0.0,
    "x": {"use": "ramp", "end": 1.0, "final": 1.0}}}
"""The slider cannot tilt, so its pressure is uniform."""
AT_CENTROID = {
    "bodies.slider.sets": {"corners": {
        "where": "(x < 1e-9 or x > 1.25e-3 - 1e-9) and (y < 1e-9 or y > 1.25e-3 - 1e-9)"}},
    "joints.drive.of": "slider:corners"}
PERFECT = 1.0e9
"""A conductance, W/(m2 K), that lets no difference of temperature stand."""


def conducting(conductance: float) -> dict[str, Any]:
    return {"contacts.sole.heat": {"share": "effusivity", "conductance": conductance}}


VARIANTS: dict[str, tuple[dict[str, Any], float]] = {
    "as packaged": ({}, 6.1318),
    "uniform pressure": (UPRIGHT, 3.622),
    "uniform pressure, all heat to the slider": (
        UPRIGHT | {"contacts.sole.heat": {"share": 1.0}}, 7.245),
    "driven at the centroid": (AT_CENTROID, 4.861),
    "conductance 1e4": (conducting(1e4), 6.031),
    "conductance 1e5": (conducting(1e5), 5.317),
    "conductance 1e6": (conducting(1e6), 3.500),
    "perfect contact": (conducting(PERFECT), 3.112),
    "uniform pressure, perfect contact": (UPRIGHT | conducting(PERFECT), 2.767),
}
"""Overrides, and the largest temperature of the slider at 3.75 ms in the prototype, K."""


def fill(out: report.Report, given: argparse.Namespace) -> None:
    out.settings |= {"scene": "slider_plate, full order, thermal fields alone",
                     "prototype": "structured mesh, 26 x 26 quads; the paper has 6.138 for the "
                                  "scene as packaged, Martins et al. 6.10"}
    table = out.table("Largest temperature of the slider", largest_K=".4f", prototype_K=".4f",
                      off=".2%", heat_J=".5e", mean_normal_N=".4f")
    for name, (overrides, expected) in list(VARIANTS.items())[:: 4 if given.quick else 1]:
        report.progress(name)
        row = measured(overrides, given)
        off = row["largest_K"] / expected - 1.0
        table.add(variant=name, **row, prototype_K=expected, off=off)
        if not given.quick:
            out.at_most(f"{name}: off by", abs(off), 0.01)


def measured(overrides: dict[str, Any], given: argparse.Namespace) -> dict[str, float]:
    """One variant run to its end."""
    short = {"time.end": 7.5e-5} if given.quick else {}
    scene = load("slider_plate", HEAT_ALONE | overrides | short)
    with tempfile.TemporaryDirectory() as folder:
        run = simulate(scene, out=Path(folder) / "run")
        stage = run.stage()
        assert stage is not None
        return {"largest_K": float(run.block("slider.thermal", slice(-1, None)).max()),
                "heat_J": stored_heat(run, scene.dump()["bodies"]["slider"]),
                "mean_normal_N": float(stage.contacts["sole"]["normal"][1:].mean())}


def stored_heat(run: RunResult, body: dict[str, Any]) -> float:
    """What the slider has taken up, J: rho c times the integral of its rise of temperature."""
    cells = run.cells("slider")
    corners = run.points("slider")[cells]
    first, second = (corners[:, i] - corners[:, 0] for i in (1, 2))
    area = 0.5 * (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    rise = run.nodal_temperature("slider", -1) - run.nodal_temperature("slider", 0)
    material = body["material"]
    return float(material["rho"] * material["c"] * body["thickness"]
                 * (area @ rise[cells].mean(axis=1)))


if __name__ == "__main__":
    sys.exit(report.run_plan("slider_variants", fill,
                            report.options("slider_variants", __doc__).parse_args()))
