"""Coefficients of states under atoms: least squares, by a product where that is the same."""

from typing import Any

import numpy as np
import pytest

from sparsemor.core.linalg.dense import least_squares_coefficients


def test_orthonormal_atoms_take_a_product_however_many_they_are(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng = np.random.default_rng(0)
    b = rng.standard_normal((200, 3))

    def dear(*_: Any, **__: Any) -> None:
        raise AssertionError("least squares of a full basis of 7000 atoms takes minutes")

    for k in (1, 7, 200):
        Q = np.linalg.qr(rng.standard_normal((200, k)))[0]
        expected = np.linalg.lstsq(Q, b, rcond=None)[0]
        with monkeypatch.context() as m:
            m.setattr(np.linalg, "lstsq", dear)
            found = least_squares_coefficients(Q, b)
        assert np.abs(found - expected).max() <= 1e-13


@pytest.mark.parametrize("seed", range(5))
def test_other_atoms_take_least_squares_of_least_norm(seed: int) -> None:
    rng = np.random.default_rng(seed)
    Q = np.linalg.qr(rng.standard_normal((40, 6)))[0]
    alike = Q.copy()
    alike[:, 1] = alike[:, 0] + 1e-8 * Q[:, 1]  # unit columns, and one direction all but lost
    b = Q[:, [2]] + 1e-4 * Q[:, [1]]
    assert least_squares_coefficients(alike, b)[1, 0] == pytest.approx(1e4, rel=1e-6)
    wide = rng.standard_normal((10, 30))
    c = least_squares_coefficients(wide, wide @ rng.standard_normal((30, 2)))
    assert np.abs(c - np.linalg.pinv(wide) @ (wide @ c)).max() <= 1e-12
