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


@pytest.mark.parametrize("seed", range(2))
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
