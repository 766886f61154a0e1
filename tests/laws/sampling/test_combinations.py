"""basis x sampler x preconditioner x sparse solver x integrator: each runs, or is refused with a
reason that stands here. There is no third outcome."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.sparse import csr_array

from sparsemor.core import ReducedProblem, State, StepSolver
from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.model.model import Model
from sparsemor.core.protocols.integrator import advanced, step_formula
from sparsemor.core.protocols.load_tables import LoadTable, Table
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.scene.scene import Scene, load
from sparsemor.core.simulation.offline import Offline, step_count
from sparsemor.core.simulation.training import train
from sparsemor.core.status import SolveFailed, Status
from sparsemor.core.testing import installed
from sparsemor.plugins.stability.stability_check import ReferenceModels, judge

TINY = Path(__file__).parents[2] / "scenes" / "tiny.yaml"
STEPS = 3
BUDGETS = {"*.elastic": {"rows": 24, "atoms": 4}, "*.thermal": {"rows": 4, "atoms": 3}}
OPTIONS: dict[tuple[str, str], dict[str, Any]] = {
    ("basis", "dictionary"): {"bases": ["pod", {"use": "modal", "count": 3}]},
}
MODES = {"use": "dictionary", "bases": ["pod", {"use": "attachment", "patches": 3}]}
PULSES = {"use": "dictionary", "bases": ["pod", {"use": "impulse", "count": 4}]}
BESIDE: dict[str, dict[str, Any]] = {
    "craig_bampton": {"*.thermal": "modal"}, "attachment": {"*": MODES},
    "impulse": {"*.elastic": "pod", "*.thermal": PULSES},
}
"""Bases of other blocks, for one that is not defined for all or holds the moving loads alone.
Attachment modes stand beside POD: static ones alone do not span this scene, the four atoms that
CoSaMP keeps leave one to twenty percent of the rows, and for one sampler (every_nth, row_scaling,
bdf1) Gauss-Newton on them ends not converged."""
REFUSED = {
    "unstable": r"the reduced model is unstable in bar\.(elastic|thermal): its coupled time-step",
}
"""Every reason for which a combination of these parts may be refused on this scene. The last one is
asked of runs that diverge: `check_stability: refuse` says it before their first step."""
KINDS = ("basis", "sampler", "preconditioner", "sparse_solver", "integrator")


def part(kind: str, name: str) -> dict[str, Any]:
    return {"use": name, **OPTIONS.get((kind, name), {})}


@dataclass(frozen=True, eq=False)
class Trained:
    scene: Scene
    model: Model
    start: State
    snapshots: dict[str, FloatArray]


@lru_cache
def trained(integrator: str) -> Trained:
    scene = load(TINY, {"integrator": integrator})
    snapshots = train(scene.for_training(), new_manager())
    model = with_moving_loads(assemble(scene))
    return Trained(scene, model, consistent_state(model), {n: s.T for n, s in snapshots.items()})


def with_moving_loads(model: Model) -> Model:
    """A weak push and a weak source that walk along the upper edge, for bases made from these."""
    (heat,), (body,) = model.separated.heat, model.separated.moving
    assert body.operators is not None
    return replace(model, separated=replace(
        model.separated, heat=(replace(heat, tables=(walk(model, heat.thermal),)),),
        moving=(replace(body, operators=replace(
            body.operators, tables=(walk(model, body.elastic),))),)))


def walk(model: Model, block: str) -> LoadTable:
    places, component = model.geometry[block]
    rows = np.flatnonzero(np.isclose(places[:, 1], 0.05) & (component == component.max()))
    times = np.linspace(0.0, 8e-3, 9)
    values = np.maximum(0.0, 1.0 - np.abs(np.arange(len(rows)) - times[:, None] / 2e-3))
    columns = csr_array((np.ones(len(rows)), (rows, np.arange(len(rows)))),
                        shape=(len(places), len(rows)))
    return LoadTable("walk", columns, tuple(f"walk, point {i}" for i in range(len(rows))),
                     Table(times, values))


def outcome(basis: str, sampler: str, preconditioner: str, solver: str, integrator: str) -> str:
    """"" when it ran, else the reason of the refusal; anything else is raised."""
    given = trained(integrator)
    scene = given.scene.using({"reducer": {
        "use": "sparse", "budgets": BUDGETS, "basis": part("basis", basis),
        # of so few rows of D^-1 r it takes dependent atoms, which is a status
        "residual": "plain" if solver == "hard_thresholding" else "auto",
        "bases": BESIDE.get(basis, {}),
        "sampler": part("sampler", sampler),
        "preconditioner": part("preconditioner", preconditioner),
        "solver": part("sparse_solver", solver)}})
    try:
        faults = scene.reducer.check(given.model)
        if faults:
            raise InputError(faults)
        stepper = scene.reducer.prepare(ReducedProblem(
            given.model, scene.integrator, scene.time.step, Offline.from_snapshots(given.model,
            given.snapshots), np.random.default_rng(scene.seed)))
    except InputError as error:
        return str(error)
    try:
        run(scene, given, stepper)
    except SolveFailed as failure:
        precheck_memory = judge(stepper, scene.integrator, scene.time.step, step_count(scene),
                         given.start, ReferenceModels(given.model))
        if failure.status is not Status.DIVERGED or precheck_memory.stable:
            raise
        return precheck_memory.in_words()
    return ""


def run(scene: Scene, given: Trained, stepper: StepSolver) -> None:
    h, integrator = scene.time.step, scene.integrator
    state, memory = stepper.start(given.start)
    state = integrator.start(stepper.layout, state)
    for _ in range(STEPS):
        formula = step_formula(integrator.rules(h), stepper.layout, state, h)
        found, memory = stepper.solve(formula, memory)
        if not found.status.ok:
            raise SolveFailed(found.status, formula.t, found.block, found.detail)
        assert np.isfinite(found.x).all()
        state = advanced(integrator.rules(h), stepper.layout, state, formula, found)


DEFAULT = ("greedy_gauss_newton", "bdf1")
PAIRS = [pair for pair in product(installed("sparse_solver"), installed("integrator"))
         if pair != DEFAULT]
"""Solvers and integrators, but for the pair that the full tier takes."""


def every_two() -> Iterator[tuple[str, str, str]]:
    """Basis, sampler, preconditioner: few that hold each pair of plugins of two kinds."""
    bases, samplers, others = (list(installed(k)) for k in KINDS[:3])
    for (i, basis), (j, sampler) in product(enumerate(bases), enumerate(samplers)):
        yield basis, sampler, others[(i + j) % len(others)]


@pytest.mark.full
@pytest.mark.end_to_end
def test_every_two_parts() -> None:
    chosen = list(every_two())
    for one, other in ((0, 1), (0, 2), (1, 2)):
        kinds = installed(KINDS[one]), installed(KINDS[other])
        assert {(c[one], c[other]) for c in chosen} == set(product(*kinds))
    all_known(chosen, *DEFAULT)


@pytest.mark.slow
@pytest.mark.parametrize(("solver", "integrator"), PAIRS)
def test_every_two_parts_with_each_solver_and_integrator(solver: str, integrator: str) -> None:
    all_known(every_two(), solver, integrator)


@pytest.mark.slow
def test_all_bases_samplers_and_preconditioners_of_the_default_solver() -> None:
    all_known(product(*(installed(k) for k in KINDS[:3])), *DEFAULT)


def all_known(parts: Iterable[tuple[str, ...]], solver: str, integrator: str) -> None:
    """Fails with all combinations that neither run nor are refused for a known reason."""
    unknown = []
    for basis, sampler, preconditioner in parts:
        names = (basis, sampler, preconditioner, solver, integrator)
        try:
            reason = outcome(*names)
        except SolveFailed as error:
            unknown.append(f"{names}: {error}")
            continue
        if reason and not any(re.search(known, reason) for known in REFUSED.values()):
            unknown.append(f"{names}: {reason}")
    assert not unknown, "\n".join(unknown)
