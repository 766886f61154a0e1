"""The counting law: nothing that a reduced step can touch has the size of the mesh."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
from pathlib import PurePath
from typing import Any

import numpy as np
import pytest
from scipy.sparse import issparse

from sparsemor.core import ReducedProblem
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.model.model import Model
from sparsemor.core.protocols.integrator import advanced, step_formula
from sparsemor.core.scene.scene import Scene, load
from sparsemor.core.simulation.offline import Offline
from sparsemor.core.testing.in_memory_run import march
from sparsemor.reducers.sparse.block_selection import BlockwiseSelection
from sparsemor.reducers.sparse.supported_steps import SparseStepper
from sparsemor.reducers.step.blockwise_solver import BlockwiseSolver

OFFLINE = {"dictionaries", "rows", "separated", "model", "body", "dictionary"}
"""What a solver keeps for decoding, and for preparing supports where there are local terms."""
COARSE, FINE = 1280, 5120
BASES = {"basis": {"use": "pod", "count": 8}, "bases": {"*.thermal": {"use": "pod", "count": 5}}}
FREE = {"sampler": {"use": "lhs", "required": False}, "preconditioner": "none"}
REDUCERS: dict[str, dict[str, Any]] = {
    "galerkin": {"use": "galerkin", **BASES},
    "deim": {"use": "deim", **BASES},
    "lspg": {"use": "lspg", **BASES},
    "gnat": {"use": "gnat", **BASES},
    "sparse": {"use": "sparse", **BASES, **FREE, "budgets": {
        "*.elastic": {"rows": 60, "atoms": 8}, "*.thermal": {"rows": 30, "atoms": 5}}},
    "selecting": {"use": "sparse", **BASES, **FREE, "budgets": {
        "*.elastic": {"rows": 60, "atoms": 5}, "*.thermal": {"rows": 30, "atoms": 3}}},
}


@cache
def trained(elements: int) -> tuple[Scene, Model, Mapping[str, Any]]:
    """The double pendulum, its model and snapshots of 20 steps."""
    scene = load("double_pendulum", {
        "bodies.link1.mesh.elements": elements, "bodies.link2.mesh.elements": elements,
        "time.end": 0.02, "training.end": 0.02, "reducer": "full"})
    model = assemble(scene)
    full = march(scene, model=model)
    return scene, model, {name: full.block(name).T for name in model.reducible()}


class Run:
    """A prepared step solver and its state after a few steps."""

    def __init__(self, elements: int, reducer: str) -> None:
        scene, self.model, snapshots = trained(elements)
        self.scene = scene.using({"reducer": REDUCERS[reducer]})
        self.solver = self.scene.reducer.prepare(ReducedProblem(
            self.model, self.scene.integrator, self.scene.time.step,
            Offline.from_snapshots(self.model, snapshots), np.random.default_rng(0)))
        state, self.memory = self.solver.start(consistent_state(self.model))
        self.state = self.scene.integrator.start(self.solver.layout, state)

    def step(self, count: int, solver: Any = None) -> Any:
        """x after so many steps of `solver` (its own when not given)."""
        solver = self.solver if solver is None else solver
        h, integrator = self.scene.time.step, self.scene.integrator
        for _ in range(count):
            formula = step_formula(integrator.rules(h), solver.layout, self.state, h)
            outcome, self.memory = solver.solve(formula, self.memory)
            assert outcome.status.ok, outcome
            self.state = advanced(integrator.rules(h), solver.layout, self.state, formula, outcome)
        return self.state.x


def arrays(thing: Any, path: str = "", seen: set[int] | None = None) -> Iterator[tuple[str, Any]]:
    """(where, array) of every array that can be reached from an object, closures included."""
    seen = set() if seen is None else seen
    if id(thing) in seen or isinstance(thing, str | bytes | int | float | PurePath | type):
        return
    seen.add(id(thing))
    if isinstance(thing, np.ndarray) or issparse(thing):
        yield path, thing
        if isinstance(thing, np.ndarray) and thing.base is not None:
            yield from arrays(thing.base, f"{path}.base", seen)
        return
    for name, part in parts(thing):
        if name not in OFFLINE:
            yield from arrays(part, f"{path}.{name}", seen)


def parts(thing: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(thing, Mapping):
        yield from ((str(k), v) for k, v in thing.items())
    elif isinstance(thing, list | tuple | set | frozenset):
        yield from ((str(i), v) for i, v in enumerate(thing))
    else:
        slots = [s for c in type(thing).__mro__ for s in getattr(c, "__slots__", ())]
        yield from ((s, getattr(thing, s)) for s in slots if hasattr(thing, s))
        yield from getattr(thing, "__dict__", {}).items()
        for cell in getattr(thing, "__closure__", None) or ():
            yield "closure", cell.cell_contents
        if hasattr(thing, "__self__"):
            yield "self", thing.__self__


def shapes(run: Run) -> list[tuple[str, tuple[int, ...]]]:
    """Of everything a step reads and everything it carries; keys of a support cache as one."""
    reached = {"solver": run.solver, "memory": run.memory, "state": run.state}
    return sorted((where if "prepared" not in where else "prepared", a.shape)
                  for where, a in arrays(reached))


@pytest.mark.full
@pytest.mark.parametrize("reducer", ["galerkin", "deim", "lspg", "gnat", "sparse"])
def test_arrays_of_a_step_do_not_grow_with_the_mesh(reducer: str) -> None:
    found = []
    for elements in (COARSE, FINE):
        run = Run(elements, reducer)
        run.step(3)
        found.append(shapes(run))
    assert found[0] == found[1]
    assert len(found[0]) > 40
    assert max(max(shape, default=0) for _, shape in found[0]) < 200


@pytest.mark.full
def test_arrays_of_a_step_that_selects_do_not_grow_with_the_mesh() -> None:
    """Which atoms are chosen may differ between meshes, how large an array can be may not."""
    largest = []
    for elements in (COARSE, FINE):
        run = Run(elements, "selecting")
        assert isinstance(run.solver, SparseStepper)
        run.step(3)
        found = shapes(run)
        assert len(found) > 40
        largest.append(max(max(shape, default=0) for _, shape in found))
        nodes = len(trained(elements)[1].geometry["link1.thermal"][0])
        assert largest[-1] < nodes / 2
    assert max(largest) < 300


@pytest.mark.full
def test_the_walk_sees_the_arrays_of_a_full_order_step() -> None:
    """The check of the check: the factors' right-hand sides are of the mesh's size."""
    scene, model, _ = trained(COARSE)
    solver = scene.reducer.prepare(ReducedProblem(
        model, scene.integrator, scene.time.step, Offline.from_snapshots(model, {}),
        np.random.default_rng(0)))
    assert max(max(a.shape) for _, a in arrays(solver) if a.ndim) >= 1467


POD = {"basis": {"use": "pod", "count": 12}}
NONLINEAR: dict[str, dict[str, Any]] = {
    "deim": {"use": "deim", **POD},
    "ecsw": {"use": "ecsw", "tau": 1e-6, **POD},
    "sparse": {"use": "sparse", **POD, "sampler": {"use": "deim", "required": False},
               "budgets": {"*": {"rows": 24, "atoms": 12}}},
}


@cache
def heated(cells: int) -> tuple[Scene, Model, Mapping[str, Any]]:
    """hot_plate with k(T), c(T) and radiation, 10 cells^2 triangles, and snapshots of 12 steps."""
    scene = load("hot_plate", {"bodies.plate.mesh.divisions": [5 * cells, cells],
                               "time.end": 12.0, "training": {"end": 12.0}, "reducer": "full"})
    model = assemble(scene)
    return scene, model, {"plate.thermal": march(scene, model=model).block("plate.thermal").T}


def largest_of(cells: int, options: Any) -> int:
    """Largest dimension of the arrays that a step of the heated plate reads and carries."""
    scene, model, snapshots = heated(cells)
    solver = march(scene.using({"reducer": options}), model=model, snapshots=snapshots).solver
    _, memory = solver.start(consistent_state(model))
    found = list(arrays({"solver": solver, "memory": memory}))
    assert len(found) > 40
    return max(max(a.shape, default=0) for _, a in found)


@pytest.mark.full
@pytest.mark.parametrize("reducer", NONLINEAR)
def test_arrays_of_a_nonlinear_step_do_not_grow_with_the_mesh(reducer: str) -> None:
    """Points of the sampled rows or of ECSW's elements. How many elements there are around a row,
    and how many ECSW keeps, differs between meshes; the mesh has four times as many. Heat is stored
    by six points an element, 6900 in the whole mesh."""
    coarse, fine = (largest_of(cells, NONLINEAR[reducer]) for cells in (12, 24))
    assert 100 < fine < 1.3 * coarse
    assert fine < 1500


@pytest.mark.full
def test_the_walk_sees_the_points_of_a_whole_nonlinear_mesh() -> None:
    assert largest_of(6, {"use": "galerkin", **POD}) >= 360


@pytest.mark.full
@pytest.mark.parametrize("reducer", REDUCERS)
def test_a_step_never_reads_the_full_operators(reducer: str) -> None:
    """They are taken away after `prepare`: the run goes on with the same numbers."""
    want = Run(320, reducer).step(4)
    run = Run(320, reducer)
    np.testing.assert_array_equal(run.step(4, rigid_copy(run.solver)), want)


def rigid_copy(solver: Any) -> Any:
    """The same solver without matrices, dictionaries and rows."""
    if isinstance(solver, SparseStepper):
        nothing: Any = None
        heat = {n: replace(h, model=nothing, body=bare_heat(h.body),
                           block=replace(h.block, dictionary=nothing))
                for n, h in solver.steps.heat.items()}
        elastic = {n: replace(e, block=replace(e.block, dictionary=nothing))
                   for n, e in solver.steps.elastic.items()}
        base, selection = rigid_copy(solver.base), solver.selection
        steps = replace(solver.steps, base=base, heat=heat, elastic=elastic)
        assert isinstance(selection, BlockwiseSelection)
        return replace(
            solver, base=base, steps=steps, selection=replace(selection, steps=steps))
    assert isinstance(solver, BlockwiseSolver)
    return replace(solver, dictionaries={}, rows={})


def bare_heat(body: Any) -> Any:
    return replace(body, capacity=None, conductivity=None, constant=None, loads=None)
