"""Runs a scene to its end through several processes, each of which kills itself on the way.

    python killed_runs.py SCENE OUT SETTINGS MOMENTS

SETTINGS: JSON of overrides. MOMENTS: `step:300` dies after that step, `training:30` in the training
run, `replace:7` just before the 7th time that a file is put in place, so in the middle of a
commit. Prints how each process ended.
"""

import json
import os
import shutil
import signal
import sys
from pathlib import Path
from typing import Any

from sparsemor.core.registry.hooks import RunStart, hookimpl
from sparsemor.core.scene.scene import Scene, load
from sparsemor.core.simulation import recorder
from sparsemor.core.simulation.simulate import simulate

COMMIT_EVERY = 40  # rows, with two files each; the default would commit a run this short once


def die() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


class DiesAfter:
    """`step:57` counts in the run itself, `training:57` in its training run."""

    def __init__(self, kind: str, step: int) -> None:
        self.phase = "run" if kind == "step" else kind
        self.step, self.here = step, False

    @hookimpl
    def on_start(self, run: RunStart) -> None:
        self.here = run.phase == self.phase

    @hookimpl
    def on_step(self, step: int) -> None:
        if self.here and step == self.step:
            die()


def die_before_replace(number: int) -> None:
    replace, count = os.replace, 0

    def counted(source: Any, target: Any) -> None:
        nonlocal count
        count += 1
        if count == number:
            die()
        replace(source, target)

    vars(os)["replace"] = counted


def run(scene: Scene, out: str, moment: str) -> None:
    recorder.CHUNK = COMMIT_EVERY
    kind, _, number = moment.partition(":")
    observers = [DiesAfter(kind, int(number))] if kind in ("step", "training") else []
    if kind == "replace":
        die_before_replace(int(number))
    resume = Path(out, "result.checkpoint").exists()
    if not resume:  # killed before there was anything to go on with
        shutil.rmtree(out, ignore_errors=True)
    simulate(scene, out=out, resume=resume, observers=observers)


def main() -> None:
    name, out, settings, *moments = sys.argv[1:]
    scene = load(name, json.loads(settings))  # here, so that no child imports its plugins anew
    for moment in (*moments, "end"):
        child = os.fork()
        if child == 0:
            run(scene, out, moment)
            os._exit(0)
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)


if __name__ == "__main__":
    main()
