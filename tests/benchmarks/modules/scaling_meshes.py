"""A mesh of `scaling.py`, and a method on it in a process of its own."""

import dataclasses
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from modules import report

HERE = Path(__file__).parents[1]
TOLERANCE = 1e-3


@dataclasses.dataclass
class Mesh:
    """One mesh of the scene, as its training run tells it."""

    refine: float
    field: str
    steps: int
    facts: dict[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def unknowns(self) -> int:
        return sum(self.facts["unknowns"].values())

    @property
    def named(self) -> dict[str, Any]:
        return {"fields": self.field, "tetrahedra": self.facts["tetrahedra"],
                "unknowns": self.unknowns}

    def task(self, method: str, **more: Any) -> dict[str, Any]:
        return {"method": method, "refine": self.refine, "field": self.field, "steps": self.steps,
                "changes": {}, "reducer": "galerkin", "tolerance": TOLERANCE, **more}


class Worker:
    """A method on a mesh in a process of its own. ms: one entry a window."""

    def __init__(self, mesh: Mesh, method: str, **more: Any) -> None:
        self.mesh, self.method = mesh, method
        task = json.dumps(mesh.task(method, **more))
        self.process = subprocess.Popen(
            [sys.executable, "-m", "modules.scaling_worker", task], stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONPATH": os.pathsep.join(
                [str(HERE), *filter(None, [os.environ.get("PYTHONPATH")])])})
        self.facts, self.ms, self.iterations = self._read(), list[float](), 0.0
        report.progress(f"{mesh.field} {mesh.refine:g}, {method}: {self.facts}")

    @property
    def well(self) -> bool:
        return "failed" not in self.facts

    def window(self, steps: int) -> None:
        if self.well:
            assert self.process.stdin is not None
            print(steps, file=self.process.stdin, flush=True)
            told = self._read()
            if "ms" in told:
                self.ms.append(float(np.median(told["ms"])))
                self.iterations = told["iterations"]
            else:
                self.facts |= told

    def end(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait()

    def _read(self) -> dict[str, Any]:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        told: dict[str, Any] = json.loads(line) if line else {
            "failed": f"its process ended with {self.process.wait()}"}
        return told
