"""Results that are written without a run: one arm with a rigid, an elastic and a thermal block."""

from pathlib import Path
from typing import Any

import numpy as np

from sparsemor.bodies.terms import field_kinds
from sparsemor.core import BodyShape, Dictionary
from sparsemor.core.protocols.layout import Block, Layout
from sparsemor.core.results.metadata import RunHeader
from sparsemor.core.results.result_writer import ChunkOfSteps, ResultWriter
from sparsemor.core.results.run_result import RunResult, open_result
from sparsemor.core.status import Status

RIGID, ELASTIC = Block("arm", field_kinds.RIGID, 3), Block("arm", field_kinds.ELASTIC, 8)
THERMAL, PIN = Block("arm", field_kinds.THERMAL, 4), Block("pin", field_kinds.MULTIPLIER, 2)
ALL = (RIGID, ELASTIC, THERMAL, PIN)
TIMES = np.linspace(0.0, 1.0, 41)
POINTS = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.2], [0.0, 0.2]])


def motion(blocks: tuple[Block, ...], times: np.ndarray) -> np.ndarray:
    layout = Layout(blocks)
    x = np.zeros((len(times), layout.size))
    shapes: dict[str, list[float]] = {
        "rigid": [0.5, -0.5, -2.0], "elastic": [1e-3] * 8, "thermal": [80.0] * 4,
        "multiplier": [10.0, 20.0]}
    for b in layout:
        x[:, layout[b.name]] = np.outer(times, shapes[b.field])
        if b.field == "thermal":
            x[:, layout[b.name]] += 293.15
    return x


def write_run(
    path: Path, blocks: tuple[Block, ...] = ALL, x: np.ndarray | None = None,
    times: np.ndarray = TIMES, status: Status = Status.DONE, seconds: float = 4e-3,
    dictionary: Dictionary | None = None, cost: dict[str, Any] | None = None,
    scene: dict[str, Any] | None = None,
) -> RunResult:
    full = Layout(blocks)
    x = motion(blocks, times) if x is None else x
    shape = BodyShape(
        POINTS, np.array([[0, 1, 2], [0, 2, 3]]), np.arange(8) if ELASTIC in blocks else None,
        np.arange(4) if THERMAL in blocks else None)
    dictionaries = {"arm.elastic": dictionary} if dictionary else {}
    supports = {}
    layout = full
    if dictionary:
        k = dictionary.atoms.shape[1]
        layout = full.resized({"arm.elastic": k})
        place = full["arm.elastic"]
        c = (x[:, place] - dictionary.offset) @ dictionary.atoms
        x = np.concatenate([x[:, :place.start], c, x[:, place.stop:]], axis=1)
        supports["arm.elastic"] = np.arange(k) <= np.arange(len(times))[:, None] % k
    writer = ResultWriter.create(path / "result", RunHeader(
        scene or {}, "d", 1, {}, "sparse" if dictionary else "full", layout, full, 0.025, 40,
        dictionaries, {"arm.elastic": np.arange(5)} if dictionary else {}, {"arm": shape}))
    writer.append(ChunkOfSteps(times, x, np.full(len(times), 3), np.zeros(len(times)),
                               np.full(len(times), seconds), supports))
    writer.finish(status, cost or {
        "wall_s": {"offline": 2.5, "online": 1.0}, "ms_per_step": 1e3 * seconds})
    return open_result(path)
