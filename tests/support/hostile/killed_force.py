"""Kills `run --force` at each of its renames, then looks for the earlier result.

    python killed_force.py SCENE

Each attempt is a process of its own (a fork) in the working directory. Prints a list in JSON, one
entry an attempt, the last of which was not killed.
"""

import json
import os
import shutil
import signal
import sys
from pathlib import Path
from typing import Any

from typer.testing import CliRunner

from sparsemor import load, open_result, simulate
from sparsemor.core.cli import app
from sparsemor.core.results.output_directory import KEPT

OLD, NEW = ["--set", "time.end=0.003"], ["--set", "time.end=0.005"]
REFUSED = ["--set", "time.end=0.0055"]  # no whole number of steps


def command(scene: str, *arguments: str) -> int:
    return CliRunner().invoke(app, ["run", scene, *arguments, "--out", "out"]).exit_code


def killed(scene: str, moment: int) -> bool:
    """True when `run --force` reached its rename number `moment`, where it is killed."""
    child = os.fork()
    if child == 0:
        replace, count = os.replace, 0

        def counted(source: Any, target: Any) -> None:
            nonlocal count
            count += 1
            if count == moment:
                os.kill(os.getpid(), signal.SIGKILL)
            replace(source, target)

        os.replace = counted
        os._exit(command(scene, *NEW, "--force"))
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL


def steps(path: Path) -> int:
    """Stored steps of a result that has ended; 0 for others."""
    if not (path / "result" / "header.json").exists():
        return 0
    result = open_result(path)
    return len(result.times) if result.status.ok else 0


def attempt(scene: str, moment: int) -> dict[str, Any]:
    shutil.rmtree("out", ignore_errors=True)
    shutil.copytree("old", "out")
    out = Path("out")
    died = killed(scene, moment)
    found = {steps(out), steps(out / KEPT), steps(out / ".replaced.part")}
    command(scene, *REFUSED, "--force")
    back = steps(out) == 4 or steps(out / KEPT) == 4
    ended = 6 in found
    command(scene, *NEW, "--force")
    return {"moment": moment, "killed": died, "kept": 4 in found or ended,
            "put back": back or ended,
            "replaced": [steps(out) == 6, sorted(p.name for p in out.iterdir())]}


def main(scene: str) -> None:
    simulate(load(scene, {"time.end": 0.003}), out="old")
    found = []
    while not found or found[-1]["killed"]:
        found.append(attempt(scene, len(found) + 1))
    print(json.dumps(found))


main(*sys.argv[1:])
