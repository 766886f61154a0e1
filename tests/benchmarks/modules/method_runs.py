"""Runs of many reducers on one scene, in numbers: what slider.py and brake_disk.py share."""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from modules import report

from sparsemor.core.errors import InputError
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.simulate import simulate
from sparsemor.core.status import SolveFailed
from sparsemor.plugins.comparison.compare import measure_errors
from sparsemor.plugins.comparison.cost import run_facts
from sparsemor.plugins.comparison.error_norms import Errors

STOPPED = 1e300
"""Stands for the error of a run that stopped before there was one."""
PHASES = ("start-up", "steady")
MEANINGS = {
    "start-up": "largest error in the first 2 % of the steps; steady: in the rest",
    "errors": "of a field: relative to its largest change; combined: of all unknowns, "
              "relative to their norm at the same time, as the paper defines it",
    "ms": "online time over steps, writing included, and how often full order takes that"}
"""What the columns of the tables are."""


def seeds_told(count: int) -> str:
    return f"1 to {count} where rows are drawn; worst seed, and how many stopped"


def file_name(text: str) -> str:
    return text.replace(" ", "_").replace("/", "")


def run(scene: Scene, path: Path) -> RunResult | SolveFailed | InputError:
    try:
        return simulate(scene, out=path)
    except (SolveFailed, InputError) as failure:
        return failure


def full_of(scene: Scene, path: Path) -> RunResult:
    truth = run(scene.using({"reducer": "full"}), path)
    assert isinstance(truth, RunResult)
    return truth


def one(scene: Scene, truth: RunResult, path: Path, blocks: Sequence[str]) -> dict[str, Any]:
    """One run in numbers; None where it did not get so far."""
    none = _nothing(blocks)
    ended = run(scene, path)
    if isinstance(ended, InputError):
        return {**none, "status": f"refused: {ended}"}
    status, result = "done", ended
    if isinstance(ended, SolveFailed):
        status = f"{ended.status.value} at {ended.time:.3g} s in {ended.block}"
        result = getattr(ended, "result", ended)
    if not isinstance(result, RunResult):
        return {**none, "status": str(ended)}
    facts, base = run_facts(result), run_facts(truth)
    seen = result.summary.get("stability") or {}
    row = {**none, "ms": facts.ms_per_step, "offline_s": facts.offline_whole_seconds,
           "atoms": facts.atoms_text, "rows": facts.rows, "radius": seen.get("radius"),
           "growth": seen.get("growth"), "stopped": status != "done", "status": status,
           "steps": facts.steps}
    if facts.ms_per_step and base.ms_per_step:
        row["speed_up"] = base.ms_per_step / facts.ms_per_step
    if facts.steps > 1:
        row |= _phases(measure_errors(truth, result), blocks)
    return row


def over_seeds(
    base: Scene, truth: RunResult, folder: Path, blocks: Sequence[str], name: str, options: Any,
    seeds: int,
) -> list[dict[str, Any]]:
    """`one` for a reducer of that name at seeds 1, 2, ..."""
    rows = []
    for seed in range(1, seeds + 1):
        scene = base.using({"reducer": options, "seed": seed})
        rows.append(one(scene, truth, folder / file_name(f"{name}-{seed}"), blocks))
        report.progress(f"{name}, seed {seed}: {rows[-1]}")
    return rows


def over_whole_run(row: Mapping[str, Any], measure: str) -> float | None:
    """Largest error of a field, or of `combined`, start-up included."""
    known = [v for when in PHASES if (v := row[f"{measure} {when}"]) is not None]
    return max(known) if known else None


def elsewhere_columns(row: Mapping[str, Any], blocks: Sequence[str]) -> dict[str, Any]:
    """A run outside training as a row of a table."""
    errors = {m: over_whole_run(row, m) for m in (*blocks, "combined")}
    more = ("ms", "speed_up", "offline_s", "atoms", "status")
    return {**errors, **{key: row[key] for key in more}}


def _nothing(blocks: Sequence[str]) -> dict[str, Any]:
    row = {f"{m} {when}": None for m in ("combined", *blocks) for when in PHASES}
    more = ("ms", "speed_up", "offline_s", "atoms", "rows", "radius", "growth")
    return {**row, **dict.fromkeys(more), "stopped": True}


def _phases(e: Errors, blocks: Sequence[str]) -> dict[str, float | None]:
    found: dict[str, float | None] = {}
    for m in ("combined", *blocks):
        found[f"{m} start-up"], found[f"{m} steady"] = e.start_up.get(m), e.steady.get(m)
    return found


def worst(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The worst seed of each number, and in words how runs ended that stopped."""
    found: dict[str, Any] = {}
    for key in rows[0]:
        values = [r[key] for r in rows if isinstance(r.get(key), int | float)]
        if key in ("stopped", "status", "steps"):
            continue
        if key in ("ms", "speed_up", "offline_s", "rows"):
            found[key] = float(np.median(values)) if values else None
        elif key == "atoms":
            found[key] = rows[0][key]
        else:
            found[key] = max(values) if values else None
    ends = [str(r["status"]) for r in rows if r["stopped"]]
    found["stopped"] = f"{len(ends)}/{len(rows)}"
    found["how"] = ends[0][:90] if ends else ""
    steps = [r["steps"] for r in rows if r["stopped"] and r.get("steps") is not None]
    if steps:
        found["how"] += f"; {min(steps)} to {max(steps)} steps were taken"
    return found


def options(name: str, text: str | None, seeds: int) -> argparse.ArgumentParser:
    """The command line of a benchmark of methods, in training and outside of it."""
    parser = report.options(name, text)
    parser.add_argument("--seeds", type=int, default=seeds)
    parser.add_argument("--only", nargs="+", metavar="NAME", help="these methods alone")
    parser.add_argument("--inside", action="store_true", help="only in training")
    parser.add_argument("--outside", action="store_true", help="only outside of it")
    return parser
