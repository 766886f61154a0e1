"""Quantities of a run that do not depend on its state: cost, status, options, meshes, active
atoms."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from pydantic import Field

from sparsemor.core.errors import InputError
from sparsemor.core.results.cost import run_facts
from sparsemor.core.scene.overrides import split as key_parts
from sparsemor.plugins.liang2026.measure import OfRun, Results
from sparsemor.plugins.liang2026.rules import Operand
from sparsemor.plugins.liang2026.state_quantities import FIELDS


class Cost(OfRun):
    """Cost of a run."""

    use: Literal["cost"]
    what: Literal["online_seconds", "ms_per_step", "ms_per_step_solver", "steps", "atoms", "rows",
                  "end", "iterations"]
    """Attribute of the run's cost."""

    def compute(self, results: Results, known: Mapping[str, Operand]) -> Operand:
        value: Operand = run_facts(results.run(self.run)).as_dict()[self.what]
        return value


class Split(OfRun):
    """Part of the processor time of a run's time loop, s: that of the profiled pass, for all
    steps of the run."""

    use: Literal["split"]
    part: Literal["matrix", "update", "overall"]
    """`matrix`: solution of linear systems and least-squares problems, products with precomputed
    inverses and selection included; `update`: evaluation of the equations and everything else."""

    def profiled(self) -> tuple[str, ...]:
        return (self.run,)

    def compute(self, results: Results, known: Mapping[str, Operand]) -> Operand:
        split = results.split(self.run)
        overall = split["seconds"] / split["steps"] * run_facts(results.run(self.run)).steps
        return overall if self.part == "overall" else overall * split[self.part]


class RunStatus(OfRun):
    """Final status of a run: `done`, or why it stopped."""

    use: Literal["status"]

    def compute(self, results: Results, known: Mapping[str, Operand]) -> Operand:
        return results.run(self.run).status.value


class Summary(OfRun):
    """Entry of a run's summary."""

    use: Literal["summary"]
    path: list[str] = Field(min_length=1)
    """Keys from the outside to the inside."""

    def compute(self, results: Results, known: Mapping[str, Operand]) -> Operand:
        found: Operand = _inside(results.run(self.run).summary, self.path)
        return found


class Parameter(OfRun):
    """Option of the scene of a run."""

    use: Literal["parameter"]
    key: str
    """Dotted key, such as `bodies.link1.material.E`."""

    def compute(self, results: Results, known: Mapping[str, Operand]) -> Operand:
        found = _inside(results.run(self.run).scene, key_parts(self.key))
        return found if isinstance(found, str | bool) else float(found)


class MeshCount(OfRun):
    """Number of elements or nodes of a body, or of unknowns of one of its fields."""

    use: Literal["mesh"]
    body: str
    """Name of the body."""
    what: Literal["elements", "nodes", "displacement", "temperature"]
    """Entities that are counted."""

    def compute(self, results: Results, known: Mapping[str, Operand]) -> Operand:
        run = results.run(self.run)
        if self.what == "elements":
            return len(run.cells(self.body))
        if self.what == "nodes":
            return len(run.points(self.body))
        block = run.layout.of(self.body, FIELDS[self.what])
        return None if block is None else block.size


class ActiveAtoms(OfRun):
    """Statistics of the active basis vectors (atoms) of one block."""

    use: Literal["active"]
    block: str
    """`body.field`."""
    what: Literal["active", "atoms", "changes", "exchanged", "highest"]
    """Mean number of active atoms; number of atoms; steps at which the selection changes; mean
    share of active atoms that is exchanged per step; highest number of an active atom."""

    def compute(self, results: Results, known: Mapping[str, Operand]) -> Operand:
        active = results.run(self.run).support(self.block)[1:]  # nothing is selected at the start
        count = float(active.sum(axis=1).mean())
        left = (active[:-1] & ~active[1:]).sum(axis=1)
        found: Mapping[str, float] = {
            "active": count, "atoms": active.shape[1],
            "changes": int(np.any(active[1:] != active[:-1], axis=1).sum()),
            "exchanged": float(left.mean() / count),
            "highest": int(np.flatnonzero(active.any(axis=0)).max()) + 1}
        return found[self.what]


def _inside(found: Any, path: Sequence[Any]) -> Any:
    for key in path:
        if not isinstance(found, Mapping) or key not in found:
            raise InputError(f"no entry {'.'.join(map(str, path))}")
        found = found[key]
    return found
