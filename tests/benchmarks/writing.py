"""Cost of storing a step: what a run spends in its recorder, by part.

    python tests/benchmarks/writing.py [--end SECONDS]

CPU time of the packaged double pendulum, in us a step. `take`: the step is buffered; `append`: the
steps are written; `checkpoint`: the state to continue from; `rest`: probes and forces of the
buffered steps. The clock itself adds half a us to `take`.
"""

import argparse
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any

import common  # noqa: F401  (one thread)

from sparsemor import load, simulate
from sparsemor.core.results.result_writer import ResultWriter
from sparsemor.core.simulation.recorder import Recorder


def timed(spent: Counter[str], owner: type, name: str) -> None:
    """Adds the CPU time of all calls of a method to `spent`."""
    method: Callable[..., Any] = getattr(owner, name)

    @wraps(method)
    def call(*arguments: Any, **options: Any) -> Any:
        begun = time.process_time()
        try:
            return method(*arguments, **options)
        finally:
            spent[name] += time.process_time() - begun

    setattr(owner, name, call)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--end", type=float, default=2.0)
    end = parser.parse_args().end
    spent: Counter[str] = Counter()
    for owner, name in ((ResultWriter, "append"), (ResultWriter, "checkpoint"), (Recorder, "take"),
                        (Recorder, "save")):
        timed(spent, owner, name)
    scene = load("double_pendulum", {"time.end": end, "training.end": 0.1})
    with tempfile.TemporaryDirectory() as folder:
        for turn in range(4):
            spent.clear()
            run = simulate(scene, out=Path(folder) / str(turn))
            steps = run.summary["steps"]
            us = {name: 1e6 * seconds / steps for name, seconds in spent.items()}
            rest = us["save"] - us["append"] - us["checkpoint"]
            print(f"{steps} steps: take {us['take']:.1f}, append {us['append']:.1f}, checkpoint "
                  f"{us['checkpoint']:.1f}, rest {rest:.1f}, in all {us['take'] + us['save']:.1f} "
                  f"us/step; files {sum(p.is_file() for p in run.path.rglob('*'))}")


if __name__ == "__main__":
    main()
