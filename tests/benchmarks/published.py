"""How often sampled rows fail, as published (no row is kept for joints and loads) and with them.

    python tests/benchmarks/published.py [--quick] [--out published.json]

First 30/20 POD atoms on a fixed support with fewer and fewer rows, then the packaged scene
`double_pendulum_published`: complete square bases, UNTF on the thermal rows, atoms chosen anew in
each step.
"""

import argparse
import sys
from collections import Counter

import common
from modules import report

ATOMS = (30, 20)
BAD, UNHEATED = 1e-2, (0.9, 1.1)
"""Relative error of a field (rad for the angle) that counts as failure; thermal error of a link
that stays at its first temperature."""


def fill(out: report.Report, given: argparse.Namespace) -> None:
    out.settings |= {
        "scene": "double_pendulum and double_pendulum_published, bdf1, h = 1 ms",
        "atoms": f"{ATOMS[0]}/{ATOMS[1]} POD (or the numerical rank), nothing selected",
        "rows": "by lhs; kept: the rows of joints and heated edges on top of them",
        "seeds": f"1 to {given.seeds} on 1280 triangles, 1 to {given.fine_seeds} on 20480",
        "a run failed if": f"it stopped, or an angle is off by more than {BAD:g} rad, or a field "
                           f"by more than {BAD:g} of its largest change (elastic: from 0.1 s on)",
        "its name": "stopped: with what status, in which block, when; never heated: thermal error "
                    f"from {UNHEATED[0]} to {UNHEATED[1]}; inaccurate: all others",
        "first off": f"the block whose error exceeds {BAD:g} first"}
    counts = out.table("Failures on a fixed support")
    named = out.table("Every failure")
    packaged = out.table("The packaged published scene", iterations=".2f")
    for elements, end, seeds, samples in given.runs:
        report.progress(f"{elements} triangles: full order over {end:g} s")
        case = common.Case.of(common.scene_at(elements, end))
        for rows in samples:
            for required in (False, True):
                one_sample(case, counts, named, elements, rows, seeds, required)
    as_packaged(packaged, given)


def one_sample(
    case: common.Case, counts: report.Table, named: report.Table, elements: int,
    rows: tuple[int, int], seeds: int, required: bool,
) -> None:
    """All seeds of one number of rows."""
    kinds: Counter[str] = Counter()
    good: list[dict[str, float]] = []
    label, kept = f"{rows[0]}/{rows[1]}", "kept" if required else "as published"
    for seed in range(1, seeds + 1):
        kind, what, first, errors = judged(case, rows, seed, required)
        kinds[kind] += 1
        if kind == "good":
            good.append(errors)
        else:
            named.add(triangles=elements, rows=label, required=kept, seed=seed, failure=kind,
                      first_off=first, seen=what, **errors)
    counts.add(
        triangles=elements, rows=label, required=kept, seeds=seeds, failed=seeds - kinds["good"],
        stopped=kinds["stopped"], never_heated=kinds["never heated"],
        inaccurate=kinds["inaccurate"],
        **{f"worst_good_{k}": max((e[k] for e in good), default=None)
           for k in ("angle", "elastic", "thermal")})
    report.progress(f"{elements} triangles, {label}, {kept}: {dict(kinds)}")


def judged(
    case: common.Case, rows: tuple[int, int], seed: int, required: bool
) -> tuple[str, str, str, dict[str, float]]:
    """Kind of failure (or "good"), what was seen, where first, errors as far as the run came."""
    run = case.run(common.sparse(rows, ATOMS, required=required), seed)
    if not isinstance(run, common.Trajectory):
        return "stopped", common.in_words(run), "", {}
    errors = case.errors(run)
    if run.failure is None and all(e <= BAD for e in errors.values()):
        return "good", "", "", errors
    first = case.first_off(run, BAD)
    missed = "; ".join(note.text.partition(":")[0] for note in run.solver.notes)
    if run.failure is not None:
        seen = common.in_words(run.failure) + (f"; {missed}" if missed else "")
        return "stopped", seen, first, errors
    cold = UNHEATED[0] <= errors["thermal"] <= UNHEATED[1]
    return "never heated" if cold else "inaccurate", missed, first, errors


def as_packaged(table: report.Table, given: argparse.Namespace) -> None:
    """The scene as it is packaged, and with one thing changed."""
    scene = common.scene_at(1280, given.trained, "double_pendulum_published")
    case = common.Case.of(scene, round(given.packaged / scene.time.step))
    centred = {"use": "pod", "centred": True, "complete": True}
    own = {**scene.dump()["reducer"], "resample": None, "basis": centred}
    one_by_one = {**own["solver"], "growth": 1, "max_iterations": 300}
    changed = {
        "one draw of rows, centred": own,
        "preconditioner none": {**own, "preconditioner": {"use": "none"}},
        "required rows kept": {**own, "sampler": {**own["sampler"], "required": True}},
        "one atom at a time": {**own, "solver": one_by_one},
        "one at a time, none": {**own, "solver": one_by_one, "preconditioner": {"use": "none"}},
        # UNTF is not defined for fewer atoms than rows
        "atoms above round-off": {**own, "basis": {"use": "pod", "centred": True},
                                  "preconditioner": {"use": "none"}, "polish": True},
    }
    for name, reducer in list(changed.items())[:: 5 if given.quick else 1]:
        for seed in range(1, given.packaged_seeds + 1):
            run = case.run(reducer, seed)
            if not isinstance(run, common.Trajectory):
                table.add(variant=name, seed=seed, status=common.in_words(run))
                continue
            table.add(
                variant=name, seed=seed, **case.errors(run), ms=run.ms, iterations=run.iterations,
                changes=run.support_changes, steps=len(run.x) - 1,
                status="done" if run.failure is None else common.in_words(run.failure))
            report.progress(f"{name}, seed {seed}: {table.rows[-1]}")


def arguments() -> argparse.Namespace:
    parser = report.options("published", __doc__)
    parser.add_argument("--seeds", type=int, default=30)
    parser.add_argument("--fine-seeds", type=int, default=20)
    parser.add_argument("--packaged", type=float, default=0.3, metavar="S",
                        help="how long the packaged scene runs, s")
    parser.add_argument("--packaged-seeds", type=int, default=3)
    given = parser.parse_args()
    samples = [(240, 80), (60, 40), (36, 24), (30, 20)]
    given.runs = [(1280, 4.0, given.seeds, samples), (20480, 1.0, given.fine_seeds, samples[:1])]
    given.trained = 4.0
    if given.quick:
        given.runs, given.packaged_seeds = [(1280, 0.06, 2, [(240, 80), (36, 24)])], 1
        given.packaged, given.trained, given.seeds, given.fine_seeds = 0.002, 0.06, 2, 0
    given.runs = [run for run in given.runs if run[2] > 0]
    return given


if __name__ == "__main__":
    sys.exit(report.run_plan("published", fill, arguments()))
