"""Studies of any scene: each compares the installed plugins of one kind.

A function returns the definition of a study, as in a study file without its `scene`: `grid` or
`list` are the runs, `set` the changes to the scene that all of them share; `method` and `budget`
name the columns of the table by which runs are compared, and over which their errors are drawn.
"""

import math
from collections.abc import Mapping
from typing import Any

from sparsemor.core.model.block_patterns import matched_option
from sparsemor.plugins.study.varied_scene import Subject

ROWS = (1, 2, 4, 8)
"""Sampled rows of a block, in multiples of its atoms."""
FRACTIONS_OF_ATOMS = (0.25, 0.5, 0.75)
"""Active atoms of a block, relative to all of its atoms."""
STEPS = (4.0, 2.0, 1.0, 0.5)
"""Time steps in multiples of that of the scene."""
FINER = 8
"""Number by which the step of the scene is divided in the reference of all time steps."""
SEEDS = [1, 2, 3]


def methods(subject: Subject) -> Mapping[str, Any]:
    """Study of the reducers that have bases over their number of atoms (`ladder`: of the largest
    block; the others in proportion), each with the options that the scene gives it. Contents of a
    study file, in which `method` and `budget` name the columns that distinguish the lines of the
    chart, and the one along them."""
    # `auto` is left out: it would be replaced by one of the others
    names = [name for name, cls in subject.installed("reducer")
             if {"basis", "bases"} <= {*cls.model_fields} and not cls().chooses]
    return {
        "title": "Methods over their number of atoms",
        **subject.outside_training(), "method": "method", "budget": "atoms",
        "grid": {
            "method": {name: {"reducer": subject.own(name)} for name in names},
            "atoms": {str(k): subject.bases(k) for k in subject.ladder()}}}


def samplers(subject: Subject) -> Mapping[str, Any]:
    """Study of the samplers over their number of rows, with and without those of joints and loads
    (`required`), three seeds each; all atoms of the sparse method are active. Contents of a study
    file: a line of its chart for each sampler, along which the number of rows varies."""
    drawn: dict[str, Any] = {}
    for name, cls in subject.installed("sampler"):
        if "required" in cls.model_fields:
            drawn[f"{name}, required"] = _sampler({"use": name, "required": True})
            drawn[f"{name}, none required"] = _sampler({"use": name, "required": False})
        else:
            drawn[name] = _sampler({"use": name})
    return {
        "title": "Sampled rows: where, and how many for an atom",
        **_sparse_with_complete_bases(subject, {"residual": "plain"}), "seeds": SEEDS,
        "method": "sampler", "budget": "rows",
        "grid": {"sampler": drawn, "rows": _rows(subject)}}


def preconditioners(subject: Subject) -> Mapping[str, Any]:
    """Study of the preconditioners of the sampled rows over their number, three seeds each; all
    atoms of the sparse method are active. Contents of a study file: a line of its chart for each
    preconditioner, along which the number of rows varies."""
    return {
        "title": "Preconditioners of the sampled rows, over the number of rows for an atom",
        **_sparse_with_complete_bases(subject, {"residual": "plain", "preconditioned": ["*"]}),
        "seeds": SEEDS, "method": "preconditioner", "budget": "rows",
        "grid": {
            "preconditioner": {name: {"reducer.preconditioner": {"use": name}}
                               for name, _ in subject.installed("preconditioner")},
            "rows": _rows(subject)}}


def solvers(subject: Subject) -> Mapping[str, Any]:
    """Study of the sparse solvers over the number of atoms that they choose in each step. Bases and
    numbers of rows are those of the scene in all runs. Contents of a study file: a line of its
    chart for each solver, along which the number of active atoms varies."""
    all_atoms = subject.atoms

    def active(atoms: int) -> dict[str, Any]:
        """Budgets with this number of active atoms in the largest block."""
        return {"reducer.budgets": subject.budgets(
            lambda name: {**_rows_in_scene(subject, name), "atoms": subject.count(name, atoms)})}

    return {
        "title": f"Sparse solvers that choose some of {all_atoms} atoms in each step",
        **_sparse_with_complete_bases(subject, {}), "method": "solver", "budget": "atoms",
        "grid": {
            "solver": {name: {"reducer.solver": {"use": name}}
                       for name, _ in subject.installed("sparse_solver")},
            "atoms": {str(k): active(k) for k in sorted({
                max(1, math.ceil(s * all_atoms)) for s in FRACTIONS_OF_ATOMS})}}}


def bases(subject: Subject) -> Mapping[str, Any]:
    """Study of the bases over their number of atoms, by Galerkin projection; a basis without the
    option `count` is one run with all of its atoms. Contents of a study file: a line of its chart
    for each basis, along which the number of atoms of all blocks varies."""
    runs = []
    for name, cls in subject.installed("basis"):
        own = {"use": name}
        for k in subject.ladder() if "count" in cls.model_fields else [0]:
            basis = subject.bases(k, dict.fromkeys(subject.blocks, own).__getitem__) if k else {
                "reducer.basis": own}
            runs.append({"label": name, "reducer": {"use": "galerkin", **{
                key.removeprefix("reducer."): value for key, value in basis.items()}}})
    return {"title": "Bases over their number of atoms, by Galerkin projection",
            **subject.outside_training(), "method": "label", "budget": "atoms_all", "list": runs}


def integrators(subject: Subject) -> Mapping[str, Any]:
    """Study of the time integrators over their step, at full order and with the scene's reducer,
    against one reference with a finer step. Contents of a study file: a line of its chart for each
    integrator and reducer, along which the step varies."""
    time, own = subject.scene.time, subject.reducer["use"]
    steps = [float(f"{f * time.step:.12g}") for f in STEPS]
    # steps of which the run has a whole number
    whole = [h for h in steps if abs(time.end / h - round(time.end / h)) < 1e-9 and h <= time.end]
    reducers: dict[str, Any] = {"full": {"reducer": {"use": "full"}}}
    if own != "full":
        reducers[own] = {}  # no change: that of the scene
    best = dict(subject.scene.dump()["integrator"])
    if best["use"] == "bdf1":  # of first order: its own fine steps would not be fine enough
        best = {"use": "bdf2"}
    return {
        "title": f"Time integrators over their step, against steps of {time.step / FINER:.4g} s "
                 f"of {best['use']}",
        "set": {"training.end": time.end} if not subject.trains_elsewhere else {},
        "reference": {"fixed": {"integrator": best, "time.step": time.step / FINER}},
        "method": ["integrator", "reducer"], "budget": "time.step",
        "grid": {
            "integrator": {name: {"integrator": {"use": name}}
                           for name, _ in subject.installed("integrator")},
            "reducer": reducers, "time.step": whole}}


def _sparse_with_complete_bases(subject: Subject, options: Mapping[str, Any]) -> dict[str, Any]:
    """Keys of a study of the sparse method, whose bases have as many atoms as those of the scene,
    all of them active unless a run sets budgets; options: of the method."""
    outside = subject.outside_training()
    bases = {key.removeprefix("reducer."): value
             for key, value in subject.bases(subject.atoms).items()}
    reducer = {**subject.own("sparse"), **options, **bases}
    return {**outside, "set": {**outside.get("set", {}), "reducer": reducer}}


def _rows(subject: Subject) -> dict[str, Any]:
    """Numbers of rows for an atom -> budgets of the blocks."""
    def rows(factor: int) -> dict[str, Any]:
        return {"reducer.budgets": subject.budgets(lambda name: {
            "rows": min(factor * subject.pods[name]["count"], subject.blocks[name])})}

    return {str(factor): rows(factor) for factor in ROWS}


def _rows_in_scene(subject: Subject, name: str) -> dict[str, int]:
    """Budget of a block as the scene gives it to the sparse method: its number of sampled rows."""
    found = matched_option(name, subject.own("sparse").get("budgets", {}), {})
    return {k: v for k, v in found.items() if v is not None}


def _sampler(options: Mapping[str, Any]) -> dict[str, Any]:
    return {"reducer.sampler": dict(options)}
