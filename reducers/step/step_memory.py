"""State between steps of a step solver (step memory)."""

from dataclasses import dataclass, field, replace
from typing import Any, Self

from sparsemor.core import BoolArray, FloatArray, StepMemory
from sparsemor.reducers.step.newton_loop import KeptJacobian, StepEquations
from sparsemor.reducers.step.predictor import Predictor
from sparsemor.reducers.step.thermal_block import HeatJacobian


@dataclass(eq=False, kw_only=True)
class RunMemory(StepMemory):
    """State between steps common to all step solvers: past states with their departures from the
    free motion (predictor.py), counters, and `supports`, block -> mask (k,) of its active atoms.

    It is stored as plain data (core/results/checkpoint.py) without working arrays and whatever can
    be recomputed: `__getstate__` leaves these out.
    """

    past: Predictor
    factorizations: int = 0
    support_changes: int = 0
    supports: dict[str, BoolArray] = field(default_factory=dict)

    def copy(self) -> Self:
        """Independent copy of the state."""
        return replace(self, past=self.past.copy(), supports=dict(self.supports))

    @property
    def restarts(self) -> bool:
        """True: `moved` can begin a step at any state, as adaptive time stepping requires."""
        return True

    def moved(self, x: FloatArray) -> None:
        """Continues from the state x, after steps of another size by another step solver."""
        self.past.moved(x)

    def rows_changed(self, fresh: bool) -> None:
        """Another set of sampled rows is in use from the next step on; fresh: True if the previous
        set is never used again. Does nothing here."""

    @property
    def newest(self) -> FloatArray:
        """The last state (n,)."""
        return self.past.newest


class Workspace:
    """Working arrays of the steps of one run, which contain no state of it: equations of the
    mechanics, and the kept Jacobians of thermal blocks, `heat`, which can be computed again. Each
    thread needs its own."""

    __slots__ = ("equations", "heat", "source")

    def __init__(self) -> None:
        self.source: StepEquations | None = None
        self.equations: Any = None
        self.heat: dict[str, HeatJacobian] = {}

    def of(self, source: StepEquations) -> Any:
        """These equations with working arrays, which are made where those of others, as of another
        step size, are in use."""
        if self.source is not source:
            self.source, self.equations = source, source.working()
        return self.equations


@dataclass(eq=False, kw_only=True)
class Memory(RunMemory):
    """State between steps of the block-wise solver: adds working arrays
    (`Workspace`) and the kept Jacobian of the mechanical iteration, and counts of the steps that it
    did not solve.

    linearised_on (n,): active unknowns of the kept Jacobian where atoms are selected; exact: what
    the iteration with the exact Jacobian keeps; full_newton_steps: number of steps that it solved;
    full_newton_steps_left: number of coming steps that begin with it; heat_kept: what the iteration
    of each group of full-order thermal blocks keeps; linear: block -> iterations of its linear
    solver; linearized: reduced thermal block -> [T, T', T'', t] at which its kept Jacobian was
    evaluated (`HeatJacobian`).
    """

    work: Workspace = field(default_factory=Workspace)
    kept: KeptJacobian = field(default_factory=lambda: KeptJacobian.empty(0))
    linearised_on: BoolArray | None = None
    exact: KeptJacobian = field(default_factory=lambda: KeptJacobian.empty(0))
    heat_kept: dict[str, KeptJacobian] = field(default_factory=dict)
    full_newton_steps: int = 0
    full_newton_steps_left: int = 0
    linear: dict[str, int] = field(default_factory=dict)
    linearized: dict[str, FloatArray] = field(default_factory=dict)

    def __getstate__(self) -> dict[str, object]:
        return {name: value for name, value in vars(self).items() if name != "work"}

    def copy(self) -> Self:
        return replace(super().copy(), work=Workspace(),
                       kept=self.kept.copy(), exact=self.exact.copy(),
                       heat_kept={n: k.copy() for n, k in self.heat_kept.items()},
                       linear=dict(self.linear), linearized=dict(self.linearized))

    def moved(self, x: FloatArray) -> None:
        super().moved(x)
        self.linearized.clear()

    def jacobian(self, block: str) -> HeatJacobian | None:
        """The kept Jacobian of a thermal block, without factors where these are to be computed;
        None where it has none."""
        at, known = self.linearized.get(block), self.work.heat.get(block)
        if at is None:
            return None
        return known if known is not None and known.at is at else HeatJacobian(at)

    def keep(self, block: str, jacobian: HeatJacobian | None) -> None:
        """Keeps a Jacobian of a thermal block for the next step, or none."""
        self.work.heat.pop(block, None)
        self.linearized.pop(block, None)
        if jacobian is not None:
            self.work.heat[block], self.linearized[block] = jacobian, jacobian.at

    def add_linear_iterations(self, block: str, iterations: int) -> None:
        """Adds iterations of a block's linear solver to the count."""
        self.linear[block] = self.linear.get(block, 0) + iterations
