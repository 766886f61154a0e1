"""Controllers in a run: each sets its function of time, at the beginning of a step and for the
whole step (zero-order hold), from sensors at the last accepted state."""

from collections.abc import Mapping, Sequence
from typing import Any

from sparsemor.core.errors import Fault
from sparsemor.core.model.model import Model
from sparsemor.core.protocols.basis import Dictionary
from sparsemor.core.protocols.integrator import State
from sparsemor.core.protocols.layout import Layout
from sparsemor.core.protocols.time_function import Controller, HeldValues
from sparsemor.core.registry.registry import suggestions
from sparsemor.core.registry.returned_values import controller_step
from sparsemor.core.results.probes import ForceReader, ProbeReader
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.sensors_and_outputs import StepperOutput, outputs_of, read
from sparsemor.core.simulation.time_stepping import Step

Memory = dict[str, tuple[float, ...]]
"""Key of a controller in the scene -> what it remembers from step to step."""


def controllers_of(scene: Scene) -> dict[str, Controller]:
    """Controllers of a scene by their keys, such as `loads.motor.factor`."""
    return {k: f for k, f in scene.functions_of_time.items() if isinstance(f, Controller)}


class Controllers:
    """Controllers of a run of a step solver. found: key in the scene -> controller; outputs: name
    -> quantity that they may read; held: present values of their functions; h: time step, s."""

    def __init__(
        self, scene: Scene, outputs: Mapping[str, StepperOutput], without: Sequence[str] = ()
    ) -> None:
        """without: keys of functions that something else sets."""
        # those that give targets to others first
        self.found = {k: f for k, f in reversed(controllers_of(scene).items())
                      if k not in without}
        self.outputs = outputs
        self.held, self.h = HeldValues(), scene.time.step

    def begin(self) -> Memory:
        """What they remember before the first step."""
        return {key: tuple(f.begin()) for key, f in self.found.items()}

    def around(self, step: Step, memory: Memory) -> Step:
        """The step with values that are computed before it. memory: key -> what the controller
        remembers, which each step changes."""
        def controlled(state: State, inner: Any) -> tuple[Any, State, Any]:
            for key, f in self.found.items():
                sensed = read([self.outputs[n] for n in f.sensors], state)
                value, memory[key] = controller_step(
                    f, f.update(state.t, self.h, sensed, memory[key]), len(memory[key]), state.t,
                    key)
                self.held.values[f.identity] = value
            return step(state, inner)

        return controlled if self.found else step


def sensors(
    model: Model, layout: Layout, maps: Mapping[str, Dictionary]
) -> Mapping[str, StepperOutput]:
    """What controllers may read of a step solver's unknowns, by name. maps: those of its blocks."""
    return outputs_of(
        layout, model.multiplier_components,
        [ProbeReader.at_place(p, layout, maps) for p in model.probes],
        [ForceReader.from_force(n, j.force, layout) for n, j in model.joints.items() if j.force])


def controller_faults(scene: Scene, model: Model) -> list[Fault]:
    """Faults of controllers: sensors that do not exist, and what needs a run whose loads are known
    before it."""
    found, known = controllers_of(scene), sensors(model, model.layout, {})
    faults = [Fault(f"{key}.{f.sensor_key(name)}",
                    f"no sensor is called {name!r}: {suggestions(name, known, 'sensors')}")
              for key, f in found.items() for name in f.sensors if name not in known]
    if not found:
        return faults
    why = f"{next(iter(found))} is a controller, whose values are not known before the run"
    if scene.rigid_stage is not None:
        faults.append(Fault("rigid_stage", f"{why}: run the scene in one stage"))
    if scene.reducer.chooses:
        faults.append(Fault("reducer", f"{why}, so trial runs cannot choose: name a reducer"))
    if scene.time.control is not None:
        faults.append(Fault("time.control", f"{why} and jump at each step: take a fixed step"))
    limit = scene.reducer.error_limit
    if limit.every or limit.at_few_steps == "on":
        faults.append(Fault("reducer.error_estimate", f"{why}: it estimates no errors of them"))
    return faults

