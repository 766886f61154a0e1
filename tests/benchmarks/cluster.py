"""A study of many small runs on a dask cluster of processes on this machine, whose workers are
killed and replaced on the way: `python tests/benchmarks/cluster.py --runs 1000 --kills 10`.

Prints what was lost and repeated, and whether the table has the bytes of the same study without
workers. Needs the extra `dask`.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"

from sparsemor.plugins.study import run_plan
from sparsemor.plugins.study.plan import StudyPlan

SCENE = Path(__file__).parents[2] / "docs" / "examples" / "rigid_pendulum.yaml"
DASK = Path(sys.executable).with_name("dask")


def study_of(runs: int) -> dict[str, object]:
    """A falling double pendulum whose second link has another mass in each run."""
    return {
        "scene": str(SCENE), "reference": "none", "set": {"time.end": 0.02},
        "grid": {"bodies.link2.mass": [round(1.0 + 0.01 * i, 2) for i in range(runs)]},
        "quantities": {"tip_y": {"probe": "tip", "component": "y", "take": "final"},
                       "force": {"joint": "A"}}}


@contextmanager
def cluster(folder: Path, workers: int) -> Iterator[tuple[Path, list["subprocess.Popen[bytes]"]]]:
    """Scheduler file of a cluster, and its processes, of which the first is the scheduler."""
    file, log = folder / "scheduler.json", (folder / "dask.log").open("ab")
    started: list[subprocess.Popen[bytes]] = []

    def start(*arguments: str) -> None:
        started.append(subprocess.Popen(
            [DASK, *arguments, "--no-dashboard", "--scheduler-file", str(file)], stdout=log,
            stderr=log, cwd=folder))

    try:
        start("scheduler", "--host", "127.0.0.1", "--port", "0")
        while not (file.exists() and file.stat().st_size):
            time.sleep(0.05)
        for _ in range(workers):
            start("worker", "--nthreads", "1", "--no-nanny")
        yield file, started
    finally:
        for process in started:
            process.kill()
            process.wait()
        log.close()


def killing(
    out: Path, file: Path, processes: list["subprocess.Popen[bytes]"], kills: int, runs: int
) -> None:
    """Kills the oldest worker, and starts another one, `kills` times along the study."""
    lines = out / "runs.jsonl"
    for i in range(1, kills + 1):
        while not lines.exists() or lines.read_bytes().count(b"\n") < i * runs // (kills + 1):
            time.sleep(0.02)
        processes.pop(1).kill()
        processes.append(subprocess.Popen(
            [DASK, "worker", "--nthreads", "1", "--no-nanny", "--no-dashboard", "--scheduler-file",
             str(file)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=file.parent))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    for name, value in (("runs", 1000), ("workers", 4), ("kills", 10)):
        parser.add_argument(f"--{name}", type=int, default=value)
    given = parser.parse_args()
    plan = StudyPlan.read(study_of(given.runs))
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        with cluster(folder, given.workers) as (file, processes):
            threading.Thread(target=killing, daemon=True, args=(
                folder / "far", file, processes, given.kills, given.runs)).start()
            far = run_plan(plan, out=folder / "far", scheduler=file, times=False)
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        near = run_plan(plan, out=folder / "near", times=False)
        same = all((folder / "far" / n).read_bytes() == (folder / "near" / n).read_bytes()
                   for n in ("table.csv", "table.jsonl"))
        rows = [json.loads(line) for line in (folder / "far/runs.jsonl").read_text().splitlines()]
    print(f"{len(far.rows)} runs, {len(far.rows) - far.failed} done; {far.lost}")
    print(f"largest number of repeats of a run: {max(row['repeats'] for row in rows)}")
    print(f"same bytes as without workers: {same}; {len(near.rows)} rows")
    print(f"CPU time of scheduler and workers: {used.ru_utime + used.ru_stime:.0f} s")


if __name__ == "__main__":
    main()
