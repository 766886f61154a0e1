"""Status of a solve or run, with advice: a return value, not an exception, in inner loops."""

from enum import Enum


class Status(Enum):
    """Outcome of one solve or one run; `advice` says what to try when it is not `DONE`."""

    DONE = "done"
    NOT_CONVERGED = "not_converged"
    SINGULAR = "singular"
    RANK_DEFICIENT = "rank_deficient"
    INFEASIBLE = "infeasible"
    DIVERGED = "diverged"
    NOT_FINITE = "not_finite"
    STEP_TOO_LONG = "step_too_long"
    INACCURATE = "inaccurate"
    OUTSIDE_THEORY = "outside_theory"
    PLUGIN_FAILED = "plugin_failed"
    INTERRUPTED = "interrupted"

    @property
    def ok(self) -> bool:
        """True for a solve that succeeded or a run that reached its end."""
        return self is Status.DONE

    @property
    def advice(self) -> str:
        """Advice to the user for a reduced model whose rows (equations) are sampled."""
        return self.advice_for(sampled=True)

    def advice_for(self, sampled: bool) -> str:
        """Advice to the user. sampled: True if the rows (equations) of the model were drawn by a
        sampler."""
        return _ADVICE[self] + (_OF_ROWS.get(self, "") if sampled else "")


_ADVICE = {
    Status.DONE: "",
    Status.NOT_CONVERGED: (
        "Newton did not converge. Try a smaller time.step or an integrator with more numerical "
        "damping, and check that the loads are continuous in time"
    ),
    Status.SINGULAR: (
        "the equations have no unique solution: check for unconstrained bodies (rigid-body "
        "modes), joints that contradict each other, or a missing reference condition"
    ),
    Status.RANK_DEFICIENT: (
        "the active atoms are linearly dependent: take fewer atoms, or a basis without "
        "near-duplicates"
    ),
    Status.INFEASIBLE: (
        "no coefficients satisfy the equations within the tolerance of the sparse solver: raise "
        "reducer.solver.tolerance, take more atoms, or a solver that fits by least squares"
    ),
    Status.DIVERGED: (
        "the solution grew far beyond the training run: use more atoms, a training run that "
        "covers the whole run, or a smaller time.step"
    ),
    Status.NOT_FINITE: (
        "a value overflowed: try a smaller time.step or an integrator with more numerical damping"
    ),
    Status.STEP_TOO_LONG: (
        "the error of the shortest substep is above the tolerance: raise time.control.tolerance "
        "or max_halvings, use loads that begin smoothly, or raise the size that time.control gives "
        "to a field above the amplitude of vibrations that do not matter"
    ),
    Status.INACCURATE: (
        "train on a run that covers this one, take more atoms or another basis; or continue it "
        "with --resume and another reducer.error_estimate: a larger tolerance, or action: "
        "fall_back"
    ),
    Status.OUTSIDE_THEORY: (
        "take strains: nonlinear for this body, or smaller loads; check_strains: warn accepts it"
    ),
    Status.PLUGIN_FAILED: "what the run has computed before is kept; use another plugin",
    Status.INTERRUPTED: "continue it with --resume",
}
_OF_ROWS = {
    Status.NOT_CONVERGED: "; keep the required rows, sample more rows, or take a reducer that "
                          "tests all rows",
    Status.SINGULAR: "; or sample more rows",
    Status.RANK_DEFICIENT: "; or sample more rows, or use another sampler",
    Status.DIVERGED: "; keep the required rows, sample more rows, try another seed or sampler, "
                     "or a reducer that tests all rows",
    Status.NOT_FINITE: "; keep the required rows, sample more rows, or take a reducer that "
                       "tests all rows",
}


class SolveFailed(RuntimeError):
    """Failure of a run before its end, raised by the time loop only.

    `status`, `time` (s), `block` (`body.field`, or "" for the whole system) and `detail` of the
    failure. sampled: True if the model's rows were drawn by a sampler: the advice mentions them.
    phase: "run", or "training run" or "rigid stage" for a run that comes before it. advice: in the
    place of that of the status, where the cause is known.
    """

    result: object = None
    """Result (`RunResult`) up to the failure, if there is one."""

    def __init__(
        self, status: Status, time: float, block: str = "", detail: str = "", *,
        sampled: bool = False, phase: str = "run", advice: str = "",
    ) -> None:
        self.phase = phase
        self.status, self.time, self.block, self.detail = status, time, block, detail
        where = f" in {block}" if block else ""
        what = f" ({detail})" if detail else ""
        super().__init__(f"{status.value} at t = {time:.6g} s{where}{what}: "
                         f"{advice or status.advice_for(sampled)}")

    def _render_traceback_(self) -> list[str]:
        """What notebooks show: the message, without the traceback."""
        return [f"{type(self).__name__}: {self}"]
