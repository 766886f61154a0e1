"""Arrays of the local terms of a block for compiled steps (local.py)."""

from collections.abc import Sequence

import numpy as np

from sparsemor.core import Amplitude, FloatArray, IntArray, ReducedTerm
from sparsemor.core.protocols import PointArrays
from sparsemor.reducers.step.compiled.compile import Called
from sparsemor.reducers.step.compiled.local import LAWS, NO_LOCAL, LocalArrays
from sparsemor.reducers.step.compiled.timed import NotCompiled, Timed
from sparsemor.reducers.step.operators import TestedLocal


def points_of(terms: Sequence[ReducedTerm | TestedLocal], name: str) -> list[PointArrays]:
    """The terms of a block as arrays. Raises NotCompiled where one has none."""
    found = []
    for term in terms:
        made = term.arrays()
        if made is None:
            raise NotCompiled(
                f"{name} has terms that depend on the unknowns and are not given as arrays")
        found.append(made)
    return found


def local_arrays(
    found: Sequence[PointArrays], active: IntArray, laws: list[Called], timed: Timed,
    first: int = 0,
) -> LocalArrays:
    """Terms of one block, stacked; active (s,): inputs that are solved for; first: that of the
    inputs, without those that no term depends on. Functions of new laws are added to `laws`."""
    if not found:
        return NO_LOCAL
    terms, reads, tests, pairs = (list[list[int]]() for _ in range(4))
    numbers, L, amplitudes = list[FloatArray](), list[FloatArray](), list[Amplitude]()
    point = row = column = constants = 0
    rated, bent = list[int](), list[int]()
    for one in found:
        law, (E, Q) = (one.law.function, one.law.calls), one.weights.shape
        if law not in laws:
            laws.append(law)
        terms.append([
            laws.index(law), E, Q, constants, constants + len(one.law.numbers), len(amplitudes),
            point, len(reads), len(reads) + len(one.reads), len(tests),
            len(tests) + len(one.tests), len(pairs)])
        numbers.append(one.law.numbers)
        amplitudes += one.law.amplitudes
        for start, width, kind in one.reads.tolist():
            reads.append([row + start, int(width == Q), kind])
            ends = [row + start, row + start + E * width]
            rated += ends if kind == 1 else []
            bent += ends if kind == 2 else []
        for test in one.tests:
            tests.append([column, int(test.shape[1] == E * Q)])
            L.append(test)
            column += test.shape[1]
        pairs += one.law.pairs.tolist()
        constants, point, row = constants + len(one.law.numbers), point + E * Q, row + len(one.P)
    if len(laws) > LAWS:
        raise NotCompiled(f"more than {LAWS} different laws")
    P = np.ascontiguousarray(np.concatenate([one.P[:, first:] for one in found]))
    used = np.flatnonzero(P[:, active].any(axis=1))
    moved = slice(used[0], used[-1] + 1) if len(used) else slice(0, 0)
    effects = np.zeros((len(P), sum(len(one.values) for one in found)))
    row = column = 0
    for one in found:
        here = slice(column, column + len(one.values))
        effects[row : row + len(one.P), here] = one.effects
        row, column = row + len(one.P), here.stop
    axes = max(len(one.coordinates) for one in found)
    coordinates = [np.concatenate([x, np.zeros((axes - len(x), x.shape[1]))])
                   for x in (one.coordinates for one in found)]
    prescribed = [f for one in found for f in one.values] + [f for one in found for f in one.rates]
    prescribed += [f for one in found for f in one.bends]
    return LocalArrays(
        np.array(terms, dtype=np.int64), np.concatenate(numbers), timed.amplitudes(amplitudes),
        timed.amplitudes(prescribed), np.concatenate([one.weights.ravel() for one in found]),
        np.concatenate(coordinates, axis=1), P,
        np.concatenate([one.offset for one in found]), effects,
        np.array([min(rated, default=0), max(rated, default=0)], dtype=np.int64),
        np.array([min(bent, default=0), max(bent, default=0)], dtype=np.int64),
        np.array([moved.start, moved.stop], dtype=np.int64),
        P[moved] if len(active) == P.shape[1] else np.ascontiguousarray(P[moved, active]),
        np.array(reads, dtype=np.int64).reshape(-1, 3),
        np.array(tests, dtype=np.int64).reshape(-1, 2),
        np.array(pairs, dtype=np.int64).reshape(-1, 2), np.concatenate(L, axis=1))
