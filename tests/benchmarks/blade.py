"""Twisted solid blade that spins at twice its first frequency: modes by `prestressed` and
`nonlinear` strains and by CalculiX on one mesh, and steps of full order and of reduced models.

    python tests/benchmarks/blade.py modes [CELLS]        # along, across, thick: 85 10 4
    python tests/benchmarks/blade.py deck FOLDER [CELLS]  # mesh and deck: ccx -i FOLDER/job
    python tests/benchmarks/blade.py steps [CELLS] [STRAINS]  # errors, and medians of ms per step
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from sparsemor import Scene, load, simulate, solve
from sparsemor.bodies.mesh.generators.block import BlockMesh
from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.assembly import BodyCache
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.simulation.cache import Cache

sys.path.append(str(Path(__file__).parents[1] / "support"))
import calculix

LENGTH, CHORD, THICK, TWIST, TAPER = 0.5, 0.06, 0.012, np.radians(30.0), 0.4
"""m; twist from root to tip, rad; relative loss of chord and thickness at the tip."""
MATERIAL = {"E": 1.1e11, "nu": 0.33, "rho": 4400.0}
SMALL, LARGE = (16, 2, 1), (85, 10, 4)
ATOMS = 12


def write_mesh(file: Path, cells: Sequence[int]) -> int:
    """Second-order tetrahedra of the blade in Abaqus format; returns their number."""
    block = BlockMesh(lower=(0.0, -CHORD / 2, -THICK / 2), size=(LENGTH, CHORD, THICK),
                  divisions=tuple(cells)).build(Path())
    s, turn = block.points[:, 0] / LENGTH, TWIST * block.points[:, 0] / LENGTH
    y, z = (block.points[:, i] * (1.0 - TAPER * s) for i in (1, 2))
    X = np.column_stack([block.points[:, 0], y * np.cos(turn) - z * np.sin(turn),
                         y * np.sin(turn) + z * np.cos(turn)])
    made = calculix.solid(X, block.cells, {"root": "x < 1e-9", "tip": f"x > {LENGTH} - 1e-9"})
    made.write(file)
    return len(made.nodes)


def deck(spin: float) -> str:
    """CalculiX: static equilibrium of the spinning blade, then modes about it."""
    return f"""*INCLUDE, INPUT=mesh.inp
{calculix.material(MATERIAL['E'], MATERIAL['nu'], MATERIAL['rho'])}*BOUNDARY
root, 1, 3
*STEP, NLGEOM
*STATIC
*DLOAD
EALL, CENTRIF, {spin**2:.15g}, 0., 0., 0., 0., 0., 1.
*END STEP
*STEP, PERTURBATION
*FREQUENCY
4
*END STEP
"""


def by_calculix(cells: Sequence[int], spin: float) -> list[float]:
    """Frequencies, Hz."""
    with TemporaryDirectory() as name:
        write_mesh(Path(name) / "mesh.inp", cells)
        rows = calculix.table(calculix.by_ccx(Path(name), deck(spin)), "MODE NO")
    return [float(f) for f in rows[:4, 3]]


def blade(file: Path, strains: str, spin: float, **more: Any) -> Scene:
    """The blade on a frame that turns about z at the rate `spin`, rad/s, under a force that turns
    with it."""
    return load({
        "format": 1,
        "bodies": {"b": {
            "use": "flexible", "mesh": {"use": "file", "path": str(file)}, "fields": ["elastic"],
            "material": MATERIAL, "strains": strains, "frame": "spinning",
            "damping": {"mass": 20.0}, "reference": {"clamp": "root"},
            "pose": {"spin": [0.0, 0.0, spin]}}},
        "joints": {"hub": {"use": "prescribed_motion", "of": "b:root", "x": 0.0, "y": 0.0, "z": 0.0,
                           "axis": [0, 0, 1], "angle": {
                               "use": "ramp", "end": 10.0, "final": 10.0 * spin}}},
        "loads": {"f": {"use": "traction", "on": ["b:tip"], "traction": [0.0, 2e5, 2e5],
                        "axes": "body",
                        "factor": {"use": "smooth_step", "end": 0.006, "final": 1.0}}},
        "integrator": {"use": "generalized_alpha", "rho_inf": 0.8},
        "time": {"end": 0.008, "step": 4e-4},
        "probes": {"tip": {"body": "b", "at": "tip"}}, **more})


def modes(file: Path, strains: str, spin: float, **more: Any) -> FloatArray:
    """Frequencies, Hz, of four modes about the equilibrium of steady rotation without the force."""
    scene = blade(file, strains, spin, **more).using({"loads": {}, "bodies.b.damping.mass": 0.0})
    found = solve(scene, "frequencies", count=4, spin=spin > 0.0)
    return np.array(found.column("frequency_hz"))


def first_spin(file: Path) -> float:
    """Twice the first frequency at rest, rad/s, rounded."""
    return float(round(4.0 * np.pi * modes(file, "linear", 0.0)[0]))


def print_modes(cells: Sequence[int]) -> None:
    with TemporaryDirectory() as name:
        file = Path(name) / "mesh.inp"
        count = write_mesh(file, cells)
        spin = first_spin(file)
        want = np.array(by_calculix(cells, spin))
        print(f"{count} tetrahedra of second order, {spin:g} rad/s, frequencies in Hz")
        print(f"{'CalculiX':12}", *(f"{f:10.3f}" for f in want))
        for strains in ("prestressed", "nonlinear", "linear"):
            found = modes(file, strains, spin)
            print(f"{strains:12}", *(f"{f:10.3f}" for f in found),
                  f"  largest difference {100 * np.abs(found / want - 1.0).max():.2f} %")


REDUCED: dict[str, dict[str, Any]] = {
    "galerkin": {"use": "galerkin"}, "galerkin, compiled": {"use": "galerkin", "compiled": "on"},
    "ecsw": {"use": "ecsw"}}


def step_ms(run: RunResult) -> float:
    """Median over the steps, ms."""
    return 1e3 * float(np.median(run.step_seconds[1:]))


def print_steps(cells: Sequence[int], kinds: Sequence[str]) -> None:
    """Errors of the displacements at the tip, relative to their largest change, and speed, of
    models that repeat their training run, by one run of each. Runs start from the equilibrium of
    steady rotation."""
    with TemporaryDirectory() as name:
        file = Path(name) / "mesh.inp"
        write_mesh(file, cells)
        spin = first_spin(file)
        for strains in kinds:
            rest = Path(name) / strains
            solve(blade(file, strains, spin, loads={}), "static", at=0.0, spin=True,
                  out=rest)
            scene = blade(file, strains, spin, initial={"result": str(rest)})
            cache, bodies = Cache(Path(name) / "cache"), BodyCache()
            full = simulate(scene, cache=cache, body_cache=bodies, keep_training=True)
            want, whole = full.probe("tip")[:, 3:], step_ms(full)  # in the axes of the body
            print(f"{strains}: full order {whole:.1f} ms per step")
            for label, options in REDUCED.items():
                # the first run of compiled steps compiles them
                for _ in range(1 + ("compiled" in options)):
                    run = simulate(scene.using({"reducer": {
                        **options, "basis": {"use": "pod", "count": ATOMS}}}),
                        cache=cache, body_cache=bodies)
                error = np.abs(run.probe("tip")[:, 3:] - want).max() / np.ptp(want, axis=0).max()
                print(f"  {label:20} error {error:.1e}, {step_ms(run):8.3f} ms per step, "
                      f"{whole / step_ms(run):6.0f} times faster, "
                      f"elements {sum(run.summary['elements_touched'].values())}", flush=True)


def main() -> None:
    command, *rest = sys.argv[1:]
    numbers = [int(w) for w in rest if w.isdigit()]
    cells = numbers or LARGE
    if command == "deck":
        with TemporaryDirectory() as name:
            write_mesh(Path(name) / "mesh.inp", cells)
            spin = first_spin(Path(name) / "mesh.inp")
        write_mesh(Path(rest[0]) / "mesh.inp", cells)
        (Path(rest[0]) / "job.inp").write_text(deck(spin))
    elif command == "modes":
        print_modes(cells)
    elif command == "steps":
        kinds = ("prestressed", "nonlinear")
        print_steps(cells, [k for k in kinds if k in rest] or kinds)


if __name__ == "__main__":
    main()
