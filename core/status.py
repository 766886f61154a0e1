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
        return _ADVICE[self]


_ADVICE = {
    Status.DONE: "",
    Status.NOT_CONVERGED: (
        "the iteration did not contract: take a smaller time.step or a more damped integrator, "
        "check that the loads are continuous in time, and if rows are sampled keep the required "
        "ones or take more"
    ),
    Status.SINGULAR: (
        "the equations have no unique solution: look for a body that nothing holds, redundant "
        "joints, a missing reference condition, or too few sampled rows"
    ),
    Status.RANK_DEFICIENT: (
        "the sampled rows cannot tell the active atoms apart: take more rows, fewer atoms, or "
        "another sampler"
    ),
    Status.INFEASIBLE: (
        "no coefficients satisfy the rows within the tolerance of the sparse solver: raise "
        "reducer.solver.tolerance, take more atoms, or a solver that fits by least squares"
    ),
    Status.DIVERGED: (
        "the solution grew far beyond the training run: keep the required rows, take more rows, "
        "try another seed or sampler, or a smaller time.step"
    ),
    Status.NOT_FINITE: (
        "a value overflowed: take a smaller time.step or a more damped integrator, and if rows are "
        "sampled keep the required ones or take more"
    ),
    Status.STEP_TOO_LONG: (
        "the shortest substep is still too long: raise time.control.tolerance or max_halvings, "
        "let loads begin smoothly, or raise time.control.elastic above vibrations that do not "
        "matter"
    ),
    Status.INTERRUPTED: "continue it with --resume",
}


class SolveFailed(RuntimeError):
    """A run stopped before its end.

    Only the time loop raises it. `status` says how, `time` (s) when, `block` where
    (`body.field`, or "" for the whole system), and `detail` what was seen.
    """

    result: object = None
    """The `RunResult` of what was computed, where there is one."""

    def __init__(self, status: Status, time: float, block: str = "", detail: str = "") -> None:
        self.status, self.time, self.block, self.detail = status, time, block, detail
        where = f" in {block}" if block else ""
        what = f" ({detail})" if detail else ""
        super().__init__(f"{status.value} at t = {time:.6g} s{where}{what}: {status.advice}")
