"""A source that travels a long way: fixed bases beside few atoms selected from a large dictionary.

    python tests/benchmarks/travelling_source.py [--quick] [--around 1600] [--picture FILE.png]

A sleeve on a cooled core turns under a shoe that rubs on it, so that a spot of heat and
pressure travels along 95 % of its circumference of 1600 elements. Fixed bases of the training run
need about as many atoms as there are elements along the path; `sparse` selects 140 and 130 of the
orthonormal atoms of short parts of the training run (`pod` with `window`) in each step. Errors are
the largest of the whole run relative to the largest change; ms: CPU time of a step, mean and median
over all steps, of all methods in one process.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import common
import meshio
import numpy as np
import yaml
from modules import report

from sparsemor.core.scene.scene import Scene, load
from sparsemor.core.simulation.stages_before_steps import prepared

CHORD, THICKNESS, DEPTH, SPEED = 52.36e-6, 0.3e-3, 2e-6, 0.2
"""Length of an element along the path, m; thickness of the sleeve, m; depth of the shoe in it, m;
velocity of the rim, m/s."""
PAD = 0.4e-3
"""Width of the shoe, m."""
FIRST = 20
"""Number of steps that are not timed."""
WINDOW = {"use": "pod", "window": 20}


def sleeve(around: int, across: int, radius: float) -> meshio.Mesh:
    """Ring of quadrilaterals."""
    r = np.linspace(radius - THICKNESS, radius, across + 1)
    a = 2.0 * np.pi * np.arange(around) / around
    points = np.stack([np.outer(r, np.cos(a)), np.outer(r, np.sin(a)),
                       np.zeros((len(r), around))], axis=-1).reshape(-1, 3)
    n = np.arange(len(points)).reshape(len(r), around)
    n = np.hstack([n, n[:, :1]])
    corners = (n[:-1, :-1], n[1:, :-1], n[1:, 1:], n[:-1, 1:])
    return meshio.Mesh(points, [("quad", np.stack(corners, axis=-1).reshape(-1, 4))])


def scene(folder: Path, around: int, turns: float) -> Scene:
    """The scene, its mesh in a file of the folder; a step moves the rim by one element."""
    radius = around * CHORD / (2.0 * np.pi)
    sleeve(around, 3, radius).write(folder / "sleeve.vtk")
    steps = round(turns * around)
    end = steps * CHORD / SPEED
    inner = f"x*x + y*y < {(radius - 0.99 * THICKNESS) ** 2!r}"
    rim = f"x*x + y*y > {(radius - 0.01 * THICKNESS) ** 2!r}"
    tree: dict[str, Any] = {
        "format": 1,
        "bodies": {
            "sleeve": {
                "use": "flexible", "order": 1, "mesh": {"use": "file", "path": "sleeve.vtk"},
                "thickness": 0.01, "model": "plane_strain",
                "sets": {"inner": {"where": inner, "centre": [0.0, 0.0]}, "rim": {"where": rim}},
                "material": {"E": 2.1e11, "nu": 0.3, "rho": 7850, "alpha": 1.2e-5, "k": 45,
                             "c": 475},
                "fields": ["elastic", "thermal"], "reference": {"clamp": "inner"},
                "reference_temperature": 0, "pose": {"spin": SPEED / radius}},
            "shoe": {
                "use": "flexible", "thickness": 0.01, "fields": [], "reference_temperature": 0,
                "mesh": {"use": "rectangle", "lower": [-PAD / 2, radius], "size": [PAD, PAD],
                         "divisions": [8, 8]},
                "material": {"E": 2e9, "nu": 0.3, "rho": 2000, "alpha": 6e-5, "k": 8.7,
                             "c": 935}}},
        "joints": {
            "drive": {"use": "prescribed_motion", "of": "sleeve:inner", "x": 0.0, "y": 0.0,
                      "angle": {"use": "ramp", "end": end, "final": SPEED / radius * end}},
            "hold": {"use": "prescribed_motion", "of": "shoe:top", "x": 0.0, "angle": 0.0,
                     "y": {"use": "smooth_step", "end": 0.02 * around * CHORD / SPEED,
                           "final": -DEPTH}},
            "core": {"use": "prescribed_temperature", "on": ["sleeve:inner"],
                     "temperature": 0.0}},
        "contacts": {"sole": {
            "use": "polygonal", "between": ["shoe:bottom", "sleeve:rim"],
            "normal": {"use": "elastic_foundation", "stiffness": 6e12, "damping": 6e4,
                       "damping_depth": 1e-8},
            "friction": {"use": "coulomb", "coefficient": 0.2, "critical_velocity": 0.01},
            "heat": {"share": 0.0}}},
        "rigid_stage": {}, "time": {"end": end, "step": end / steps}, "integrator": "bdf1",
        "training": {"end": end}, "reducer": "full"}
    path = folder / "travelling_source.yaml"
    path.write_text(yaml.safe_dump(tree), encoding="utf-8")
    return load(str(path))


def selecting(elastic: int, thermal: int, settled: float) -> dict[str, Any]:
    """Selection of so many atoms; a support stays up to the relative error `settled`."""
    return {"use": "sparse", "basis": WINDOW, "settled": settled,
            "budgets": {"*.elastic": {"atoms": elastic}, "*.thermal": {"atoms": thermal}}}


def methods(given: argparse.Namespace) -> dict[str, dict[str, Any] | str]:
    """Reducer options by name."""
    few = (20, 20) if given.quick else (140, 130)
    counts = [40] if given.quick else given.counts
    return {
        "full order": "full",
        "selected": selecting(*few, settled=given.settled),
        **{f"galerkin, POD {k}": {"use": "galerkin", "basis": {"use": "pod", "count": k}}
           for k in counts},
        "galerkin, all atoms": {"use": "galerkin", "basis": WINDOW},
    }


def fill(out: report.Report, given: argparse.Namespace) -> None:
    around, turns = (200, 0.2) if given.quick else (given.around, given.turns)
    with tempfile.TemporaryDirectory() as folder:
        made = scene(Path(folder), around, turns)
        model, offline = prepared(made, common.Cache(), common.new_manager())
    steps = round(made.time.end / made.time.step)
    true = {n: np.asarray(offline.snapshots(n)).T[: steps + 1] for n in model.reducible()}
    out.settings |= {"scene": f"sleeve of {around} elements, {steps} steps, bdf1",
                     "unknowns": ", ".join(f"{n} {x.shape[1]}" for n, x in true.items())}
    table = out.table("Error and time of a step")
    for name, options in methods(given).items():
        if given.only and name not in given.only:
            continue
        case = common.Case(made, model, offline, true, steps)
        begun = time.process_time()
        solver = case.prepared(options)
        offline_s = time.process_time() - begun
        count = min(steps, 200) if options == "full" else steps
        row = run(case, options, solver, count)
        atoms = {n: d.atoms.shape[1] for n, d in solver.dictionaries.items()}
        table.add(method=name, atoms="/".join(map(str, atoms.values())), **row,
                  offline_s=offline_s)
        report.progress(f"{table.rows[-1]}")
    if given.picture is not None:
        draw(table.rows, given.picture)


def run(case: common.Case, options: Any, solver: Any, steps: int) -> dict[str, Any]:
    """Errors and times of the steps of one method."""
    way = common.Stepping.begin(case.scene.using({"reducer": options}), case.model, solver)
    seconds, worst = [], dict.fromkeys(case.reference, 0.0)
    with common.no_collector():
        for n in range(1, steps + 1):
            begun = time.process_time()
            way.step()
            seconds.append(time.process_time() - begun)
            for name, true in case.reference.items():
                x = way.state.x[solver.layout[name]]
                if (d := solver.dictionaries.get(name)) is not None:
                    x = d.atoms @ x + d.offset
                worst[name] = max(worst[name], float(np.linalg.norm(x - true[n])))
    size = {n: float(np.linalg.norm(x - x[0], axis=1).max()) for n, x in case.reference.items()}
    ms = 1e3 * np.array(seconds[min(FIRST, steps // 2) :])
    return {"elastic": worst["sleeve.elastic"] / size["sleeve.elastic"],
            "thermal": worst["sleeve.thermal"] / size["sleeve.thermal"],
            "mean_ms": float(ms.mean()), "median_ms": float(np.median(ms)),
            "exchanges": solver.counters(way.memory)["support_changes"]}


def draw(rows: list[dict[str, Any]], file: Path) -> None:
    """Error over time of a step, both fields."""
    from sparsemor.plugins.charts.style import PAGE, legend_above, new_figure, save, tidy

    figure = new_figure(PAGE, 3.0)
    panels, handles = figure.subplots(1, 2, sharey=True), []
    for axes, field in zip(panels, ("elastic", "thermal"), strict=True):
        for row in rows:
            if row["method"] == "full order":
                handles.append(axes.axvline(row["mean_ms"], color="0.6", label="full order"))
                continue
            selected = row["method"] == "selected"
            handles += axes.plot(
                row["mean_ms"], row[field], "o" if selected else "s",
                color="C1" if selected else "C0",
                label=f"selected of {row['atoms']}" if selected else "fixed basis")
        axes.set_xscale("log")
        axes.set_yscale("log")
        tidy(axes, "CPU ms a step", "largest error" if field == "elastic" else "", field)
    legend_above(figure, list({h.get_label(): h for h in handles}.values()), columns=3)
    file.parent.mkdir(parents=True, exist_ok=True)
    save(figure, file.parent, file.stem, [file.suffix.lstrip(".") or "png"])


def arguments() -> argparse.Namespace:
    parser = report.options("travelling_source", __doc__)
    parser.add_argument("--around", type=int, default=1600, help="elements along the path")
    parser.add_argument("--turns", type=float, default=0.95, help="of the sleeve")
    parser.add_argument("--counts", type=int, nargs="+", default=[800, 1200, 1400],
                        help="atoms of the fixed bases")
    parser.add_argument("--settled", type=float, default=5e-4,
                        help="relative error up to which a support is kept")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="methods")
    parser.add_argument("--picture", type=Path)
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(report.run_plan("travelling_source", fill, arguments()))
