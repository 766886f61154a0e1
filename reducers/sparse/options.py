"""Options of the sparse reducer."""

from typing import Annotated, Literal

from pydantic import Field, field_validator

from sparsemor.core import Basis, Plugin, Preconditioner, Sampler, Slot, SparseSolver, slot_default
from sparsemor.core.model.block_patterns import matched_option
from sparsemor.reducers.step_options import ReducedStepOptions

Residual = Literal["auto", "plain", "preconditioned"]


class Budget(Plugin):
    """Budget of one block: number of sampled rows, and largest number of active atoms in a step."""

    rows: int | None = Field(default=None, ge=0)
    """Number of sampled rows, in addition to the required ones (those of joints and localized
    loads); by default twice the number of atoms in the dictionary, or all rows if there are
    fewer."""
    atoms: int | None = Field(default=None, ge=1)
    """Largest number of active atoms; by default all atoms of the dictionary."""


class SparseOptions(ReducedStepOptions):
    """Options of the sparse reducer."""

    budgets: dict[str, Budget] = {}
    """Numbers of rows and atoms by block pattern, such as `*.elastic`. A block that matches no
    pattern uses all atoms of its dictionary and twice as many rows, in addition to the required
    ones."""
    basis: Annotated[Basis, Slot("basis")] = slot_default("pod")
    """Basis of every elastic and thermal block; one that it does not fit takes `pod`, with a
    note."""
    bases: dict[str, Annotated[Basis, Slot("basis")]] = {}
    """Other bases by block pattern, such as `*.thermal`."""
    sampler: Annotated[Sampler, Slot("sampler")] = slot_default("lhs")
    """Method that chooses the sampled rows. Where it has its default value, `deim` chooses plain
    rows that `residual: auto` keeps."""
    preconditioner: Annotated[Preconditioner, Slot("preconditioner")] = slot_default("none")
    """Preconditioner of the sampled rows, in the blocks listed in `preconditioned` (Sec. 3.2 of the
    paper). One that is undefined for more rows than atoms is applied to rows compressed by QR."""
    preconditioned: tuple[str, ...] = ("*.thermal",)
    """Blocks whose sampled rows are preconditioned, by pattern; `elastic` is short for `*.elastic`.
    By default the thermal ones, as published."""
    residual: Residual | dict[str, Residual] = "auto"
    """Residual whose rows are sampled, in all blocks or by block pattern. `preconditioned`: D^-1 r,
    the error that r causes, with the operator D of a step; its least-squares solution is close to
    Galerkin's, and a step costs the same. `plain`: the residual r, as published. `auto`:
    preconditioned in each block whose operators are constant, plain where a row of D^-1 r would
    read all elements of local terms (radiation, material tables, contact) in each step, and where
    rows are drawn anew during the run."""
    resample: int | None = Field(default=None, ge=1)
    """Number of steps after which new rows are drawn (the paper: 1); left out: one draw for the
    run."""
    row_sets: int | None = Field(default=None, ge=2)
    """Number of row sets that are drawn and prepared in advance and used in turn; left out: every
    draw is new."""
    solver: Annotated[SparseSolver, Slot("sparse_solver")] = slot_default("greedy_gauss_newton")
    """Sparse solver that selects atoms where a budget is smaller than the dictionary."""
    every: int = Field(default=1, ge=1)
    """Number of steps between selections of atoms."""
    selection: Literal["blocks", "joint"] = "blocks"
    """Problems in which atoms are selected. `blocks`: in each block on its own, at the solution of
    the step on the previous support, with rigid coordinates, joint forces and temperatures held;
    `joint`, as published: all elastic blocks together with rigid coordinates and joint forces in
    one nonlinear problem (Eq. 25), which is exact and many times slower."""
    hysteresis: float = Field(default=0.3, ge=0.0, lt=1.0)
    """Fraction by which another support must lower the norm of the residual to replace the previous
    one. Each exchange is a jump in velocities that takes some steps to decay. 0: any better support
    does. Applies where a selection starts from the step's solution on the previous support
    (`carried` and `polish`)."""
    settled: float = Field(default=0.0, ge=0.0, lt=1.0)
    """Norm of the residual, relative to that of the coefficients, up to which a support is kept and
    no other is sought; at least round-off. With `residual: preconditioned` it is a relative error
    of the sampled displacements or temperatures. Applies to `selection: blocks`."""
    carried: bool | dict[str, bool] = True
    """Warm start: each selection starts from the support of the previous step, otherwise from the
    empty support. By block pattern with `polish: false`, as the paper leaves the start open."""
    polish: bool = True
    """Re-solve each step on the selected support, with the equations of rigid coordinates and
    multipliers satisfied exactly. False, as published: the solution of the sparse solver is used,
    in which these equations are part of the least squares; needs `selection: joint` in every step,
    and no radiation."""
    @field_validator("preconditioned")
    @classmethod
    def _by_pattern(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(name if "." in name or "*" in name else f"*.{name}" for name in names)

    def residual_of(self, name: str) -> Residual:
        """Option `residual` of a block; `auto` for a block that matches no pattern."""
        table = {"*": self.residual} if isinstance(self.residual, str) else self.residual
        return matched_option(name, table, "auto")

    def carries(self, name: str) -> bool:
        """True if the selection in a block starts from the support of the previous step."""
        if isinstance(self.carried, bool):
            return self.carried
        return matched_option(name, self.carried, True)
