"""Eigenvalues of a linearised time-step map, and the excess growth that the reduction adds."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from sparsemor.core.arrays import FloatArray, IntArray
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
    """Block in which the eigenvector of `value` is largest, relative to the sizes of the
    unknowns."""
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
    shown = whole[:n] / step.scale
    names = [b.name for b in step.layout.differential]
    return max(names, key=lambda b: float(shown[step.layout[b]].max(initial=0.0)))
