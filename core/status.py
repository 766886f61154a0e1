"""How a solve ended: a value that carries its own advice, never an exception in an inner loop."""

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
    INTERRUPTED = "interrupted"

    @property
    def ok(self) -> bool:
        return self is Status.DONE

    @property
    def advice(self) -> str:
        """What to try, for a model whose rows are sampled."""
        return self.advice_for(sampled=True)

    def advice_for(self, sampled: bool) -> str:
        """What to try. sampled: whether rows were drawn by a sampler; without rows, nothing is
        said of them."""
        return _ADVICE[self] + (_OF_ROWS.get(self, "") if sampled else "")


_ADVICE = {
    Status.DONE: "",
    Status.NOT_CONVERGED: (
        "the iteration did not contract: take a smaller time.step or a more damped integrator, "
        "and check that the loads are continuous in time"
    ),
    Status.SINGULAR: (
        "the equations have no unique solution: look for a body that nothing holds, redundant "
        "joints, or a missing reference condition"
    ),
    Status.RANK_DEFICIENT: (
        "the active atoms cannot be told apart: take fewer atoms, or a basis without "
        "near-duplicates"
    ),
    Status.INFEASIBLE: (
        "no coefficients satisfy the rows within the tolerance of the sparse solver: raise "
        "reducer.solver.tolerance, take more atoms, or a solver that fits by least squares"
    ),
    Status.DIVERGED: (
        "the solution grew far beyond the training run: take more atoms, a training run that "
        "covers the whole run, or a smaller time.step"
    ),
    Status.NOT_FINITE: (
        "a value overflowed: take a smaller time.step or a more damped integrator"
    ),
    Status.STEP_TOO_LONG: (
        "the shortest substep is still too long: raise time.control.tolerance or max_halvings, "
        "let loads begin smoothly, or raise time.control.elastic above vibrations that do not "
        "matter"
    ),
    Status.INTERRUPTED: "continue it with --resume",
}
_OF_ROWS = {
    Status.NOT_CONVERGED: "; keep the required rows or take more",
    Status.SINGULAR: "; or more sampled rows",
    Status.RANK_DEFICIENT: "; or take more rows, or another sampler",
    Status.DIVERGED: "; keep the required rows, take more, or try another seed or sampler",
    Status.NOT_FINITE: "; keep the required rows or take more",
}


class SolveFailed(RuntimeError):
    """A run stopped before its end.

    Only the time loop raises it. `status` says how, `time` (s) when, `block` where
    (`body.field`, or "" for the whole system), and `detail` what was seen. sampled: whether the
    model's rows were drawn by a sampler, so that the advice is on rows too.
    """

    result: object = None
    """The `RunResult` of what was computed, where there is one."""

    def __init__(
        self, status: Status, time: float, block: str = "", detail: str = "", *,
        sampled: bool = False,
    ) -> None:
        self.status, self.time, self.block, self.detail = status, time, block, detail
        where = f" in {block}" if block else ""
        what = f" ({detail})" if detail else ""
        super().__init__(f"{status.value} at t = {time:.6g} s{where}{what}: "
                         f"{status.advice_for(sampled)}")
