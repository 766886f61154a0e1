"""Arrays of local terms for compiled steps (local_terms.py)."""

from collections.abc import Sequence

import numpy as np

from sparsemor.core import Amplitude, FloatArray, ReducedTerm
from sparsemor.core.protocols.term import PointArrays
from sparsemor.reducers.step.compiled.compile import ArrayFunction
from sparsemor.reducers.step.compiled.local_terms import NO_LOCAL, LocalArrays
from sparsemor.reducers.step.compiled.time_functions import NotCompiled, Timed
from sparsemor.reducers.step.projected_operators import ProjectedLocal


def points_of(term: ReducedTerm | ProjectedLocal, name: str) -> PointArrays:
    """A term of a block as arrays. Raises NotCompiled where it has none."""
    made = term.arrays()
    if made is None:
        raise NotCompiled(
            f"{name} has terms that depend on the unknowns and are not given as arrays")
    return made


def local_arrays(
    terms: Sequence[ReducedTerm | ProjectedLocal], name: str, laws: list[ArrayFunction],
    timed: Timed
) -> LocalArrays:
    """Terms of one block, stacked. Functions of new laws are added to `laws`."""
    found = [points_of(term, name) for term in terms]
    if not found:
        return NO_LOCAL
    about, reads, tests = (list[list[int]]() for _ in range(3))
    numbers, L, amplitudes = list[FloatArray](), list[FloatArray](), list[Amplitude]()
    point = row = column = constants = 0
    rated: tuple[list[int], list[int]] = [], []
    for one in found:
        law, (E, Q) = one.law.function, one.weights.shape
        if law not in laws:
            laws.append(law)
        about.append([
            laws.index(law), E, Q, constants, constants + len(one.law.numbers), len(amplitudes),
            point, len(reads), len(reads) + len(one.reads), len(tests)])
        numbers.append(one.law.numbers)
        amplitudes += one.law.amplitudes
        for start, width, kind in one.reads.tolist():
            reads.append([row + start, int(width == Q), kind])
            if kind:
                rated[kind - 1].extend((row + start, row + start + E * width))
        for test in one.tests:
            tests.append([column, int(test.shape[1] == E * Q)])
            L.append(test)
            column += test.shape[1]
        constants, point, row = constants + len(one.law.numbers), point + E * Q, row + len(one.P)
    effects, row = np.zeros((row, sum(len(one.values) for one in found))), 0
    column = 0
    for one in found:
        here = slice(column, column + len(one.values))
        effects[row : row + len(one.P), here] = one.effects
        row, column = row + len(one.P), here.stop
    axes = max(len(one.coordinates) for one in found)
    prescribed = [f for kind in ("values", "rates", "bends") for one in found
                  for f in getattr(one, kind)]
    return LocalArrays(
        np.array(about, dtype=np.int64), np.concatenate(numbers), timed.amplitudes(amplitudes),
        timed.amplitudes(prescribed), np.concatenate([one.weights.ravel() for one in found]),
        np.ascontiguousarray(np.concatenate(
            [np.pad(x, ((0, axes - len(x)), (0, 0))) for x in (one.coordinates for one in found)],
            axis=1)),
        np.ascontiguousarray(np.concatenate([one.P for one in found])),
        np.concatenate([one.offset for one in found]), effects,
        np.array([(min(r, default=0), max(r, default=0)) for r in rated], dtype=np.int64),
        np.array(reads, dtype=np.int64).reshape(-1, 3),
        np.array(tests, dtype=np.int64).reshape(-1, 2),
        np.ascontiguousarray(np.concatenate(L, axis=1)))  # one type for all terms
