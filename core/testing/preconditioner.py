"""Laws of a preconditioner."""

import numpy as np

from sparsemor.core.protocols import Preconditioner
from sparsemor.core.testing.data import law

SHAPES = ((1, 1), (1, 4), (5, 5), (6, 9), (10, 40), (20, 30), (12, 5))


def check_preconditioner(preconditioner: Preconditioner, seed: int = 0, trials: int = 3) -> None:
    """P is square, finite and nonsingular, so that P A c = P b has the solutions of A c = b.

    Shapes for which `check` gives a reason are left out; at least one must pass.
    """
    tried = 0
    for m, k in SHAPES:
        reason = preconditioner.check(m, k)
        law(isinstance(reason, str), "check must return a string, empty when the shape is fine")
        if reason:
            continue
        for trial in range(trials):
            tried += 1
            rng = np.random.default_rng([seed, trial, m, k])
            A = rng.standard_normal((m, k)) * 10.0 ** rng.uniform(-2.0, 2.0, k)
            _check_one(preconditioner, A, f"(seed {seed}, trial {trial}, A is {m} x {k})")
    law(tried, f"check refuses every shape in {SHAPES}")


def _check_one(preconditioner: Preconditioner, A: np.ndarray, where: str) -> None:
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
