"""Singular values where LAPACK's first algorithm gives up, and where there are none."""

from typing import Any

import numpy as np
import pytest
from scipy import linalg, sparse

from sparsemor.core import BlockData, Dictionary
from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.linalg.dense import svd
from sparsemor.plugins.samplers.candidate_rows import SpanSampler
from sparsemor.plugins.samplers.deim import DeimPoints
from sparsemor.plugins.samplers.s_opt import SOpt

GIVES_UP = np.linalg.LinAlgError("SVD did not converge")


def gives_up(*_: Any, **__: Any) -> None:
    raise GIVES_UP


@pytest.fixture
def no_divide_and_conquer(monkeypatch: pytest.MonkeyPatch) -> None:
    """gesdd fails on every matrix, as it does on a few; which ones depends on the processor."""
    other = linalg.svd

    def scipys(*given: Any, lapack_driver: str = "gesdd", **more: Any) -> Any:
        if lapack_driver == "gesdd":
            raise GIVES_UP
        return other(*given, lapack_driver=lapack_driver, **more)

    monkeypatch.setattr(np.linalg, "svd", gives_up)
    monkeypatch.setattr(linalg, "svd", scipys)


def one_left(k: int, seed: int) -> FloatArray:
    """(3 k, k) orthonormal columns; all but one direction lives on k - 1 rows, as force modes of a
    load that moves do beside one of a film all around."""
    rng = np.random.default_rng(seed)
    U = np.zeros((3 * k, k))
    U[: k - 1, : k - 1] = np.eye(k - 1)
    U[k - 1:, -1] = rng.uniform(0.5, 1.0, 2 * k + 1)
    return np.asarray(np.linalg.qr(U @ np.linalg.qr(rng.standard_normal((k, k)))[0])[0])


def sampled(sampler: SpanSampler, U: FloatArray) -> list[int]:
    n = len(U)
    one = sparse.csr_array(sparse.eye_array(n))
    block = BlockData("disk.thermal", np.zeros((n, 0)), one, one, np.arange(float(n))[:, None],
                      np.zeros(n, np.int64), np.zeros((n, 0)))
    none = np.zeros(0, np.int64)
    atoms = Dictionary(U, np.zeros(n), ("",) * U.shape[1])
    return sampler.sample(block, 2 * U.shape[1], atoms, np.random.default_rng(0), none).tolist()


@pytest.mark.parametrize("sampler", [DeimPoints(), SOpt()], ids=lambda s: type(s).__name__)
def test_samplers_choose_the_same_rows_where_divide_and_conquer_gives_up(
    sampler: SpanSampler, request: pytest.FixtureRequest,
) -> None:
    U = one_left(20, 0)
    usual = sampled(sampler, U)
    request.getfixturevalue("no_divide_and_conquer")
    assert sampled(sampler, U) == usual
    assert set(range(19)) <= set(usual)


@pytest.mark.parametrize("shape", [(30, 12), (12, 30), (15, 15)])
@pytest.mark.parametrize("whole", [False, True])
def test_qr_iteration_gives_a_decomposition(
    shape: tuple[int, int], whole: bool, no_divide_and_conquer: None
) -> None:
    A = np.random.default_rng(1).standard_normal(shape) * 10.0 ** -np.linspace(0, 8, shape[1])
    U, s, Vt = svd(A, full_matrices=whole)
    p = min(shape)
    assert U.shape == (shape[0], shape[0] if whole else p)
    assert Vt.shape == (shape[1] if whole else p, shape[1])
    assert np.abs((U[:, :p] * s) @ Vt[:p] - A).max() <= 1e-14 * s[0]
    assert np.abs(s**2 - np.linalg.eigvalsh(A @ A.T)[::-1][:p]).max() <= 1e-14 * s[0]**2


def test_no_singular_values_is_said_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    A = np.eye(3)
    A[1, 2] = np.nan
    with pytest.raises(InputError, match="3 x 3 has entries that are not finite"):
        svd(A)
    monkeypatch.setattr(np.linalg, "svd", gives_up)
    monkeypatch.setattr(linalg, "svd", gives_up)
    with pytest.raises(InputError, match="3 x 3 were not found, neither by"):
        svd(np.eye(3))
