"""Options of the sparse reducer."""

from typing import Annotated, Literal

from pydantic import Field, field_validator

from sparsemor.core import Basis, Plugin, Preconditioner, Sampler, Slot, SparseSolver, slot_default
from sparsemor.core.model.block_patterns import matched_option
from sparsemor.reducers.reducer_notes import is_default
from sparsemor.reducers.reducer_options import ReducedStepOptions

Residual = Literal["auto", "plain", "preconditioned"]


class Budget(Plugin):
    """Budget of one block: number of sampled rows, and largest number of active atoms in a step."""

    rows: int | None = Field(default=None, ge=0)
    """Number of sampled rows, in addition to the required ones (those of joints and localized
    loads). By default all rows of D^-1 r, compressed to as many as atoms without loss; where a
    sampler or preconditioner is named, or rows of r are taken, the smallest of 2, 4, 8 and 16 times
    the number of atoms whose error is at most 2.2 times that of all rows, in the root mean
    square."""
    atoms: int | None = Field(default=None, ge=1)
    """Largest number of active atoms; by default all atoms of the dictionary."""


class SparseOptions(ReducedStepOptions):
    """Options of the sparse reducer."""

    budgets: dict[str, Budget] = {}
    """Numbers of rows and atoms by block pattern, such as `*.elastic`. A block that matches no
    pattern uses all atoms of its dictionary."""
    basis: Annotated[Basis, Slot("basis")] = slot_default("pod")
    """Basis of every elastic and thermal block; one that it does not fit takes `pod`, with a
    note."""
    bases: dict[str, Annotated[Basis, Slot("basis")]] = {}
    """Other bases by block pattern, such as `*.thermal`."""
    sampler: Annotated[Sampler, Slot("sampler")] = slot_default("lhs")
    """Method that chooses the sampled rows. Where it has its default value, all rows of D^-1 r are
    taken unless their number is set, and `deim` chooses plain rows that `residual: auto` keeps."""
    preconditioner: Annotated[Preconditioner, Slot("preconditioner")] = slot_default("none")
    """Preconditioner of the sampled rows, in the blocks listed in `preconditioned` (Sec. 3.2 of the
    paper). One that is undefined for more rows than atoms is applied to rows compressed by QR."""
    preconditioned: tuple[str, ...] = ("*.thermal",)
    """Blocks whose sampled rows are preconditioned, by pattern; `elastic` is short for `*.elastic`.
    By default the thermal ones, as published."""
    residual: Residual | dict[str, Residual] = "auto"
    """Residual whose rows are sampled, in all blocks or by block pattern. `preconditioned`: D^-1 r,
    the error that r causes, with the constant operator D of a step; its least-squares solution is
    close to Galerkin's, and a step costs the same. Local terms in r (radiation, material tables,
    nonlinear strains) are sums over few elements with weights that are learned from the training
    run (`tau`). `plain`: the residual r, as published. `auto`: preconditioned, but plain where
    local terms have no element weights (contact, or no training run) and where rows are drawn anew
    during the run."""
    tau: float = Field(default=1e-6, ge=1e-8, lt=1.0)
    """Relative error, at the training states, of the weighted sums of local terms, measured by the
    displacements or temperatures that they cause in a step."""
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
    hysteresis: float | None = Field(default=None, ge=0.0, lt=1.0)
    """Fraction by which another support must lower the norm of the residual to replace the previous
    one. Each exchange is a jump in velocities that takes some steps to decay. 0: any better support
    does. By default 0 where atoms are selected from rows of D^-1 r alone, whose residual is an
    error, otherwise 0.3. Applies where a selection starts from the step's solution on the
    previous support (`carried` and `polish`)."""
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

    def samples(self, name: str) -> bool:
        """True if the rows of a block are sampled even where they are those of D^-1 r."""
        weighed = matched_option(name, dict.fromkeys(self.preconditioned, True), False)
        return (self.resample is not None
                or matched_option(name, self.budgets, Budget()).rows is not None
                or not is_default(self, "sampler")
                or weighed and not is_default(self, "preconditioner"))

    def least_gain(self, plain: bool) -> float:
        """The option `hysteresis`, or its default; plain: True if atoms are selected from rows
        of r."""
        return (0.3 if plain else 0.0) if self.hysteresis is None else self.hysteresis

    def carries(self, name: str) -> bool:
        """True if the selection in a block starts from the support of the previous step."""
        if isinstance(self.carried, bool):
            return self.carried
        return matched_option(name, self.carried, True)
