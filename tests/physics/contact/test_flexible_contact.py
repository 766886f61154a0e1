"""Contact on deformed surfaces inside the step: a slider pressed on a plate and pushed along."""

from typing import Any

import numpy as np
import pytest

from pressed_slider import BOTH, LOAD, SIDE, STEP, forces, full, scene, stored
from reduced_runs import decoded, errors, estimates, learnt
from sparsemor.core import StepFormula
from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.model import Model
from sparsemor.core.protocols.integrator import advanced, step_formula
from sparsemor.core.scene.scene import Scene
from sparsemor.core.status import SolveFailed, Status
from sparsemor.core.testing.in_memory_run import march
from sparsemor.reducers.full.monolithic import Summed
from sparsemor.reducers.step.monolithic_step import WholeStepper
from sparsemor.reducers.step.newton_loop import Linearisation

pytestmark = pytest.mark.full

# --------------------------------------------------------------------------- mechanics


def test_the_contact_carries_the_load_and_drags() -> None:
    run = full()
    assert isinstance(run.solver, WholeStepper)
    x, y, _ = forces(run)[run.model.layout["slider.rigid"]]
    assert abs(y - LOAD) < 2e-4 * LOAD
    # along the deformed surface, which is all but level
    assert abs(x + 0.2 * LOAD) < 2e-3 * LOAD
    assert abs(run.block("drive.multiplier")[-1, 0] - x) < 2e-3 * LOAD


def test_third_law_for_forces_moments_and_heat() -> None:
    run = full()
    f, layout = forces(run), run.model.layout
    on_slider = f[layout["slider.rigid"]]
    plate: Any = run.model.parts["plate"]
    nodal = np.zeros(2 * len(plate.X))
    nodal[plate.elasticity.free] = f[layout["plate.elastic"]]
    moved = np.zeros_like(nodal)
    moved[plate.elasticity.free] = run.end.x[layout["plate.elastic"]]
    x, y, angle = run.end.x[layout["slider.rigid"]]
    arm = plate.X @ [1, 1j] + moved.view(complex) - complex(x, y)
    moment = float((arm.conj() * nodal.view(complex)).imag.sum())
    size = LOAD * SIDE
    assert abs(nodal.view(complex).sum() + complex(on_slider[0], on_slider[1])) < 1e-12 * LOAD
    assert abs(moment + on_slider[2]) < 1e-12 * size
    # forces on the slider's nodes are those on its frame
    nodes = f[layout["slider.elastic"]]
    assert np.abs(nodes).max() > 0.01 * LOAD


def test_stiff_bodies_move_as_rigid_ones() -> None:
    """The difference is the bodies' own give, in proportion to 1 / E."""
    rigid = march(scene([], surfaces="rigid")).block("slider.rigid")[-1]
    off = []
    for stiffer in (100.0, 1000.0):
        pose = march(scene(["elastic"], stiffer=stiffer)).block("slider.rigid")[-1]
        off.append(abs(pose[2] / rigid[2] - 1.0))
    assert off[0] < 0.03 and 8.0 < off[0] / off[1] < 12.0, off
    soft = march(scene(["elastic"])).block("slider.rigid")[-1]
    assert abs(soft[2] / rigid[2]) > 1.3


# --------------------------------------------------------------------------- the iteration


def changes(model: Model, step: StepFormula, x: FloatArray, exact: bool, count: int) -> FloatArray:
    """Sizes of successive changes from x, relative to the largest displacement of the plate."""
    eq, factor, found = Summed.from_model(model, price=1), None, []
    c, d, at = (step.c1, step.c2, step.c1_first, step.c2_first), x - step.free, model.layout[
        "plate.elastic"]
    eq.begin(step, d)
    for _ in range(count):
        if exact or factor is None:
            factor = eq.factorize(eq.jacobian(Linearisation(*step.at(d), step.t, c)))
        dx = factor.solve(eq.residual(d))
        d = d - dx
        found.append(float(np.abs(dx[at]).max() / np.abs((step.free + d)[at]).max()))
    return np.array(found)


def test_exact_jacobians_converge_quadratically_and_a_kept_one_linearly() -> None:
    run = full()
    integrator = scene(BOTH).integrator
    state = integrator.start(run.model.layout, run.end)
    step = step_formula(integrator.rules(STEP), run.model.layout, state, STEP)
    x = 2 * run.x[-1] - run.x[-2]
    x[run.model.layout["plate.elastic"]] *= 1.005
    newton = changes(run.model, step, x, exact=True, count=3)
    chord = changes(run.model, step, x, exact=False, count=4)
    assert newton[1] < 0.1 * newton[0] ** 2 and newton[2] < 1e-11
    first, second = chord[2:] / chord[1:-1]
    assert first < 0.05 and 0.2 < first / second < 5.0
    assert chord[2] > 100 * newton[2]


def test_few_factors_serve_many_steps() -> None:
    run = full()
    solver: Any = run.solver
    state, memory = solver.start(run.end)
    integrator = scene(BOTH).integrator
    state = integrator.start(solver.layout, state)
    iterations = 0
    for _ in range(20):
        formula = step_formula(integrator.rules(STEP), solver.layout, state, STEP)
        outcome, memory = solver.solve(formula, memory)
        assert outcome.status.ok
        iterations += outcome.iterations
        state = advanced(integrator.rules(STEP), solver.layout, state, formula, outcome)
    assert solver.counters(memory)["factorizations"] <= 12 and iterations <= 160


# --------------------------------------------------------------------------- heat


def test_friction_heats_both_bodies_by_the_work_of_friction() -> None:
    run = full()
    gained = np.diff(stored(run.model, run.x))
    f, layout = forces(run), run.model.layout
    entering = [f[layout[f"{b}.thermal"]].sum() for b in ("slider", "plate")]
    assert abs(sum(entering) * STEP - gained[-1]) < 1e-9 * gained[-1]
    assert abs(entering[0] - entering[1]) < 1e-9 * entering[0]
    # slip is 1 m/s but for the deformation's own rates
    assert abs(sum(entering) - 0.2 * LOAD) < 0.02 * LOAD


@pytest.mark.parametrize("reducer", ["full", {"use": "galerkin", "basis": {
    "use": "pod", "count": 25}}], ids=["full", "galerkin"])
def test_heat_crosses_the_contact(reducer: Any) -> None:
    """A hot slider at rest on the plate: what it loses the plate has, in both paths."""
    still = {"pose": {"velocity": [0.0, 0.0]}, "initial_temperature": 50.0}
    hot = scene(BOTH, conductance=1e5, slider=still, steps=30)
    hot = hot.using({"joints.drive.x": 0.0, "contacts.sole.friction": None})
    reference = march(hot)
    run = reference if reducer == "full" else march(
        hot.using({"reducer": reducer}), model=reference.model, snapshots=learnt(reference))
    x = np.concatenate([decoded(run, b.name) for b in reference.model.layout], axis=1)
    heat = stored(reference.model, x)
    sliders = reference.model.separated.heat[0]
    lost = float((x[0] - x[-1])[reference.model.layout["slider.thermal"]]
                 @ sliders.capacity.sum(axis=0))
    assert sliders.name == "slider" and lost > 1e-3 * heat[0]
    assert np.abs(heat - heat[0]).max() < 1e-3 * lost
    assert np.abs(x[-1] - reference.x[-1])[reference.model.layout["plate.thermal"]].max() < (
        1e-5 * reference.block("plate.thermal").max())


# --------------------------------------------------------------------------- impact


def falling(speed: float, steps: int) -> Scene:
    """Dropped flat onto the middle of the plate from 0.3 of its height, nothing driving it."""
    start = {"pose": {"position": [SIDE, 0.3 * SIDE], "velocity": [0.0, -speed]}}
    return scene(["elastic"], slider=start, steps=steps).using({"joints": {}})


def test_an_impact_is_solved_and_comes_to_rest() -> None:
    """All facets meet the plate within one step; BDF1 damps what follows."""
    run = march(falling(10.0, 60))
    assert max(run.iterations) <= 20
    assert abs(forces(run)[run.model.layout["slider.rigid"]][1] - LOAD) < 1e-6 * LOAD
    assert np.abs(run.v[-1]).max() < 1e-5


def test_a_step_that_is_too_long_is_told() -> None:
    """1.1 mm a step, through the plate's surface: a status that names the contact."""
    with pytest.raises(SolveFailed, match="contact sole: a point of slider went") as raised:
        march(falling(300.0, 5))
    assert raised.value.status is Status.NOT_CONVERGED and raised.value.time < 2 * STEP


@np.errstate(all="ignore")
def test_errors_of_a_contact_in_the_step_are_estimated() -> None:
    reduced = scene(BOTH, reducer={"use": "galerkin", "basis": {"use": "pod", "count": 8}})
    run = march(reduced, model=full().model, snapshots=learnt(full()))
    found = estimates(reduced, run)
    for name in run.solver.dictionaries:
        assert 0.8 < found[name].max() / errors(full(), run, name).max() < 1.25, name
