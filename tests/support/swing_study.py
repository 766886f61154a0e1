"""A study of six runs of the example scene `swing`, three of which fail, and its command."""

import json
import sys
from pathlib import Path
from typing import Any

SWING = Path(__file__).parents[1] / "scenes" / "swing.yaml"
PROGRAM = Path(sys.executable).with_name("sparsemor")

STUDY = f"""\
title: How many columns, and what goes wrong
scene: {SWING}
set:
  time.end: 0.05
  training: {{end: 0.05}}
  reducer: {{use: galerkin, basis: {{use: pod, count: 6}}}}
grid:
  reducer.basis.count: [2, 4, 6]
  method:
    plain: {{}}
    hurried: {{reducer.max_iterations: 1, reducer.remaining: 1.0e-15}}
budget: reducer.basis.count
errors_from: 0.02
over_time: true
"""

LETHAL = '''
"""A preconditioner that kills its process a given number of times."""

import os
import signal
from pathlib import Path

import numpy as np

from sparsemor.core import Preconditioner


class Lethal(Preconditioner):
    """Kills."""

    mark: str
    """Where it counts."""
    times: int
    """How often."""

    def check(self, rows, atoms):
        return "none to kill" if self.times == 0 else ""

    def build(self, A):
        with open(self.mark, "a") as file:
            file.write("x")
        if Path(self.mark).stat().st_size <= self.times:
            os.kill(os.getpid(), signal.SIGKILL)
        return np.eye(len(A))
'''


def command(*arguments: object) -> list[str]:
    """The words of `sparsemor study ...`."""
    return [str(PROGRAM), "study", *map(str, arguments)]


def rows_of(folder: str, file: str = "table.jsonl") -> list[dict[str, Any]]:
    """The rows of a study's table."""
    return [json.loads(line) for line in Path(folder, file).read_text().splitlines()]
