"""Compiled steps give the states of the uncompiled step solver: the kernel as plain Python, so that
each part is compared without numba; tests/laws/step/test_machine_code.py runs it as machine
code."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest

from joint_runs import driven
from random_chains import chain, scene
from reduced_runs import learnt
from small_scenes import SCENES, everything, tiny
from sparsemor.core import InputError, ReducedProblem, ReducedTerm, State
from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.model.model import Model
from sparsemor.core.results.checkpoint import Saved
from sparsemor.core.scene.scene import Scene, load
from sparsemor.core.simulation.offline import Offline
from sparsemor.core.simulation.time_stepping import FixedStep, iterate, started
from sparsemor.core.testing.in_memory_run import march, scene_of
from sparsemor.reducers.step.blockwise_solver import BlockwiseSolver
from sparsemor.reducers.step.compiled.compile import linked
from sparsemor.reducers.step.compiled.compiled_stepper import compilable, wanted
from sparsemor.reducers.step.compiled.compiled_steps import CompiledSteps
from sparsemor.reducers.step.compiled.fill_arrays import plan
from sparsemor.reducers.step.compiled.time_functions import NotCompiled
from sparsemor.reducers.step.step_memory import Memory
from tiers import full
from turning_bars import bar, turning

GALERKIN = {"use": "galerkin", "basis": {"use": "pod", "count": 4}}
SPARSE = {"use": "sparse", "basis": {"use": "pod", "count": 4}, "budgets": {"*": {"rows": 20}}}
SELECTED = {**SPARSE, "budgets": {"*": {"rows": 20, "atoms": 3}}, "every": 6}


class Case(NamedTuple):
    """A reduced model with its start."""

    scene: Scene
    model: Model
    snapshots: Mapping[str, FloatArray]

    def solver(self, **options: Any) -> Any:
        s = self.scene.using({f"reducer.{name}": value for name, value in options.items()})
        return s.reducer.prepare(ReducedProblem(
            self.model, s.integrator, s.time.step, Offline.from_snapshots(
                self.model, self.snapshots),
            np.random.default_rng(3)))

    def start(self, solver: Any) -> tuple[State, Memory]:
        state, memory = started(solver, self.scene.integrator, consistent_state(self.model))
        assert isinstance(memory, Memory)
        return state, memory

    def step(self, solver: Any) -> FixedStep:
        return FixedStep.of(self.scene.integrator, solver, self.scene.time.step)


def trained(s: Scene, reducer: Any, end: float | None = None) -> Case:
    full = march(s.using({"reducer": "full", **({} if end is None else {"time.end": end})}))
    return Case(s.using({"reducer": reducer}), full.model, learnt(full))


def in_python(case: Case, solver: BlockwiseSolver) -> CompiledSteps:
    h = case.scene.time.step
    return CompiledSteps(solver, case.scene.integrator.rules(h), h, lambda functions: linked(
        functions, lambda function: function)["advance"])


def states(case: Case, solver: Any, count: int, many: Any = None) -> list[Any]:
    state, memory = case.start(solver)
    with np.errstate(all="ignore"):
        return list(iterate(case.step(solver), state, memory, count, many=many))


def differ(solver: Any, one: list[Any], other: list[Any]) -> dict[str, float]:
    """Largest difference of two runs relative to the largest value, in any block of coordinates,
    and in rates and joint forces."""
    x, y = (np.array([taken.state.x for taken in run]) for run in (one, other))
    a, b = (np.array([taken.state.v for taken in run]) for run in (one, other))
    found = {"unknowns": 0.0, "rates and forces": 0.0}
    forces = set(range(*solver.layout.algebraic.indices(solver.layout.size)))
    for block in solver.layout:
        at = solver.layout[block.name]
        kind = "rates and forces" if at.start in forces else "unknowns"
        for key, p, q in ((kind, x, y), ("rates and forces", a, b)):
            # displacements are as exact as the positions that they are computed with
            size = max(np.abs(p[:, at]).max(), 1e-3 if key == "unknowns" else 0.0)
            if size > 0.0:
                found[key] = max(
                    found[key], float(np.abs(p[:, at] - q[:, at]).max() / size))
    return found


def law(case: Case, count: int, blocks: int = 8) -> None:
    """Both take the same steps, at least `blocks` of them within blocks of several."""
    solver = case.solver()
    many = in_python(case, solver)
    plain, kernel = states(case, solver, count), states(case, solver, count, many)
    worst = differ(solver, plain, kernel)
    assert worst["unknowns"] < 1e-10 and worst["rates and forces"] < 2e-8, worst
    assert all(t.outcome.status.ok for t in kernel) and len(kernel) == len(plain) == count
    assert sum(not t.whole for t in kernel) >= blocks
    # where changes are round-off, the last one is the estimate
    assert all(0.0 <= t.outcome.remaining <= 1e-9 for t in kernel if not t.whole)


@cache
def heated() -> Case:
    return trained(tiny(), GALERKIN)


CHAINS = [full(3, False), full(4, None), (5, True)]


@pytest.mark.parametrize(("seed", "rigid"), CHAINS)
def test_the_kernel_takes_the_steps_of_the_solver(seed: int, rigid: bool | None) -> None:
    s = scene(chain(np.random.default_rng(seed), rigid=rigid))
    case = trained(s, "full" if rigid else GALERKIN)
    law(case, 30)


@pytest.mark.full
def test_on_a_fixed_support_of_sampled_rows() -> None:
    case = Case(heated().scene.using({"reducer": SPARSE}), heated().model, heated().snapshots)
    law(case, 20)


@pytest.mark.parametrize("ground", [True, False])
def test_a_flexible_bar_that_slides_on_another_body(ground: bool) -> None:
    angle, axis = -0.4, [float(np.cos(0.4)), -float(np.sin(0.4))]
    soft = {"use": "flexible", "thickness": 0.02, "fields": ["elastic"], "pose": {"angle": angle},
            "mesh": {"use": "rectangle", "size": [0.2, 0.1], "divisions": [4, 2]},
            "material": {"E": 5e7, "nu": 0.3, "rho": 1000}, "reference": {"clamp": "top"}}
    rail = {"use": "rigid", "mass": 3.0, "inertia": 0.1, "points": {"edge": [0.0, 0.0]},
            "pose": {"angle": angle}}
    hinge = {"use": "revolute", "between": ["ground", "rail:edge"]}
    other = {"bodies": {"soft": soft}, "joints": {}} if ground else {
        "bodies": {"soft": soft, "rail": rail}, "joints": {"hinge": hinge}}
    s = scene({"format": 1, "integrator": "bdf1", "time": {"end": 0.03, "step": 1e-3}, **other,
               "loads": {"weight": {"use": "gravity"}}, "joints": {**other["joints"], "guide": {
                   "use": "prismatic", "axis": axis,
                   "between": ["ground" if ground else "rail:edge", "soft:bottom"]}}})
    law(trained(s, GALERKIN), 20)


@pytest.mark.parametrize(("with_laws", "kernel"), [
    full(False, True), full(True, True), full(True, False)])
def test_the_partition_into_blocks_changes_no_bit(with_laws: bool, kernel: bool) -> None:
    case = hot("ecsw", False) if with_laws else heated()
    solver = case.solver()

    def many() -> CompiledSteps | None:
        return in_python(case, solver) if kernel else None

    whole = states(case, solver, 20, many())
    state, memory = case.start(solver)
    pieces: list[Any] = []
    evaluated: set[float] = set()
    for count in (1, 4, 6, 9):
        for taken in iterate(case.step(solver), state, memory, count, many=many()):
            pieces.append(taken)
            evaluated |= {at[-1] for at in memory.linearized.values()}
        state = pieces[-1].state
        memory = Saved.from_value(memory).into(case.start(solver)[1])  # a restart
    # a Jacobian of heat serves several steps
    assert 0 < len(evaluated) < 10 if with_laws else not evaluated
    for one, other in zip(whole, pieces, strict=True):
        assert np.array_equal(one.state.x, other.state.x)
        assert np.array_equal(one.state.v, other.state.v)
        assert np.array_equal(one.state.a, other.state.a)


@pytest.mark.full
def test_every_plane_joint_and_load() -> None:
    s = everything().using({
        "time.end": 20 * everything().time.step, "loads.air": {
            "use": "convection", "on": ["wall:top", "hot:top"], "film": 9, "temperature": 280},
        "loads.glow": {"use": "radiation", "on": ["wall:top", "hot:top"], "emissivity": 0.9,
                       "surroundings": 280}})
    # modes that do not satisfy the joints by themselves: those of a training run leave joint forces
    # of 1e13 that round-off determines
    modes = {**GALERKIN, "bases": {"*.elastic": {"use": "modal", "count": 6}}}
    law(trained(s, modes), 15, blocks=3)


@pytest.mark.full
def test_springs_motors_and_torques() -> None:
    law(trained(scene({"format": 1, **driven()}), GALERKIN), 20)


@pytest.mark.full
def test_models_that_are_not_covered_say_why() -> None:
    with pytest.raises(NotCompiled, match="full order"):
        plan(trained(tiny(), "full").solver())
    case = hot("galerkin", False)
    solver = case.solver()
    (name,) = solver.heat
    whole = replace(solver.heat[name], local=(Unknown(),))
    made = replace(solver, heat={name: whole})
    with pytest.raises(NotCompiled, match="not given as arrays"):
        plan(made)
    notes = [n.text for n in compilable(made, "on").notes]
    assert any("compiled: on has no effect" in text for text in notes), notes


class Unknown(ReducedTerm):
    """A term without arrays."""

    def residual(self, *at: Any) -> FloatArray:
        return np.zeros(4)

    jacobian = residual


STEEL = {"rho": 7850, "nu": 0.3, "E": {"temperatures": [250, 400, 1000],
                                       "values": [2.1e8, 1.9e8, 0.4e8]},
         "alpha": {"polynomial": [1.2e-5, 4e-9], "origin": 293.15, "range": [200, 1200]},
         "k": {"temperatures": [250, 1000], "values": [54, 27]},
         "c": {"polynomial": [440, 0.4], "origin": 293.15, "range": [200, 1200]}}


@cache
def hot(reducer: str, clamped: bool) -> Case:
    """A bar whose properties depend on temperature, with radiation and a film that does; clamped:
    at rest instead of swinging."""
    rest = {"joints.pin": None, "bodies.bar.frame": "fixed", "bodies.bar.reference": {
        "clamp": "left"}} if clamped else {}
    return trained(tiny().using({
        "bodies.bar.material": STEEL, "bodies.bar.initial_temperature": "400 + 100*x",
        "loads.glow": {"use": "radiation", "on": ["bar:right"], "emissivity": 0.8,
                       "surroundings": {"use": "sine", "amplitude": 20, "frequency": 9,
                                        "offset": 300}},
        "loads.air": {"use": "convection", "on": ["bar:top"], "temperature": 300.0,
                      "film": {"temperatures": [290, 900], "values": [500, 2500]}},
        "joints.bath": {"use": "prescribed_temperature", "on": ["bar:left"], "temperature": {
            "use": "sine", "amplitude": 30, "frequency": 10, "offset": 400}},
        "time.end": 0.05, **rest}), {**GALERKIN, "use": reducer})


@pytest.mark.full
@pytest.mark.parametrize("reducer", ["galerkin", "ecsw", "deim"])
@pytest.mark.parametrize("clamped", [False, True])
def test_terms_that_depend_on_the_unknowns(reducer: str, clamped: bool) -> None:
    case = hot(reducer, clamped)
    made = plan(case.solver())
    assert len(made.functions.laws) == 6 and len(made.heat[0].local[0].terms) == 4
    assert len(made.arrays.known) == len(made.arrays.iterated) == 1
    assert clamped == bool(made.arrays.prescribed) != bool(made.arrays.stacks)
    law(case, 30)


@pytest.mark.full
@pytest.mark.parametrize("frame", ["floating", pytest.param("fixed", marks=pytest.mark.full)])
def test_nonlinear_strains(frame: str) -> None:
    """A soft hot bar that hangs through by more than its height."""
    rest = {} if frame == "floating" else {"joints": {}, "bodies.bar.frame": "fixed"}
    case = trained(tiny().using({
        "bodies.bar.material.E": 5e6, "bodies.bar.strains": "nonlinear", "time.end": 0.03,
        "bodies.bar.reference": {"clamp": "left"}, **rest}),
        {"use": "galerkin", "basis": {"use": "pod", "count": 6}})
    made = plan(case.solver())
    (term,) = made.arrays.iterated
    assert len(term.local.terms) == len(made.functions.laws) == 1
    law(case, 20)


def test_frames_at_rest() -> None:
    law(trained(tiny().using({
        "joints": {}, "bodies.bar.frame": "fixed", "bodies.bar.reference": {"clamp": "left"},
        "time.end": 0.05}), GALERKIN), 30)


MODAL = {"use": "modal", "count": 5}
ORTHONORMAL = {"use": "dictionary", "orthonormal": True, "bases": [MODAL]}


@pytest.mark.parametrize(("E", "spin", "basis"), [
    (5e12, 60.0, MODAL), (5e5, 60.0, MODAL), (5e12, 60.0, ORTHONORMAL)])
def test_a_bar_in_space_whose_rotation_is_given(E: float, spin: float, basis: Any) -> None:
    s = bar(E, use="galerkin", basis=basis).using({"time.end": 0.03})
    case = Case(s, turning(s, spin, 4, steps=30), {})
    made = plan(case.solver())
    assert made.arrays.prescribed and not made.arrays.stacks
    law(case, 28)


PIECE = {"use": "rigid", "mass": 0.5, "inertia": [1e-3, 2e-3, 2.5e-3], "center": [0.1, 0.0, 0.01],
         "points": {"a": [0.0, 0.0, 0.0], "b": [0.2, 0.0, 0.0], "c": [0.1, 0.05, 0.0]}}


@pytest.mark.full
def test_rigid_bodies_in_space_on_springs_and_hinges() -> None:
    s = scene_of({
        "bodies": {"one": {**PIECE, "pose": {"spin": [0.0, 0.0, 2.0]}},
                   "two": {**PIECE, "pose": {"position": [0.2, 0.0, 0.0]}}},
        "joints": {
            "ball": {"use": "spherical", "between": ["ground", "one:a"]},
            "hinge": {"use": "revolute", "between": ["one:b", "two:a"], "axis": [0, 1, 1]},
            "motor": {"use": "rotational_spring", "between": ["one:b", "two:a"], "stiffness": 2.0,
                      "damping": 0.02, "axis": [0, 1, 1],
                      "torque": {"use": "sine", "amplitude": 0.1, "frequency": 9}},
            "rope": {"use": "spring_damper", "between": ["one:c", "two:c"], "stiffness": 300.0,
                     "damping": 1.0}},
        "loads": {"weight": {"use": "gravity", "g": [0.0, -3.0, -9.81]}},
        "integrator": {"use": "generalized_alpha", "rho_inf": 0.5},
        "time": {"end": 0.02, "step": 1e-3}})
    law(Case(s, assemble(s), {}), 4, blocks=2)


@pytest.mark.full
def test_flexible_and_spinning_bodies_in_space() -> None:
    s = load(SCENES / "everything_in_space.yaml", {
        "time": {"end": 2.4e-3, "step": 2e-4}, "training.end": 2.4e-3, "integrator": "bdf2",
        "bodies.handle": {**PIECE, "pose": {"position": [0.0, 1.0, 0.0]}},
        "joints.turned": {"use": "prescribed_motion", "of": "handle:b", "x": 0.2,
                          "axis": [0, 1, 1], "angle": {
                              "use": "sine", "amplitude": 0.2, "frequency": 4}},
        "joints.rope": {"use": "spring_damper", "between": ["bar:right", "wheel:middle"],
                        "stiffness": 300.0, "damping": 1.0}})
    law(trained(s, GALERKIN), 9, blocks=2)


def test_auto_is_for_long_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    from sparsemor.reducers.step.compiled import compiled_stepper

    def yes() -> bool:
        return True

    def no() -> bool:
        return False

    assert wanted("on", 1, no) and not wanted("off", 10**9, yes)
    assert wanted("auto", 10**5, no) and not wanted("auto", 5000, no)
    assert wanted("auto", 5000, yes) and not wanted("auto", 100, yes)
    monkeypatch.setattr(compiled_stepper, "installed", no)
    assert not wanted("auto", 10**9, yes)


def test_without_numba_on_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sparsemor.core.registry.installed.find_spec", lambda name: None)
    with pytest.raises(InputError, match="sparsemor\\[fast\\]"):
        heated().solver(compiled="on")
    selected = Case(heated().scene.using({"reducer": SELECTED}), heated().model, heated().snapshots)
    with pytest.raises(InputError, match="sparsemor\\[fast\\]"):
        selected.solver(compiled="on")


def test_a_step_that_converges_slowly_is_left_to_the_solver() -> None:
    # changes of the second iteration are round-off at 1e-6 s
    s = tiny().using({"time.step": 1e-6, "time.end": 3e-5, "training.end": 3e-5})
    case = trained(s, GALERKIN)
    solver = case.solver()
    plain, kernel = (states(case, solver, 25, m) for m in (None, in_python(case, solver)))
    worst = differ(solver, plain, kernel)
    assert all(t.outcome.status.ok for t in kernel) and worst["unknowns"] < 1e-10, worst


def test_a_selection_of_atoms_is_not_compiled() -> None:
    pytest.importorskip("numba")
    case = Case(heated().scene.using({"reducer": SELECTED}), heated().model, heated().snapshots)
    notes = [n.text for n in case.solver(compiled="on").notes]
    assert "compiled: on has no effect: atoms are selected during the run" in notes
