"""Export of a run as time histories (CSV) and as one file of arrays (NetCDF)."""

import csv
from pathlib import Path

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.protocols.layout import Quantity
from sparsemor.core.protocols.poses import COORDINATE_UNITS, COORDINATES
from sparsemor.core.results.metadata import CONTACT_UNITS
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.simulation.sensors_and_outputs import output_name


def histories(run: RunResult) -> dict[tuple[str, str], FloatArray]:
    """(Name, SI unit) -> (j,) values at the stored steps, with the names of a stepper's outputs:
    rigid coordinates `crank.rigid.angle`, probes `tip.u_y`, forces of joints and force elements
    `hinge.force_x`, contacts computed in the steps `pad.normal`; then errors of blocks."""
    found = dict[tuple[str, str], FloatArray]()
    for b in run.layout:
        if b.kind.quantity is Quantity.POSE and b.owner in run.scene["bodies"]:
            for name, values in zip(COORDINATES.get(b.size, ()), run.block(b.name).T, strict=True):
                found[f"{b.name}.{name}", COORDINATE_UNITS[name]] = values
    for name in run.probes:
        head = run.probe_header(name)
        found |= {(output_name(name, c), unit): values for c, unit, values in zip(
            head.components, head.units, run.probe(name).T, strict=True)}
    for joint, forces in run.joint_forces().items():
        found |= {(output_name(joint, what), unit): f for (what, unit), f in forces.items()}
    if run.stage() is None:  # its contacts have times of their own
        for contact, kept in run.contacts().items():
            found |= {(output_name(contact, what), CONTACT_UNITS[what]): values
                      for what, values in kept.items() if what != "time"}
    for block in run.error_estimates:
        found[f"error_estimate.{block}", "K" if block.endswith(".thermal") else "m"] = (
            run.error_estimate(block))
    return found


def write_csv(run: RunResult, steps: IntArray, file: Path) -> int:
    """Writes the histories at these stored steps, a row per time with all digits, and returns their
    number."""
    columns = histories(run)
    table = np.column_stack([run.times, *columns.values()])[steps]
    with file.open("w", newline="", encoding="utf-8") as out:
        rows = csv.writer(out)
        rows.writerow(["time [s]", *(f"{name} [{unit}]" for name, unit in columns)])
        rows.writerows(table.tolist())
    return len(columns)


def write_netcdf(run: RunResult, steps: IntArray, file: Path) -> int:
    """Writes all arrays of the result at these stored steps, and returns their number."""
    data = run.to_xarray().isel(time=steps)
    data.to_netcdf(file, engine="scipy")
    return len(data.data_vars)
