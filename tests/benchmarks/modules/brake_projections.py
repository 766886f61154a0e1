"""Brake disk: how well atoms hold the states of full order, before any equation is reduced.

The best approximation of every stored state, largest error over the run relative to the field's
largest change. POD atoms learned at 60 km/h and friction 0.7; pulses, attachment and static modes
come from the tables of each case's own rigid stage, as the packaged reducer has them. Displacements
also by their projection in the energy of a step, D: what Galerkin makes of exact temperatures.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import common  # noqa: F401  # before NumPy: it limits linear algebra to one thread
import numpy as np
from modules import report

from sparsemor.core import Dictionary
from sparsemor.core.arrays import Csr, FloatArray
from sparsemor.core.model.block_patterns import matched_option
from sparsemor.core.model.model import StepFactors
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.stages_before_steps import prepared

POD = {"disk.thermal": (50, 100, 200, 400), "disk.elastic": (20, 50, 100, 200),
       "pad.elastic": (20, 40)}
PULSES = (100, 200, 300, 400, 500)


def fill(
    table: report.Table, cases: Mapping[str, tuple[Scene, RunResult]],
    packaged: Mapping[str, Any], beside: Mapping[str, Mapping[str, Any]],
) -> None:
    """A line a block and kind of atoms, a column a case. cases: the scene that is run, with its
    training, and its run of full order; beside: other reducers whose disk's heat is asked for."""
    lines: dict[tuple[str, str], dict[str, Any]] = {}
    for case, (scene, truth) in cases.items():
        model, offline = prepared(scene.using({"reducer": packaged}), Cache(), new_manager())
        step = StepFactors(scene.time.step, *scene.integrator.rules(scene.time.step).factors)
        states = {b: truth.block(b, slice(None)) for b in (*POD, "pad.thermal")}
        for block, atoms, basis, counts in wanted(packaged, beside):
            made = scene.using({"reducer": basis}).reducer
            d, _ = offline.dictionary(block, matched_option(block, made.bases, made.basis), step)
            for count in counts or (d.atoms.shape[1],):
                if count > d.atoms.shape[1]:
                    continue
                key = block, atoms.format(count)
                d_k = leading(d, count)
                lines.setdefault(key, {})[case] = missed(d_k, states[block])
                if block.endswith("elastic"):
                    D = model.block_data(block, step=step).operator
                    lines[key][f"{case}, by energy"] = missed(d_k, states[block], D)
                report.progress(f"{case}, {key}: {lines[key]}")
    for (block, atoms), errors in lines.items():
        table.add(block=block, atoms=atoms, **errors)


def wanted(
    packaged: Mapping[str, Any], beside: Mapping[str, Mapping[str, Any]],
) -> Iterator[tuple[str, str, dict[str, Any], Sequence[int]]]:
    """Block, its atoms in words, a reducer that has them, and how many of the leading ones."""
    for block, counts in POD.items():
        yield block, "POD {}", {"use": "galerkin", "basis": {
            "use": "pod", "count": max(counts)}}, counts
    for count in PULSES:
        basis = {**packaged["basis"], "count": count}
        yield "disk.thermal", f"{count} pulses", {"use": "galerkin", "basis": basis}, ()
    for name, reducer in beside.items():
        yield "disk.thermal", name, dict(reducer), ()
    for block in ("disk.elastic", "pad.elastic", "disk.thermal", "pad.thermal"):
        yield block, "as packaged", dict(packaged), ()


def leading(d: Dictionary, count: int) -> Dictionary:
    return Dictionary(d.atoms[:, :count], d.offset, d.provenance[:count])


def missed(d: Dictionary, states: FloatArray, D: Csr | None = None) -> float:
    """Largest distance of states (j, n) from their projection on the atoms, of the largest change;
    in the inner product of D (n, n) where it is given."""
    X = states.T - d.offset[:, None]
    Q = np.linalg.qr(d.atoms)[0]
    c = Q.T @ X if D is None else np.linalg.solve(Q.T @ (D @ Q), (D @ Q).T @ X)
    left = np.linalg.norm(X - Q @ c, axis=0)
    return float(left.max() / np.linalg.norm(X - X[:, :1], axis=0).max())
