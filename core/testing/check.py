"""Law kit of a check (notes on runs)."""

import json

import numpy as np

from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.checks import Check, Checks
from sparsemor.core.simulation.simulate import simulate
from sparsemor.core.simulation.stages_before_steps import prepared_run
from sparsemor.core.simulation.step_control import step_of
from sparsemor.core.simulation.time_stepping import iterate, started
from sparsemor.core.testing.random_inputs import law


def check_check(check: Check, scene: Scene) -> None:
    """Laws of a check: in a run of a small scene its hooks return what they must, it changes no
    state, and what it adds to the summary can be stored."""
    result = simulate(scene)
    run, _ = prepared_run(scene, Cache(), new_manager())
    checks = Checks([type(check)])
    checks.of_model(scene, run.model)
    checks.before_steps(run)
    state, memory = started(run.solver, scene.integrator, run.start)
    step = step_of(run.solver, scene.integrator, scene.time.step)
    # functions that the check wants called after each step; True: of a run that keeps its model
    looks = checks.on_start(run, state, True)
    before = state
    for n, taken in enumerate(iterate(step, state, memory, run.steps), 1):
        x = taken.state.x.copy()
        for look in looks:
            look(n, before, taken.state, run.solver.supports(taken.memory))
        law(np.array_equal(x, taken.state.x), "the check wrote to the state")
        before = taken.state
    json.dumps(dict(checks.after_run(run, result).summary), allow_nan=False)
