"""Installs each extra of a wheel alone, in an environment of its own, and uses it once; without it
the same use is refused by one line that names the extra, or works by another way.

    python .ci/extras.py dist/sparsemor-*.whl [EXTRA ...]

Takes some minutes and 6 GB on disk. Uses `uv` where it is installed, else pip.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

RUN = ("run", "double_pendulum", "--set", "bodies.link1.mesh.elements=320", "--set",
       "bodies.link2.mesh.elements=320", "--set", "time.end=0.005", "--set", "training.end=0.005",
       "--force", "--quiet", "--out", "out")
PARTS = """format: 1
bodies:
  block:
    use: flexible
    mesh: {use: block, size: [1.0, 0.1, 0.1], divisions: [4, 1, 1]}
    material: {E: 2.0e11, nu: 0.3, rho: 7800}
    fields: [elastic]
    reference: {clamp: left}
    frame: fixed
loads: {weight: {use: gravity, g: [0.0, 0.0, -9.81]}}
time: {end: 0.01, step: 1.0e-3}
reducer: full
"""
GMSH = PARTS.replace("{use: block, size: [1.0, 0.1, 0.1], divisions: [4, 1, 1]}",
                     "{use: gmsh, geometry: block.geo, size: 0.1}").replace("left", "left_end")
GEO = """SetFactory("OpenCASCADE");
Box(1) = {0, 0, 0, 1, 0.1, 0.1};
Physical Surface("left_end") = {1};
Physical Volume("all") = {1};
"""
ANSYS = """
from pathlib import Path
nodes = ["1,0,0,0", "2,1,0,0", "3,0,1,0", "4,0,0,1"]
full = Path("file.full")
try:
    import ansys.mapdl.reader as reader
    folder = Path(reader.__file__).parent / "examples"
    mesh = reader.read_binary(str(folder / "file.rst")).mesh
    nodes = [f"{n},{x!r},{y!r},{z!r}" for n, (x, y, z) in zip(
        mesh.nnum.tolist(), mesh.nodes.tolist())]
    full = folder / "file.full"
except ImportError:
    full.write_bytes(bytes(64))
Path("nodes.csv").write_text("\\n".join(nodes) + "\\n")
Path("ansys.yaml").write_text(f'''
format: 1
bodies:
  bar: {{use: matrices, frame: fixed, nodes: nodes.csv, mass: "{full}:M", stiffness: "{full}:K"}}
time: {{end: 0.01, step: 0.001}}
reducer: full
''')
"""
STUDY = """scene: hot_plate
reference: none
set: {time.end: 10.0, training: {end: 10.0}}
grid: {seed: [1, 2]}
"""
CLUSTER = """
from sparsemor import study
if __name__ == "__main__":
    try:
        from distributed import LocalCluster
        cluster = LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None)
    except ImportError:
        cluster = "127.0.0.1:8786"
    from sparsemor import InputError
    try:
        print([r["status"] for r in study("study.yaml", out="far", scheduler=cluster)])
    except InputError as error:
        raise SystemExit(str(error))
"""
TABLE = """
from sparsemor import InputError, open_result
try:
    open_result("out").to_xarray().to_netcdf("run.nc", engine="scipy")
except InputError as error:
    raise SystemExit(str(error))
"""

SPARSEMOR, PYTHON = "sparsemor", "python"
USES: dict[str, list[tuple[str, ...]]] = {
    "xarray": [(SPARSEMOR, *RUN), (PYTHON, "-c", TABLE)],
    "cvx": [(SPARSEMOR, *RUN, "--set", "reducer=sparse", "--set", "reducer.solver=basis_pursuit")],
    "lars": [(SPARSEMOR, *RUN, "--set", "reducer=sparse", "--set", "reducer.solver=lasso_lars")],
    "parquet": [(SPARSEMOR, "study", "study.yaml", "--out", "near", "--quiet")],
    "dask": [(PYTHON, "cluster.py")],
    "pardiso": [(SPARSEMOR, *RUN, "--set", "linear_solver=pardiso")],
    "cholmod": [(SPARSEMOR, *RUN, "--set", "linear_solver=cholmod")],
    "amg": [(SPARSEMOR, *RUN, "--set", "linear_solver=amg")],
    "fast": [(SPARSEMOR, *RUN, "--set", "reducer=galerkin", "--set", "reducer.compiled=on")],
    "fmu": [(SPARSEMOR, "reduce", "double_pendulum", "--set", "bodies.link1.mesh.elements=320",
             "--set", "bodies.link2.mesh.elements=320", "--set", "time.end=0.005", "--set",
             "training.end=0.005", "--set", "reducer={use: galerkin, basis: {use: pod, count: 4}}",
             "--force", "--quiet", "--out", "kept.model"),
            (SPARSEMOR, "export", "kept.model", "--to", "fmu", "--out", "kept.fmu")],
    "gmsh": [(SPARSEMOR, "validate", "gmsh.yaml")],
    "ansys": [(PYTHON, "-c", ANSYS), (SPARSEMOR, "validate", "ansys.yaml")],
    "pictures3d": [(SPARSEMOR, "run", "block.yaml", "--force", "--quiet", "--out", "out"),
                   (SPARSEMOR, "pictures", "out", "--at", "0.01")],
}
WORKS_WITHOUT = {"parquet": "no runs.parquet is written", "pictures3d": "drawn by matplotlib"}
HINTS = {"fmu": "fast"}  # machine code comes first; a compiler may be there
FILES = {"parquet": "near/runs.parquet", "xarray": "run.nc", "fmu": "kept.fmu"}
"""Files that a use writes."""


def environment(folder: Path, requirement: str) -> Path:
    """New virtual environment with a requirement alone; its folder of programs."""
    programs = folder / ("Scripts" if os.name == "nt" else "bin")
    uv = shutil.which("uv")
    if uv is not None:
        subprocess.run([uv, "venv", "--quiet", "--python", sys.executable, folder], check=True)
        subprocess.run([uv, "pip", "install", "--quiet", "--python", programs / "python",
                        requirement], check=True)
    else:
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
        subprocess.run([programs / "python", "-m", "pip", "install", "--quiet", requirement],
                       check=True)
    return programs


def used(extra: str, programs: Path, folder: Path) -> "subprocess.CompletedProcess[str]":
    """Uses an extra in a new folder: its last command, or the first that fails."""
    folder.mkdir()
    for name, text in {"block.yaml": PARTS, "gmsh.yaml": GMSH, "block.geo": GEO,
                       "study.yaml": STUDY, "cluster.py": CLUSTER}.items():
        (folder / name).write_text(text, encoding="utf-8")
    environ = os.environ | {"SPARSEMOR_CACHE": str(folder / "cache"), "OPENBLAS_NUM_THREADS": "1"}
    for program, *arguments in USES[extra]:
        done = subprocess.run([programs / program, *arguments], cwd=folder, capture_output=True,
                              text=True, env=environ, check=False)
        if done.returncode:
            break
    return done


def main() -> None:
    wheel, *chosen = sys.argv[1:]
    wheel, failed = str(Path(wheel).absolute()), list[str]()
    with tempfile.TemporaryDirectory() as place:
        root = Path(place)
        bare = environment(root / "bare", wheel)
        for extra in chosen or USES:
            without = used(extra, bare, root / f"without-{extra}")
            said = (without.stdout + without.stderr).strip()
            refused = (without.returncode != 0 and "Traceback" not in said
                       and f"pip install 'sparsemor[{HINTS.get(extra, extra)}]'" in said)
            if extra in WORKS_WITHOUT:
                refused, said = without.returncode == 0, WORKS_WITHOUT[extra]
            try:
                done = used(extra, environment(root / extra, f"{wheel}[{extra}]"),
                            root / f"with-{extra}")
                works = done.returncode == 0 and (
                    extra not in FILES or (root / f"with-{extra}" / FILES[extra]).is_file())
                output = done.stdout + done.stderr
            except subprocess.CalledProcessError as error:
                works, output = False, f"it is not installed: {error}"
            print(f"{extra}: {'works' if works else 'FAILS'} alone; without it: "
                  f"{'' if refused else 'WRONG: '}{said.splitlines()[-1] if said else ''}",
                  flush=True)
            if not works:
                print(output, flush=True)
            if not (works and refused):
                failed.append(extra)
            shutil.rmtree(root / extra, ignore_errors=True)
    if failed:
        raise SystemExit(f"failed: {', '.join(failed)}")


if __name__ == "__main__":
    main()
