"""Step solver whose steps can be compiled."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import partial
from importlib.util import find_spec
from typing import Any, Literal, TypeAlias

from sparsemor.core import (
    Note,
    StepSolver,
    UpdateRules,
    information,
    require,
)
from sparsemor.core.protocols.step_solver import MachineRequest, MachineSteps, ManySteps
from sparsemor.reducers.step.blockwise_solver import BlockwiseSolver
from sparsemor.reducers.step.step_memory import Memory

Compiled: TypeAlias = Literal["auto", "on", "off"]
AUTO, KEPT = 50_000, 2_000
"""Smallest number of steps of a run, or of all runs of a kept model in this process, for which
`auto` compiles, and takes machine code that an earlier run has kept: compilation and loading take
as long as about as many uncompiled steps."""


@dataclass(frozen=True, slots=True, eq=False)
class CompiledStepper(BlockwiseSolver):
    """Block-wise step solver that takes several steps at once as machine code, unless `compiled` is
    "off" or its model is not covered (fill_arrays.py).

    checked: True for the model of a file. Its numbers are those of others, and machine code that
    checks no index would read and write anywhere for wrong ones: such steps check all.
    """

    compiled: Compiled = "off"
    checked: bool = False

    def many(self, rules: UpdateRules, h: float, steps: int) -> "ManySteps[Memory] | None":
        """Compiled steps of size h, s, for runs of `steps` steps in all."""
        if not wanted(self.compiled, steps, self._has_code):
            return None
        from sparsemor.reducers.step.compiled.compile import compiled_advance
        from sparsemor.reducers.step.compiled.compiled_steps import CompiledSteps
        from sparsemor.reducers.step.compiled.time_functions import NotCompiled

        try:
            return CompiledSteps(self, rules, h, partial(compiled_advance, checked=self.checked))
        except NotCompiled:
            return None

    def _has_code(self) -> bool:
        """True if an earlier run has kept machine code for its steps."""
        from sparsemor.reducers.step.compiled.compile import has_code
        from sparsemor.reducers.step.compiled.fill_arrays import plan
        from sparsemor.reducers.step.compiled.time_functions import NotCompiled

        try:
            return has_code(plan(self).functions, self.checked)
        except NotCompiled:
            return False

    def machine_steps(self, of: MachineRequest[Memory]) -> MachineSteps:
        from sparsemor.reducers.step.compiled.object_file import machine_steps

        return machine_steps(self, of)

    def stepping_alike(self, copy: StepSolver) -> StepSolver:
        return _with(copy, copy.notes, self.compiled, self.checked) if isinstance(
            copy, BlockwiseSolver) else copy

    def without_mesh(self) -> BlockwiseSolver:
        made = BlockwiseSolver.without_mesh(self)
        return _with(made, made.notes, self.compiled, self.checked)

    def parts(self) -> tuple[Any, ...]:
        return (*(getattr(self, f.name) for f in fields(BlockwiseSolver)), self.compiled)

    @classmethod
    def of_parts(cls, *parts: Any) -> "CompiledStepper":
        return replace(cls(*parts), checked=True)


def compilable(made: BlockwiseSolver, option: Compiled) -> BlockwiseSolver:
    """The step solver with compiled steps as the option says; a note where they are wanted and the
    model is not covered. Raises InputError where numba is wanted and not installed."""
    reason = ""
    if option == "on":
        from sparsemor.reducers.step.compiled.fill_arrays import plan
        from sparsemor.reducers.step.compiled.time_functions import NotCompiled

        try:
            plan(made)
        except NotCompiled as error:
            reason = str(error)
    return _with(made, (*made.notes, *no_effect_of(option, reason)), option)


def wanted(option: Compiled, steps: int, kept: Callable[[], bool]) -> bool:
    """True if steps are to be compiled, for runs of so many in all; kept: whether there is machine
    code of an earlier run."""
    return expected(option, steps) and (option == "on" or steps >= AUTO or kept())


def expected(option: Compiled, steps: int) -> bool:
    """True if steps may be compiled, whatever machine code is kept."""
    if option != "auto":
        return option == "on" and installed()  # not where a file says so
    return installed() and steps >= KEPT


def installed() -> bool:
    """True if numba can be imported."""
    return find_spec("numba") is not None


def _with(
    solver: BlockwiseSolver, notes: tuple[Note, ...], option: Compiled, checked: bool = False
) -> CompiledStepper:
    parts: dict[str, Any] = {f.name: getattr(solver, f.name) for f in fields(BlockwiseSolver)}
    return CompiledStepper(**{**parts, "notes": notes}, compiled=option, checked=checked)


def no_effect_of(option: Compiled, reason: str) -> tuple[Note, ...]:
    """A note where compiled steps are wanted and there are none for this reason, "" for no reason.
    Raises InputError where numba is wanted and not installed."""
    if option == "on":
        require("numba", "fast", "compiled: on")
    return (information(f"compiled: on has no effect: {reason}", "compiled"),) if (
        option == "on" and reason) else ()
