"""Integrals element by element: they add up to the operators, and weights keep these symmetric."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from small_scenes import SCENES, coarse_pendulum, everything, everything_assembled
from sparsemor.core.model.assembly import assemble
from sparsemor.core.scene.scene import Scene, load


def quadratic() -> Scene:
    """The heated bar on a hinge with quadratic elements."""
    return load(SCENES / "tiny.yaml", {"bodies.bar.order": 2})


@pytest.mark.parametrize("scene", [everything, coarse_pendulum, quadratic])
def test_element_integrals_sum_up_to_the_operators(scene: Callable[[], Scene]) -> None:
    model = assemble(scene())
    seen = 0
    for m in model.separated.moving:
        if m.operators is None or m.operators.integrals is None:
            continue
        o, g = m.operators, m.operators.integrals()
        one = np.ones(g.stiffness.count)
        close(g.stiffness.weighted(one), o.stiffness)
        if o.coupling is not None and g.coupling is not None:
            close(g.coupling.weighted(one), o.coupling)
        given = g.given.weighted(one).toarray()
        close(given[:, 0], o.constant)
        close(given[:, 1:], o.loads)
        assert len(g.amplitudes) == given.shape[1] - 1
        seen += 1
    for b in model.separated.heat:
        assert b.integrals is not None
        h = b.integrals()
        one = np.ones(h.capacity.count)
        close(h.capacity.weighted(one), b.capacity)
        # what is left of the conductivity is that of films, on few nodes
        rest = abs(b.conductivity - h.conductivity.weighted(one)).toarray()
        assert (rest.max(axis=1) > 1e-9 * abs(b.conductivity).max()).sum() <= len(rest) / 2
        seen += 1
    assert seen == {everything: 7, coarse_pendulum: 4, quadratic: 2}[scene]


def close(one: Any, other: Any) -> None:
    size = float(abs(other).max()) if other.size else 1.0
    assert not other.size or float(abs(one - other).max()) < 1e-11 * size


@pytest.mark.parametrize("seed", range(6))
def test_projected_integrals_are_those_of_the_weighted_matrix(seed: int) -> None:
    rng = np.random.default_rng(seed)
    body = everything_assembled().separated.moving[0]
    assert body.operators is not None and body.operators.integrals is not None
    g = body.operators.integrals().coupling
    assert g is not None
    left, right = (rng.standard_normal((n, 3)) for n in g.shape)
    w = rng.random(g.count) * (rng.random(g.count) < 0.3)
    want = left.T @ (g.weighted(w) @ right)
    np.testing.assert_allclose(np.tensordot(w, g.projected(left, right), 1), want, atol=1e-6)


@pytest.mark.parametrize("seed", range(8))
def test_weighted_stiffness_is_symmetric_and_positive_semidefinite(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = everything_assembled()
    g = [m.operators.integrals().stiffness for m in model.separated.moving
         if m.operators is not None and m.operators.integrals is not None]
    for b in model.separated.heat:
        assert b.integrals is not None
        g += [b.integrals().capacity, b.integrals().conductivity]
    for integrals in g:
        w = rng.exponential(5.0, integrals.count) * (rng.random(integrals.count) < 0.2)
        A = integrals.weighted(w).toarray()
        size = max(float(abs(A).max()), 1e-300)
        assert abs(A - A.T).max() <= 1e-13 * size
        assert np.linalg.eigvalsh(A).min() > -1e-12 * size


@pytest.mark.parametrize("seed", range(6))
def test_contributions_of_radiation_add_up_and_weights_scale_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = everything_assembled()
    terms = [t for b in model.separated.heat for t in b.local]
    assert len(terms) == 4
    for term in terms:
        assert term.weighs_elements
        n, m = len(term.columns), len(term.rows)
        left, x, t = rng.standard_normal((3, m)), 300 + 200 * rng.random((n, 4)), rng.random(4)
        zero = np.zeros(n)
        shares = term.contributions(left, x, np.zeros_like(x), t)
        want = [left @ term.residual(x[:, i], zero, zero, float(t[i])) for i in range(4)]
        np.testing.assert_allclose(shares.sum(axis=0), np.array(want).T, rtol=1e-10, atol=1e-9)
        w = rng.random(term.elements) * (rng.random(term.elements) < 0.5)
        few = term.weighted(w)
        assert few.elements == np.count_nonzero(w)
        assert np.isin(few.rows, term.rows).all()
        at, there = np.searchsorted(term.rows, few.rows), np.searchsorted(term.columns, few.columns)
        r = few.residual(x[there, 0], zero[there], zero[there], float(t[0]))
        np.testing.assert_allclose(left[:, at] @ r, np.tensordot(w, shares[:, :, 0], 1), atol=1e-8)
