"""Eigenmodes of one body's field: vibration modes of displacements, decaying shapes of
temperatures; with a fixed interface and constraint modes (Craig and Bampton 1968, doi
10.2514/3.4741). Lowest eigenmodes of K x = lambda M x, free or under the constraint P^T x = 0."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from pydantic import Field
from scipy import linalg
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from sparsemor.core import Basis, BlockData, Csr, Dictionary, FloatArray, InputError
from sparsemor.core.linalg.dense import oriented_unit_columns
from sparsemor.plugins.bases.load_patterns import load_names
from sparsemor.plugins.bases.orthogonalise import independent
from sparsemor.plugins.bases.static_response import StaticSolver, factorize, is_thermal

_DENSE = 150
"""Number of unknowns up to which the dense solver is faster than Lanczos."""
FIXED = "modal with interface: fixed"
REST = 1e-7
"""Remainder of a static response outside the span of the modes, relative in the norm of M, up to
which it is not added."""


@dataclass(frozen=True, slots=True, eq=False)
class Eigenmodes:
    """Eigenvalues (k,), increasing (rad^2/s^2 for displacements, 1/s for temperatures), and
    eigenvectors `shapes` (n, k) with shapes^T M shapes = I."""

    values: FloatArray
    shapes: FloatArray


def lowest_modes(data: BlockData, count: int, held: FloatArray | None = None) -> Eigenmodes:
    """Lowest eigenmodes, at most `count`; with independent columns P (n, p) in `held`, under P^T x
    = 0.

    Shift-invert Lanczos with a small negative shift, so that the singular K of an insulated body is
    no special case. With P, the inverse of A = K - shift M is that of the bordered matrix: A^-1
    less its part along A^-1 P. It is symmetric and its range satisfies P^T x = 0, so all Lanczos
    vectors do.
    """
    n, K, M = data.size, data.stiffness, data.mass
    p = 0 if held is None else held.shape[1]
    count = min(count, n - p)
    if count == 0:
        return Eigenmodes(np.zeros(0), np.zeros((n, 0)))
    if n <= _DENSE or 3 * count >= n:
        return _dense(K, M, count, held)
    # about the lowest rate of conduction; far below what would spoil the lowest vibrations
    shift = -1e-2 * float(K.diagonal().sum() / M.diagonal().sum()) / n
    factor = factorize(K - shift * M, data)
    inverse = LinearOperator((n, n), matvec=_held_inverse(factor, held), dtype=np.float64)
    start = np.random.default_rng([n, count]).standard_normal(n)  # fixed: the same modes each time
    if held is not None:
        start = inverse @ (M @ start)
    try:
        values, shapes = eigsh(K, count, M, sigma=shift, OPinv=inverse, v0=start, tol=0.0)
    except ArpackNoConvergence as error:
        raise InputError(
            f"{len(error.eigenvalues)} of {count} eigenmodes of {data.name} converged: ask for "
            "fewer modes") from None
    order = np.argsort(values)
    return Eigenmodes(values[order], shapes[:, order])


def _held_inverse(
    factor: Any, held: FloatArray | None
) -> Callable[[FloatArray], FloatArray]:
    """Function b -> x of A x + P y = b, P^T x = 0, with the factors of A (n, n) and columns P (n,
    p) in `held`: x = A^-1 b - A^-1 P (P^T A^-1 P)^-1 P^T A^-1 b. Without P, x = A^-1 b."""
    if held is None:
        return lambda b: np.asarray(factor.solve(np.ravel(b)))
    reached = factor.solve(np.ascontiguousarray(held))
    compliance = linalg.cho_factor(held.T @ reached)

    def solve(b: FloatArray) -> FloatArray:
        b = np.ravel(b)
        x = factor.solve(b)
        return np.asarray(x - reached @ linalg.cho_solve(compliance, held.T @ x))

    return solve


def _dense(K: Csr, M: Csr, count: int, held: FloatArray | None) -> Eigenmodes:
    if held is None:
        values, shapes = linalg.eigh(K.toarray(), M.toarray(), subset_by_index=(0, count - 1))
        return Eigenmodes(values, shapes)
    Z = linalg.null_space(held.T)
    values, c = linalg.eigh(Z.T @ (K @ Z), Z.T @ (M @ Z), subset_by_index=(0, count - 1))
    return Eigenmodes(values, Z @ c)


class Modal(Basis):
    """Modal basis: the lowest eigenmodes of (K, M), or of (K_T, C) for heat, of unit length.

    No training run is needed. Modes alone converge slowly for surface heat and joint forces:
    `correction` adds the part of the static responses outside their span.
    """

    count: int = Field(default=20, ge=1)
    """Number of modes, the lowest ones; all when the block has fewer."""
    interface: Literal["free", "fixed"] = "free"
    """Motion of the points that joints constrain (the mean displacement of a rim, for a joint that
    acts on one): `free` in the modes, or `fixed`."""
    correction: bool = False
    """Add the static response to every load, less its projection on the modes (residual attachment
    modes): then responses to constant loads are exact. For an insulated body, the temperature shape
    that constant heat tends to is added."""
    start: bool = True
    """Add the initial values where the modes do not represent them."""

    @property
    def needs_snapshots(self) -> bool:
        return False

    def most_atoms(self, size: int) -> int | None:
        """Upper bound on the number of atoms for `size` unknowns; None: no bound is known."""
        return None if self.correction or self.start else min(self.count, size)

    def unfit(self, data: BlockData) -> str:
        """Reason why a block cannot have these modes (a fixed interface without a joint); "" if it
        can."""
        return "" if self.interface == "free" or len(data.joints) else (
            no_interface(data, FIXED))

    def build(self, data: BlockData) -> Dictionary:
        """Dictionary with atoms (n, k): modes, then static responses and initial values less their
        projection on the modes (`_extra`). Raises InputError for a fixed interface where no joint
        acts."""
        held = joint_columns(data, FIXED) if (
            self.interface == "fixed") else None
        modes = lowest_modes(data, self.count, held)
        kind = "fixed mode" if self.interface == "fixed" else "mode"
        atoms = [modes.shapes]
        names = [f"{kind} {i}" for i in range(len(modes.values))]
        info: dict[str, float | int | str] = {"modes": len(names), **mode_info(data, modes)}
        extra, extra_names = self._extra(data)
        if extra_names:
            rest, kept = _beyond(extra, modes.shapes, data)
            atoms.append(rest)
            names += [extra_names[i] for i in kept]
            info["corrections"] = len(kept)
        return Dictionary(
            oriented_unit_columns(np.concatenate(atoms, axis=1)), np.zeros(data.size), tuple(names),
            info)

    def _extra(self, data: BlockData) -> tuple[FloatArray, list[str]]:
        columns, names = [np.zeros((data.size, 0))], []
        if self.start and data.start.any():
            columns.append(data.start[:, None])
            names.append("start")
        if self.correction and data.loads.shape[1]:
            columns.append(StaticSolver.from_data(data)(data.loads))
            names += [f"residual {load}" for load in load_names(data)]
        return np.concatenate(columns, axis=1), names


def mode_info(data: BlockData, modes: Eigenmodes) -> dict[str, float | int | str]:
    """Reported values of the modes: frequencies, Hz, of displacements; decay rates, 1/s, of
    temperatures."""
    if not len(modes.values):
        return {}
    positive = np.maximum(modes.values, 0.0)
    name, shown = ("decay_per_s", positive) if is_thermal(data) else (
        "frequencies_hz", np.sqrt(positive) / (2.0 * np.pi))
    return {name: ", ".join(f"{v:.6g}" for v in shown), f"lowest_{name}": float(shown[0]),
            f"highest_{name}": float(shown[-1])}


def no_interface(data: BlockData, who: str) -> str:
    """Message that no joint acts on a block, so that it has no interface; who: the basis that needs
    one."""
    return (f"{who}: no joint acts on the unknowns of {data.name}, so it has no interface; give "
            "this block another basis under reducer.bases, such as modal")


def joint_columns(data: BlockData, who: str) -> FloatArray:
    """Independent unit columns P (n, p) of the joint forces: P^T u displaces the joints' points.

    Raises InputError when no joint acts on the block.
    """
    P = data.loads[:, data.joints]
    if not P.shape[1]:
        raise InputError(no_interface(data, who))
    P = P / np.linalg.norm(P, axis=0)
    return np.asarray(P[:, independent(P, 1e-10)[0]])


def _beyond(
    X: FloatArray, shapes: FloatArray, data: BlockData
) -> tuple[FloatArray, list[int]]:
    """M-orthonormal remainders of the columns of X (n, j) after projection on the M-orthonormal
    `shapes` (n, k) and on the remainders before, and the indices of the columns whose remainder is
    significant."""
    basis, kept, rest = shapes, [], []
    for i, x in enumerate(X.T):
        size = float(np.sqrt(x @ (data.mass @ x)))
        r = x
        for _ in range(2):  # once leaves what cancellation brings back
            r = r - basis @ (basis.T @ (data.mass @ r))
        left = float(np.sqrt(r @ (data.mass @ r)))
        if left > REST * size and basis.shape[1] < data.size:
            basis = np.column_stack([basis, r / left])
            kept.append(i)
            rest.append(r / left)
    return np.stack(rest, axis=1) if rest else np.zeros((data.size, 0)), kept


class CraigBampton(Basis):
    """Craig-Bampton basis: fixed-interface modes and static constraint modes of the joints' points.

    A joint constrains the mean displacement s = P^T u of a set of points, such as a rim, not each
    of them. The constraint modes of that interface minimise u.K u for s = 1 of one of its
    components, so they are K^-1 P (P^T K^-1 P)^-1: the span of the responses K^-1 P to the joint
    forces, which are the atoms here. The fixed-interface modes satisfy s = 0 and are K-orthogonal
    to them: with all modes the dictionary spans all displacements, with none it is static
    condensation to s. No training run is needed.
    """

    count: int = Field(default=20, ge=0)
    """Number of fixed-interface modes, the lowest ones."""

    @property
    def needs_snapshots(self) -> bool:
        return False

    def unfit(self, data: BlockData) -> str:
        """Reason why a block cannot have these modes (no joint acts on it); "" if it can."""
        return "" if len(data.joints) else no_interface(data, "craig_bampton")

    def build(self, data: BlockData) -> Dictionary:
        """Dictionary with atoms (n, k). Raises InputError for a block on which no joint acts."""
        modes = lowest_modes(data, self.count, joint_columns(data, "craig_bampton"))
        names = [f"fixed mode {i}" for i in range(len(modes.values))]
        pulled = oriented_unit_columns(StaticSolver.from_data(data)(data.loads[:, data.joints]))
        own, _ = independent(pulled, 1e-10)
        names += [f"constraint {load_names(data)[data.joints[i]]}" for i in own]
        atoms = np.concatenate([modes.shapes, pulled[:, own]], axis=1)
        return Dictionary(oriented_unit_columns(atoms), np.zeros(data.size), tuple(names), {
            "modes": len(modes.values), "constraint_modes": len(own), **mode_info(data, modes)})
