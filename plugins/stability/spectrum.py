"""Eigenvalues of a linearised time-step map, the excess growth that the reduction adds, and the
eigenvalue errors of the blocks of a reduced model.

Each block alone: free vibration of an elastic block in a fixed frame, K phi = w^2 M phi, and
thermal decay, K phi = s C phi. The eigenvalues of a Galerkin-projected symmetric pencil are real
and not below the exact ones; under sampled rows they may lie anywhere in the complex plane.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.model.model import Model
from sparsemor.core.protocols.layout import Quantity
from sparsemor.plugins.bases.modal import lowest_modes
from sparsemor.plugins.stability.step_map import StepMap

ComplexArray = NDArray[np.complex128]


def eigenvalues(matrix: FloatArray) -> ComplexArray:
    """Eigenvalues (N,) of a time-step map, largest modulus first.

    The map is block triangular (heat does not depend on the motion, some entries of z carry no
    state), so each strongly connected part is solved separately: this is cheaper, and the other
    parts do not perturb a simple eigenvalue 1 of an insulated body.
    """
    found = np.concatenate([np.zeros(0, complex)] + [
        np.linalg.eigvals(matrix[np.ix_(part, part)]) for part in parts_of(matrix)])
    return np.asarray(found[np.argsort(-np.abs(found))])


def parts_of(matrix: FloatArray) -> Iterator[IntArray]:
    """Row numbers of each strongly connected component of the matrix's graph: the diagonal blocks
    of its block-triangular form."""
    count, label = connected_components(csr_array(matrix != 0.0), connection="strong")
    order = np.argsort(label, kind="stable")
    edges = np.searchsorted(label[order], np.arange(count + 1))
    for i, j in zip(edges, edges[1:], strict=False):
        yield order[i:j]


def radius(matrix: FloatArray) -> float:
    """Spectral radius of a matrix."""
    return float(np.abs(eigenvalues(matrix)).max(initial=0.0))


def excess(values: ComplexArray, reference: ComplexArray | None) -> tuple[float, complex]:
    """Growth per step beyond that of the reference, and the eigenvalue that has it.

    The motion itself may have growing directions, such as a pendulum away from its rest position.
    Each growing eigenvalue of the reference is matched to the nearest one of `values`, which counts
    with the difference of the moduli; every other one counts with modulus - 1. Both arrays: largest
    modulus first.
    """
    charged = np.abs(values) - 1.0
    free = np.ones(len(values), dtype=np.bool_)
    growing = values[:0] if reference is None else reference[np.abs(reference) > 1.0]
    for own in growing:
        if not free.any():
            break
        nearest = int(np.where(free, np.abs(values - own), np.inf).argmin())
        free[nearest] = False
        charged[nearest] = abs(values[nearest]) - abs(own)
    worst = int(charged.argmax())
    return float(charged[worst]), complex(values[worst])


def block_of(step: StepMap, value: complex) -> str:
    """Block in which the eigenvector of the eigenvalue `value` of the map is largest, relative to
    the sizes of the unknowns."""
    # the strongly connected part of the map that has this eigenvalue
    part = min(parts_of(step.matrix), key=lambda p: float(
        np.abs(np.linalg.eigvals(step.matrix[np.ix_(p, p)]) - value).min()))
    A = step.matrix[np.ix_(part, part)].astype(complex)
    vector = np.ones(len(part), complex)
    for _ in range(2):  # inverse iteration
        shifted = A - value * (1.0 + 1e-9) * np.eye(len(part))
        vector = np.linalg.solve(shifted, vector)
        vector = vector / np.abs(vector).max()
    n = step.layout.size
    whole = np.zeros(len(step.matrix))
    whole[part] = np.abs(vector)
    shown = whole[:n] / step.scale  # of z = (x, v, a, ...) the unknowns x alone
    names = [b.name for b in step.layout.differential]
    return max(names, key=lambda b: float(shown[step.layout[b]].max(initial=0.0)))


LOWEST = 3
"""Number of lowest eigenvalues of each block that are compared."""
ZERO = 1e-4
"""Ratio of the two lowest eigenvalues below which the lowest is the zero eigenvalue of an
unconstrained or insulated body."""


@dataclass(frozen=True, slots=True)
class EigenvalueErrors:
    """Largest relative eigenvalue errors over the blocks; None where they cannot be computed.

    projected: error of the LOWEST eigenvalues relative to the Galerkin model with the same trial
    basis, which is due to the test basis (row sampling); fields: field name -> error of the lowest
    nonzero eigenvalue relative to full order, due to the trial and test bases; imaginary: largest
    |Im| / |eigenvalue|.
    """

    projected: float | None
    fields: Mapping[str, float | None]
    imaginary: float | None


def own_radii(step: StepMap) -> dict[str, float]:
    """Spectral radius of the time-step map of each block or field alone.

    For a first-order (thermal) block, its diagonal part of the coupled map; for an elastic block,
    its map in a fixed frame, if the solver provides the block's response; under the name of the
    rigid coordinates, the diagonal part of all frames together.
    """
    alone = step.solver.alone()
    found = {}
    for b in step.layout:
        if b.kind.reducible and b.kind.order == 1:
            found[b.name] = radius(step.own(b.name))
        elif b.kind.reducible and b.name in alone:
            found[b.name] = radius(step.alone(b.name, alone[b.name]))
    for kind in step.layout.kinds:
        frames = [step.components(b.name) for b in step.layout if b.kind == kind]
        if kind.quantity is Quantity.POSE and frames:
            here = np.concatenate(frames)
            found[kind.name] = radius(step.matrix[np.ix_(here, here)])
    return found


def eigenvalue_errors(
    step: StepMap, reference: StepMap | None, exact: Mapping[str, FloatArray]
) -> EigenvalueErrors:
    """Eigenvalue errors of a reduced model, linearised as `step`.

    reference: linearised Galerkin model of the same trial basis, None if it is not available;
    exact: block -> its lowest full-order eigenvalues (`exact_values`).
    """
    own = {name: _lowest(v) for name, v in own_values(step).items()}
    projected_values = {} if reference is None else {
        name: _lowest(v) for name, v in own_values(reference).items()}
    projected = [float((np.abs(own[n] - v)[: len(v)] / np.abs(v)).max())
                 for n, v in projected_values.items() if n in own and 0 < len(v) == len(own[n])]
    full: dict[str, list[float]] = {k.name: [] for k in step.layout.kinds if k.reducible}
    for name, values in own.items():
        lowest = _lowest(exact[name])
        if len(lowest) and len(values):
            full[step.layout.block(name).field].append(
                float(abs(values[0] - lowest[0]) / lowest[0].real))
    skew = [float((np.abs(v.imag) / np.abs(v)).max(initial=0.0)) for v in own_values(step).values()]
    return EigenvalueErrors(
        max(projected, default=None),
        {field: max(errors, default=None) for field, errors in full.items()},
        max(skew, default=None))


def _lowest(values: ComplexArray | FloatArray) -> ComplexArray:
    """The LOWEST eigenvalues by modulus, without the zero eigenvalue of an unconstrained or
    insulated body."""
    ordered = np.asarray(values[np.argsort(np.abs(values))], complex)
    if len(ordered) > 1 and abs(ordered[0]) < ZERO * abs(ordered[1]):
        ordered = ordered[1:]
    return ordered[:LOWEST]


def own_values(step: StepMap) -> dict[str, ComplexArray]:
    """Block -> eigenvalues of the reduced model: w^2 (1/s^2) of an elastic, s (1/s) of a thermal
    block.

    Computed from the derivatives of the block's solution of a step by the right-hand sides r1 and
    r2 of the integrator: -D^-1 D_m and -D^-1 M, with damping D_m and D = K + c1 D_m + c2 M; for
    heat by r1 alone, -D^-1 C with D = K + c1 C. In the code `mass`, `damping` and `stiffness` are
    D^-1 M (or D^-1 C), D^-1 D_m and D^-1 K.
    """
    # alone: elastic block -> dx' (k, 2 k) from dr1 and dr2 in a fixed frame
    alone, f, found = step.solver.alone(), step.formula, {}
    for b in step.layout:
        if b.kind.reducible and b.kind.order == 1:
            mass = -step.block_response(b.name)[:, : b.size]
            stiffness = np.eye(b.size) - f.c1_first * mass
        elif b.kind.reducible and b.name in alone:
            damping, mass = -alone[b.name][:, : b.size], -alone[b.name][:, b.size :]
            stiffness = np.eye(b.size) - f.c1 * damping - f.c2 * mass
        else:
            continue
        values = linalg.eigvals(stiffness, mass)
        found[b.name] = np.asarray(values[np.isfinite(values)], complex)
    return found


def exact_values(model: Model, count: int = LOWEST + 1) -> dict[str, FloatArray]:
    """Block -> its `count` lowest full-order eigenvalues."""
    return {name: lowest_modes(model.block_data(name), count).values
            for name in model.reducible()}
