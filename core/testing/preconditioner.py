"""Law kit of a preconditioner."""

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.protocols.sampler import Preconditioner
from sparsemor.core.testing.random_inputs import keeps_contract, law

SHAPES = ((1, 1), (1, 4), (5, 5), (6, 9), (10, 40), (20, 30), (12, 5))


def check_preconditioner(preconditioner: Preconditioner, seed: int = 0, trials: int = 3) -> None:
    """Laws of a preconditioner: P is square, finite and nonsingular, so that P A c = P b has the
    solutions of A c = b.

    If `check` gives a reason against a shape, `build` raises an InputError; at least one shape must
    be accepted. Matrices with dependent or zero rows raise InputError or satisfy these laws.
    """
    keeps_contract("preconditioner", preconditioner)
    tried = 0
    for m, k in SHAPES:
        reason = preconditioner.check(m, k)
        law(isinstance(reason, str), "check must return a string, empty when the shape is fine")
        if reason:
            A = np.random.default_rng([seed, m, k]).standard_normal((m, k))
            law(_refused(preconditioner, A), f"check refuses {m} x {k}, build accepts it: {reason}")
            continue
        for trial in range(trials):
            tried += 1
            rng = np.random.default_rng([seed, trial, m, k])
            A = rng.standard_normal((m, k)) * 10.0 ** rng.uniform(-2.0, 2.0, k)
            where = f"(seed {seed}, trial {trial}, A is {m} x {k}"
            _check_one(preconditioner, A, where + ")")
            for fault, B in _deficient(A).items():
                if not _refused(preconditioner, B):
                    _check_one(preconditioner, B, f"{where}, {fault})")
    law(tried, f"check refuses every shape in {SHAPES}")


def _deficient(A: FloatArray) -> dict[str, FloatArray]:
    """Copies of A with its last row replaced by zeros, and by its first row."""
    zero, twice = A.copy(), A.copy()
    zero[-1], twice[-1] = 0.0, A[0]
    return {"last row zero": zero} | ({"last row the first": twice} if len(A) > 1 else {})


def _refused(preconditioner: Preconditioner, A: FloatArray) -> bool:
    try:
        preconditioner.build(A)
    except InputError as error:
        law(str(error), "a refusal needs a reason in words")
        return True
    return False


def _check_one(preconditioner: Preconditioner, A: FloatArray, where: str) -> None:
    """Checks the matrix P (m, m) for rows A (m, k): regular, finite, the same each time."""
    m, before = A.shape[0], A.copy()
    P = preconditioner.build(A)
    law(np.array_equal(A, before), f"the preconditioner wrote to A {where}")
    law(P.shape == (m, m), f"P has shape {P.shape}, not ({m}, {m}) {where}")
    law(np.isfinite(P).all(), f"P holds values that are not finite {where}")
    s = np.linalg.svd(P, compute_uv=False)
    law(s[-1] > 1e-12 * s[0], f"P is singular: condition number {s[0]:.1e}/{s[-1]:.1e} {where}")
    law(
        np.array_equal(P, preconditioner.build(A)), f"two builds from equal rows differ {where}"
    )
