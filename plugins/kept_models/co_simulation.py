"""A reduced model that is stepped from outside: inputs are set and outputs read between steps."""

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from itertools import accumulate
from typing import Any

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.errors import Fault, InputError
from sparsemor.core.linalg.threads import threads
from sparsemor.core.protocols.integrator import State, next_time
from sparsemor.core.protocols.layout import Layout
from sparsemor.core.protocols.step_solver import (
    LinearSystem,
    MachineRequest,
    MachineSteps,
    StepMemory,
)
from sparsemor.core.protocols.time_function import HeldFunction, holding
from sparsemor.core.registry.boundary import naming_plugins
from sparsemor.core.registry.registry import suggestions
from sparsemor.core.results.checkpoint import Saved, SavedError
from sparsemor.core.simulation.checks import Checks
from sparsemor.core.simulation.controllers import Controllers
from sparsemor.core.simulation.prepared_run import PreparedRun
from sparsemor.core.simulation.sensors_and_outputs import StepperOutput, outputs_of, read
from sparsemor.core.simulation.step_control import step_of
from sparsemor.core.simulation.time_stepping import iterate, many_steps, started
from sparsemor.core.status import SolveFailed, Status


@dataclass(frozen=True, slots=True, eq=False)
class Input(HeldFunction):
    """Input of a stepper in the place of a function of time; start: its value at the beginning."""

    start: float


class ModelStepper:
    """Steps of a reduced model, one after the other, from its start.

    t: time, s; inputs: key of a function of time in the scene -> its present value; outputs:
    name -> unit. An input has its value in a whole step and at the step's end: set the value of
    t + h, then step. model: the `ReducedModel` that made it. A pickled stepper goes on.
    """

    @np.errstate(all="ignore")
    def __init__(
        self, model: Any, run: PreparedRun, inputs: Mapping[str, Input], outputs: Sequence[str],
    ) -> None:
        """run: prepared with the inputs in the place of functions of time; outputs: names, all if
        empty. Raises InputError for outputs that the model does not have.

        _values: input -> its present value; _many: solver of several steps in one call, or None;
        _begin: state and step memory at the start; _controlled: controller -> what it remembers;
        _step: one step, before which controllers set their values.
        """
        from threadpoolctl import ThreadpoolController

        self._model, self._run, self._threads = model, run, ThreadpoolController()
        self.step_size = run.scene.time.step
        """Size h of a step, s."""
        self._inputs, self._values = dict(inputs), dict[str, float]()
        step = step_of(run.solver, run.scene.integrator, self.step_size)
        self._many = many_steps(run.solver, run.scene.integrator, self.step_size, run.steps)
        self._begin = started(run.solver, run.scene.integrator, run.start)
        known = outputs_of(run.solver.layout, run.header.multipliers, run.probes, run.forces)
        faults = [Fault("outputs", f"no output is called {n!r}: {suggestions(n, known, 'outputs')}")
                  for n in outputs if n not in known]
        if faults:
            raise InputError(faults)
        self._outputs = {n: known[n] for n in outputs or known}
        self._controllers = Controllers(run.scene, known, tuple(inputs))
        self._controlled = self._controllers.begin()
        self._step = self._controllers.around(step, self._controlled)
        self.reset()

    def __repr__(self) -> str:
        return (f"<Stepper {self._run.scene.name}, t = {self.t:g} s, {len(self._inputs)} inputs, "
                f"{len(self._outputs)} outputs>")

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (self._model, tuple(self._inputs), tuple(self._outputs), self.saved())

    @property
    def t(self) -> float:
        return self._state.t

    @property
    def inputs(self) -> Mapping[str, float]:
        return dict(self._values)

    @property
    def outputs(self) -> Mapping[str, str]:
        return {name: output.unit for name, output in self._outputs.items()}

    @property
    def described(self) -> Mapping[str, StepperOutput]:
        """Name -> where its outputs come from."""
        return dict(self._outputs)

    def machine_steps(
        self, about: IntArray, numbers: FloatArray, weights: FloatArray
    ) -> MachineSteps:
        """Its steps from the start as machine code. about (o, 8), numbers (o, 10), weights (w,):
        its outputs, as in `MachineRequest`. Raises InputError where there is none."""
        if self._controllers.found:
            raise InputError("controllers have no machine code: name them as inputs", "inputs")
        (state, memory), scene, run = self._begin, self._run.scene, self._run
        # ends of all steps, s
        times = np.array([*accumulate([self.step_size] * run.steps, next_time, initial=0.0)][1:])
        return run.solver.machine_steps(MachineRequest(
            scene.integrator, self.step_size, state, memory, tuple(self._inputs.values()), times,
            about, numbers, weights))

    @property
    def layout(self) -> Layout:
        """Unknowns of the step solver."""
        return self._run.solver.layout

    @property
    def start(self) -> State:
        """State at the beginning, in the unknowns of the step solver."""
        return self._begin[0]

    def linear_system(self) -> LinearSystem:
        """Its equations as constant matrices; `force` has the values that inputs have when it is
        called. Raises InputError where they are not linear."""
        system = self._run.solver.linear_system()

        def force(t: float) -> FloatArray:
            with self._holding():
                return system.force(t)

        return replace(system, force=force)

    def reset(self) -> None:
        """Goes back to the start; inputs have their first values again."""
        state, memory = self._begin
        self._state, self._memory, self._done = state, memory.copy(), 0
        self._values = {key: f.start for key, f in self._inputs.items()}
        self._controlled.update(self._controllers.begin())
        self._look()

    def set(self, key: str, value: float) -> None:
        """Value of an input in the next steps. Raises InputError for no input and no number."""
        if key not in self._inputs:
            raise InputError(f"no input is called {key!r}: "
                             f"{suggestions(key, self._inputs, 'inputs')}", "inputs")
        try:
            number = float(value)
        except (TypeError, ValueError):
            raise InputError(f"an input is a number (got {value!r})", key) from None
        if not np.isfinite(number):
            raise InputError(f"an input must be finite (got {value})", key)
        self._values[key] = number

    @naming_plugins()
    @np.errstate(all="ignore")
    def step(self, count: int = 1) -> float:
        """Takes `count` steps and returns the time after them, s. Raises InputError unless `count`
        is a whole number, 0 or more, and SolveFailed for a step that fails, with the state before
        it, or that a check (`_on_step`) refuses, with the state after it."""
        if not (isinstance(count, int | np.integer) and count >= 0):
            raise InputError(f"a whole number of steps, 0 or more (got {count!r})", "count")
        run, solver = self._run, self._run.solver
        if run.header.stage is not None and self._done + count > run.steps:
            raise InputError(f"the model follows a rigid motion that ends at "
                             f"{run.scene.time.end:g} s", "time.end")
        many = None if self._controllers.found else self._many
        with self._threads.limit(limits=threads(), user_api="blas"), self._holding():
            for taken in iterate(self._step, self._state, self._memory, count, many=many):
                if not taken.outcome.status.ok:
                    raise SolveFailed(taken.outcome.status, self.t + self.step_size,
                                      taken.outcome.block, taken.outcome.detail,
                                      sampled=bool(solver.rows))
                if large := run.extents.exceeded(run.extents.sizes(taken.state.x[None])[0]):
                    raise SolveFailed(Status.DIVERGED, taken.state.t, large.block, large.detail)
                before, self._state, self._memory = self._state, taken.state, taken.memory
                self._done += 1
                for look in self._on_step:
                    failure = look(self._done, before, self._state, solver.supports(self._memory))
                    if failure is not None:
                        raise failure
        return self.t

    def get(self, name: str) -> float:
        """Present value of one output."""
        return float(self.values((name,))[0])

    def values(self, names: Sequence[str] = ()) -> FloatArray:
        """Present values of the named outputs, or of all. Raises InputError for another name."""
        for name in names:
            if name not in self._outputs:
                raise InputError(f"no output is called {name!r}: "
                                 f"{suggestions(name, self._outputs, 'outputs')}", "outputs")
        with self._holding():
            return read([self._outputs[n] for n in names or self._outputs], self._state)

    def saved(self) -> bytes:
        """Present state with the values of the inputs, for `restore`."""
        s = self._state
        return Saved.from_value(self._kept(s, self._memory), "stepper").dump()

    def restore(self, saved: bytes) -> None:
        """Goes on from a state that `saved` of a stepper of this model gave. Raises InputError for
        other data."""
        state, memory = self._begin
        try:
            found = Saved.load(saved).into(self._kept(state, memory.copy()), "stepper")
        except SavedError as error:
            raise InputError(f"this is no state of this model ({error})", "state") from None
        # in the order of `_kept`; past: history of the integrator
        t, x, v, a, past, self._memory, self._done, values, controlled = found
        self._state = State(t, x, v, a, past)
        self._controlled.update(controlled)
        for key, value in values.items():
            self.set(key, value)
        self._look()

    def _kept(self, s: State, memory: StepMemory) -> tuple[Any, ...]:
        """Data of a saved stepper: state, memory, number of steps, inputs and controllers."""
        return (s.t, s.x, s.v, s.a, s.memory, memory, self._done, dict(self.inputs),
                dict(self._controlled))

    def _holding(self) -> AbstractContextManager[None]:
        """Context in which functions of time have the values of inputs and controllers."""
        held = self._controllers.held
        held.values |= {f.identity: self._values[key] for key, f in self._inputs.items()}
        return holding(held)

    def _look(self) -> None:
        """Lets checks watch the steps from the present state on."""
        self._on_step = Checks.for_scene(self._run.scene).on_start(self._run, self._state, False)


def _restored(
    model: Any, inputs: Sequence[str], outputs: Sequence[str], saved: bytes
) -> ModelStepper:
    made: ModelStepper = model.stepper(inputs, outputs)
    made.restore(saved)
    return made
