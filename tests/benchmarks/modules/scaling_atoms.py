"""Brake disk on a finer mesh: how well atoms hold the training run, before anything is reduced.

In a process of its own, which `scaling_worker.py` starts. Best approximations as in
`brake_projections.py`; pulses of fewer atoms are the leading ones of more.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from modules import report
from modules.brake_projections import leading, missed

from sparsemor.core.model.block_patterns import matched_option
from sparsemor.core.model.model import Model, StepFactors
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.offline import Offline


def projections(
    scene: Scene, model: Model, offline: Offline, tabled: Sequence[int], counts: Sequence[int],
) -> dict[str, Any]:
    """Largest distance over the largest change. Of the scene's reducer, by block and, for
    displacements, also in the energy of a step; of the disk's temperatures, by shapes of the table
    and number of pulses."""
    h = scene.time.step
    step = StepFactors(h, *scene.integrator.rules(h).factors)
    own, found = scene.dump()["reducer"], dict[str, float]()
    for block in model.reducible():
        if block != "disk.thermal":
            d, _ = offline.dictionary(
                block, matched_option(block, scene.reducer.bases, scene.reducer.basis), step)
            states = offline.snapshots(block).T
            found[block] = missed(d, states)
            if block.endswith("elastic"):
                D = model.block_data(block, step=step).operator
                found[f"{block}, by energy"] = missed(d, states, D)
            report.progress(f"{block}, {d.atoms.shape[1]} atoms: {found[block]:.3g}")
    pulses = {str(shapes): _pulses(scene, offline, {
        **own["basis"], "tabled": shapes, "count": max(counts)}, step, counts)
        for shapes in tabled}
    return {"found": found, "pulses": pulses}


def _pulses(
    scene: Scene, offline: Offline, basis: Mapping[str, Any], step: StepFactors,
    counts: Sequence[int],
) -> dict[str, float]:
    """Number of pulses -> what they miss."""
    made = scene.using({"reducer": {"use": "galerkin", "basis": dict(basis)}}).reducer
    d, _ = offline.dictionary("disk.thermal", made.basis, step)
    states = offline.snapshots("disk.thermal").T
    lasting = sum(not name.startswith("impulse") for name in d.provenance)
    found = {}
    for count in counts:
        found[str(count)] = missed(leading(d, lasting + count), states)
        report.progress(f"{basis['tabled']} shapes, {count} pulses: {found[str(count)]:.3g}")
    return found
