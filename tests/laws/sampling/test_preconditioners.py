"""What preconditioners do to coherence and condition; what their law kit catches."""


import numpy as np
import pytest

from sparsemor.core import Preconditioner
from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.linalg.dense import coherence, condition_number, unit_columns
from sparsemor.core.testing import check_preconditioner
from sparsemor.plugins.preconditioners.parseval import Parseval
from sparsemor.plugins.preconditioners.row_scaling import RowScaling
from sparsemor.plugins.preconditioners.untf import UnitNormTightFrame
from sparsemor.reducers.reducer_notes import worse_conditioned
from sparsemor.reducers.sparse.sampled_block import row_facts, weigh
from tiers import full


@pytest.mark.parametrize(("m", "k"), [(20, 80), (50, 52), (30, 30)])
def test_untf_tightens_the_frame_and_lowers_the_coherence(m: int, k: int) -> None:
    B = np.random.default_rng(0).standard_normal((m, k))
    PB = UnitNormTightFrame().build(B) @ B
    assert coherence(PB) < coherence(B)
    assert condition_number(unit_columns(PB)) < 1.5 < condition_number(unit_columns(B))


@pytest.mark.parametrize(("m", "k"), [(20, 80), full(100, 120)])
def test_untf_by_products_is_a_tight_frame_of_the_same_coherence(m: int, k: int) -> None:
    """Also where exact eigenvectors leave the row space: (100, 120), seed 1."""
    B = np.random.default_rng(1).standard_normal((m, k))
    exact = UnitNormTightFrame().build(B) @ B
    PB = UnitNormTightFrame(products=1).build(B) @ B
    assert condition_number(unit_columns(PB)) < 1.5
    assert coherence(PB) == pytest.approx(coherence(exact), abs=0.01)


@pytest.mark.full
def test_a_note_says_that_untf_makes_rows_worse_conditioned() -> None:
    B = np.random.default_rng(1).standard_normal((100, 120))
    exact, near = (row_facts(B, UnitNormTightFrame(products=n).build(B)) for n in (None, 1))
    (note,) = worse_conditioned("bar.thermal", exact)
    assert "bar.thermal have condition number 19 without it and 2.1e+02 with it" in note.text
    assert worse_conditioned("bar.thermal", near) == ()
    assert worse_conditioned("bar.thermal", row_facts(B, None)) == ()


def cosines(A: FloatArray) -> FloatArray:
    F = unit_columns(A)
    return np.asarray(F.T @ F, dtype=np.float64)


def test_untf_is_independent_of_earlier_row_mixing() -> None:
    """S B^+ undoes any nonsingular mixing of the rows, up to a rotation of the result."""
    rng = np.random.default_rng(1)
    B, once = rng.standard_normal((10, 25)), UnitNormTightFrame(iterations=20)
    P = once.build(B)
    again = UnitNormTightFrame(iterations=1).build(P @ B)
    direct = UnitNormTightFrame(iterations=21).build(B)
    np.testing.assert_allclose(cosines(again @ P @ B), cosines(direct @ B), atol=1e-9)


def test_untf_stops_early_when_asked() -> None:
    B = np.random.default_rng(2).standard_normal((10, 15))
    first = UnitNormTightFrame(iterations=1).build(B)
    assert np.array_equal(UnitNormTightFrame(iterations=50, tolerance=0.999).build(B), first)


@pytest.mark.parametrize("plugin", [UnitNormTightFrame(), Parseval()])
def test_what_has_no_inverse_root_is_refused_in_words(plugin: Preconditioner) -> None:
    reason = plugin.check(80, 20)
    assert "20 atoms < 80 rows" in reason and plugin.check(80, 80) == ""
    with pytest.raises(InputError, match="20 atoms < 80 rows"):
        plugin.build(np.ones((80, 20)))
    B = np.random.default_rng(0).standard_normal((5, 9))
    B[4] = B[0] + B[1]
    with pytest.raises(InputError, match="rank 4"):
        plugin.build(B)


@pytest.mark.parametrize("preconditioner", [UnitNormTightFrame(), Parseval()])
def test_more_rows_than_atoms_are_compressed_without_loss(preconditioner: Preconditioner) -> None:
    """With P (k, m) on B (m, k): one solution with all atoms, as without P."""
    rng = np.random.default_rng(4)
    B, b = rng.standard_normal((30, 8)), rng.standard_normal(30)
    P = weigh(None, preconditioner, "bar.thermal", B)
    assert P is not None and P.shape == (8, 30)
    np.testing.assert_allclose(np.linalg.solve(P @ B, P @ b), np.linalg.lstsq(B, b)[0], rtol=1e-10)
    Q, R = np.linalg.qr(B)
    np.testing.assert_allclose(P, preconditioner.build(R) @ Q.T, atol=1e-12)
    some = [0, 3, 5]
    np.testing.assert_allclose(
        np.linalg.lstsq(Q.T @ B[:, some], Q.T @ b)[0], np.linalg.lstsq(B[:, some], b)[0],
        rtol=1e-10)


@pytest.mark.parametrize(("m", "k"), [(1, 1), (12, 30), (25, 25)])
def test_parseval_rows_are_orthonormal(m: int, k: int) -> None:
    A = np.random.default_rng(k).standard_normal((m, k)) * np.logspace(0.0, 5.0, k)
    P = Parseval().build(A)
    np.testing.assert_allclose(P @ A @ (P @ A).T, np.eye(m), atol=1e-9)
    np.testing.assert_allclose(P, P.T, atol=1e-12 * np.abs(P).max())
    assert np.linalg.eigvalsh(P).min() > 0.0  # the root, not a rotation of it


def test_row_scaling_makes_rows_equal_and_leaves_round_off_alone() -> None:
    A = np.random.default_rng(0).standard_normal((8, 3)) * np.logspace(0.0, 9.0, 8)[:, None]
    P = RowScaling().build(A)
    np.testing.assert_allclose(np.linalg.norm(P @ A, axis=1), 1.0, rtol=1e-12)
    A[2] = 1e-12  # round-off of rows of 1e9
    assert np.linalg.norm((RowScaling().build(A) @ A)[2]) < 1e-15
    assert np.array_equal(RowScaling().build(np.zeros((2, 3))), np.eye(2))


@pytest.mark.parametrize("seed", range(5))
def test_row_scaling_is_near_the_best_diagonal(seed: int) -> None:
    """Within sqrt(m) of every other one (van der Sluis 1969)."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((6, 14)) * 10.0 ** rng.uniform(-4.0, 4.0, (6, 1))
    own = condition_number(RowScaling().build(A) @ A)
    others = [condition_number(10.0 ** rng.uniform(-4.0, 4.0, (6, 1)) * A) for _ in range(200)]
    assert own <= np.sqrt(6) * min(others)
    assert own < condition_number(A)


def test_measures_on_known_matrices() -> None:
    A = np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 3.0]])
    assert coherence(A) == pytest.approx(np.sqrt(0.5))
    assert coherence(A[:, :1]) == 0.0
    assert condition_number(np.diag([4.0, 2.0])) == pytest.approx(2.0)
    assert condition_number(np.ones((2, 2))) == np.inf


class Broken(Preconditioner):
    fault: str

    def check(self, rows: int, atoms: int) -> str:
        return "no" if self.fault in ("refuses all", "refuses and builds") else ""

    def build(self, A: FloatArray) -> FloatArray:
        m = A.shape[0]
        if self.fault == "refuses all" or (self.fault == "in silence" and not A[-1].any()):
            raise InputError("no" if self.fault == "refuses all" else "")
        if self.fault == "lets zero rows through" and not A[-1].any():
            return np.diag(np.linalg.norm(A, axis=1))
        if self.fault == "singular":
            return np.ones((m, m)) if m > 1 else np.eye(1)
        if self.fault == "shape":
            return np.eye(m + 1)
        if self.fault == "nan":
            return np.full((m, m), np.nan)
        if self.fault == "writes":
            A *= 2.0
        if self.fault == "not repeatable":
            return np.eye(m) + np.diag(np.random.default_rng().random(m))
        return np.eye(m)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("refuses all", "every shape"),
        ("refuses and builds", "build accepts it"),
        ("lets zero rows through", "singular.*last row zero"),
        ("in silence", "needs a reason"),
        ("singular", "singular"),
        ("shape", "shape"),
        ("nan", "not finite"),
        ("writes", "wrote to A"),
        ("not repeatable", "two builds"),
    ],
)
def test_a_broken_preconditioner_fails_its_law(fault: str, words: str) -> None:
    with pytest.raises(AssertionError, match=words):
        check_preconditioner(Broken(fault=fault))
