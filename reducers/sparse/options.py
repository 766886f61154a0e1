"""Options of the sparse reducer."""

from typing import Annotated, Literal

from pydantic import Field, field_validator

from sparsemor.core import (
    Basis,
    Plugin,
    Preconditioner,
    Sampler,
    Slot,
    SparseSolver,
    matched_option,
    slot_default,
)
from sparsemor.reducers.step.acceptance import Tolerances

Residual = Literal["plain", "preconditioned"]


class Budget(Plugin):
    """Budget of one block: rows and atoms that a step may use."""

    rows: int | None = Field(default=None, ge=0)
    """Sampled rows, on top of the required ones; twice the atoms of the dictionary, or as many as
    there are, when not given."""
    atoms: int | None = Field(default=None, ge=1)
    """Most atoms active at once; all of the dictionary when not given."""


class SparseOptions(Plugin):
    """Options of the sparse reducer."""

    budgets: dict[str, Budget] = {}
    """Rows and atoms by block pattern, such as `*.elastic`. A block that no pattern names takes all
    atoms of its dictionary and twice as many rows, in addition to the required ones."""
    basis: Annotated[Basis, Slot("basis")] = slot_default("pod")
    """Basis of every elastic and thermal block."""
    bases: dict[str, Annotated[Basis, Slot("basis")]] = {}
    """Other bases by block pattern, such as `*.thermal`."""
    sampler: Annotated[Sampler, Slot("sampler")] = slot_default("lhs")
    """Chooses the rows."""
    preconditioner: Annotated[Preconditioner, Slot("preconditioner")] = slot_default("none")
    """Of the sampled rows of the blocks that `preconditioned` names (Sec. 3.2)."""
    preconditioned: tuple[str, ...] = ("*.thermal",)
    """Blocks whose rows are preconditioned, by pattern; `elastic` is short for `*.elastic`. As
    published only the thermal ones."""
    residual: Residual | dict[str, Residual] = "plain"
    """Which rows are sampled, in all blocks or by block pattern: `plain` those of the residual r as
    published; `preconditioned` those of D^-1 r, the error that r causes, with the operator D of a
    step. Their least-squares solution is close to Galerkin's; a step costs the same."""
    resample: int | None = Field(default=None, ge=1)
    """Steps after which other rows are drawn (the paper: 1); left out: one draw for the run."""
    row_sets: int | None = Field(default=None, ge=2)
    """Number of row sets that are drawn and prepared in advance and used in turn; left out: every
    draw is new."""
    solver: Annotated[SparseSolver, Slot("sparse_solver")] = slot_default("greedy_gauss_newton")
    """Selects atoms where a budget is smaller than the dictionary."""
    every: int = Field(default=1, ge=1)
    """Steps between selections."""
    carried: bool = True
    """Warm start: each selection starts from the support of the previous step, else from none."""
    polish: bool = True
    """Re-solve each step on the selected support, with the rigid and multiplier rows as exact
    equations. False, as published: the solution of the sparse solver is used, in which those rows
    are part of the least squares; needs a selection in every step, and no radiation."""
    screen: bool = True
    """Screening: skip the sparse solver where an inexpensive test shows that it would keep the
    support; the result is the same. Needs `polish` and `carried`."""
    predictor: int = Field(default=6, ge=1, le=8)
    """Number of past states that the first guess of a step extrapolates."""
    remaining: float = Field(default=1e-13, gt=0, lt=1e-3)
    """Relative error of the unknowns that may remain in a step."""
    max_iterations: int = Field(default=30, ge=1)
    """Newton iterations before a step is given up."""

    @field_validator("preconditioned")
    @classmethod
    def _by_pattern(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(name if "." in name or "*" in name else f"*.{name}" for name in names)

    def preconditions(self, name: str) -> bool:
        """True if the rows of a block are those of D^-1 r."""
        table = {"*": self.residual} if isinstance(self.residual, str) else self.residual
        return matched_option(name, table, "plain") == "preconditioned"

    @property
    def tolerances(self) -> Tolerances:
        return Tolerances(self.remaining, self.max_iterations)
