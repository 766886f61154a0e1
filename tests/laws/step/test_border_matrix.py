"""Matrix of the rigid coordinates and joint forces, as the sum of the bodies' own."""

import numpy as np
import pytest

from sparsemor.core import FloatArray
from sparsemor.reducers.step import border_matrix
from sparsemor.reducers.step.border_matrix import BorderMatrix
from sparsemor.reducers.step.jacobian_factors import SparseLu

BODIES, BORDER, SHARED = 8, 5, 2


def chain(rng: np.random.Generator) -> tuple[list[FloatArray], FloatArray]:
    """Maps of the bodies of a chain, of which neighbours share two unknowns, and a matrix of
    each."""
    step = BORDER - SHARED
    n = BODIES * step + SHARED
    maps = []
    for i in range(BODIES):
        T = np.zeros((BORDER, n))
        T[:, i * step : i * step + BORDER] = np.eye(BORDER)
        T[-1] *= -1.0
        maps.append(T)
    return maps, rng.normal(size=(BODIES, BORDER, BORDER))


@pytest.mark.parametrize("widest", [64, 0])
def test_it_is_the_sum_of_the_bodies_matrices(
    widest: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(border_matrix, "WIDEST", widest)
    rng = np.random.default_rng(1)
    maps, H = chain(rng)
    B = sum((T.T @ A @ T for T, A in zip(maps, H, strict=True)), np.zeros((1, 1)))
    structure = BorderMatrix(maps)
    entries = structure.assembled(H.ravel())
    assert np.allclose(structure.matrix(entries).toarray(), B, rtol=0, atol=1e-14)
    x, r = np.abs(rng.normal(size=len(B))), rng.normal(size=(len(B), 2))
    assert np.allclose(structure.magnitudes(entries, x), np.abs(B) @ x)
    factor = structure.factorized(entries)
    assert isinstance(factor, SparseLu) == (widest == 0)
    expected = np.linalg.solve(B, r)
    assert np.allclose(factor.solve(r), expected, rtol=1e-9, atol=0)
    assert np.allclose(factor.solve(r[:, 0]), expected[:, 0], rtol=1e-9, atol=0)


def test_bands_of_a_chain_are_as_narrow_as_its_bodies() -> None:
    maps, _ = chain(np.random.default_rng(1))
    assert BorderMatrix(maps).width < 2 * BORDER


@pytest.mark.parametrize("broken", [0.0, np.nan])
def test_a_singular_matrix_is_refused(broken: float) -> None:
    maps, H = chain(np.random.default_rng(1))
    H[:2, :, 4] = H[:2, 4] = H[1, 1] = H[1, :, 1] = broken  # the unknown that both bodies share
    structure = BorderMatrix(maps)
    with pytest.raises(RuntimeError, match="singular"):
        structure.factorized(structure.assembled(H.ravel()))
