"""Eigenvalue errors of the blocks of a reduced model relative to the full-order model.

Each block alone: free vibration of an elastic block in a fixed frame, K phi = w^2 M phi, and
thermal decay, K phi = s C phi. The eigenvalues of a Galerkin-projected symmetric pencil are real
and not below the exact ones; under sampled rows they may lie anywhere in the complex plane.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import linalg
from scipy.sparse.linalg import eigsh

from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.model import Model
from sparsemor.core.protocols.layout import Quantity
from sparsemor.plugins.stability.spectrum import ComplexArray, radius
from sparsemor.plugins.stability.step_map import StepMap

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
    alone = _alone(step)
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
    r2 of the integrator: -D^-1 D_m and -D^-1 M, with damping D_m and D = K + c1 D_m + c2 M.
    """
    alone, f, found = _alone(step), step.formula, {}
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
    """Block -> its `count` lowest full-order eigenvalues, by sparse shift-invert Lanczos
    iteration."""
    found = {}
    for name in model.reducible():
        data = model.block_data(name)
        K, M = data.stiffness, data.mass
        # below zero, because K of an insulated body is singular
        shift = -1e-6 * float(K.diagonal().max() / M.diagonal().max())
        if K.shape[0] <= 2 * count + 1:
            values = linalg.eigh(K.toarray(), M.toarray(), eigvals_only=True)[:count]
        else:
            values = eigsh(K.tocsc(), count, M.tocsc(), sigma=shift, return_eigenvectors=False,
                           v0=np.ones(K.shape[0]))
        found[name] = np.sort(np.asarray(values, dtype=np.float64))
    return found


def _alone(step: StepMap) -> Mapping[str, FloatArray]:
    """Elastic block -> derivative of its solution of a step by its own right-hand sides; {} if the
    solver does not provide it."""
    return step.solver.alone()
