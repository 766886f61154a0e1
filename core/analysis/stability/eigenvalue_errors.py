"""Eigenvalue errors of the blocks of a reduced model against those of full order.

Each block alone: free vibration of an elastic block in a frame that stands still, K phi = w^2 M
phi, and the decay of temperatures, K phi = s C phi. A projected pencil is symmetric, so its
eigenvalues are real and not below the exact ones; under sampled rows they may lie anywhere.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import linalg
from scipy.sparse.linalg import eigsh

from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.model import Model
from sparsemor.core.protocols import RespondsByBlock
from sparsemor.core.protocols.layout import Quantity
from sparsemor.core.simulation.linearization.differences import StepMap
from sparsemor.core.simulation.linearization.spectrum import ComplexArray, radius

LOWEST = 3
"""Eigenvalues of each block that are compared."""
ZERO = 1e-4
"""A lowest eigenvalue below this share of the next one is the zero of an unconstrained or insulated
body."""


@dataclass(frozen=True, slots=True)
class EigenvalueErrors:
    """Largest over the blocks, relative; None where it cannot be computed.

    projected: of the LOWEST eigenvalues from those of the Galerkin model of the same atoms: what
    the test map did. fields: by name, of the lowest eigenvalue that is not zero from full order:
    what the atoms did, too. imaginary: imaginary part of an eigenvalue.
    """

    projected: float | None
    fields: Mapping[str, float | None]
    imaginary: float | None


def own_radii(step: StepMap) -> dict[str, float]:
    """Spectral radius of each field's own map.

    A first-order block: exactly its part of the coupled map; a second-order one in a frame that
    stands still, where the solver can tell (`alone`); by the name of their kind: all frames, the
    past of the other fields held.
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


def departure(
    step: StepMap, reference: StepMap | None, exact: Mapping[str, FloatArray]
) -> EigenvalueErrors:
    """exact: block -> its lowest eigenvalues in full order, as `exact_values` gives them."""
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
    """The LOWEST by modulus; an insulated body's zero is left out, in which nothing can depart."""
    ordered = np.asarray(values[np.argsort(np.abs(values))], complex)
    if len(ordered) > 1 and abs(ordered[0]) < ZERO * abs(ordered[1]):
        ordered = ordered[1:]
    return ordered[:LOWEST]


def own_values(step: StepMap) -> dict[str, ComplexArray]:
    """Block -> w^2 (1/s^2) of an elastic, s (1/s) of a thermal block, as reduced.

    From its answer to r1 and r2: -D^-1 D_m and -D^-1 M with D = K + c1 D_m + c2 M.
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
    """Block -> its `count` lowest eigenvalues in full order, by sparse shift-invert Lanczos."""
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
    """Response of each elastic block of the solver; {} for a solver without them."""
    return step.solver.alone() if isinstance(step.solver, RespondsByBlock) else {}
