"""Forces from training snapshots, the maps made of their modes, and the algebra under both."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from small_scenes import coarse_pendulum
from sparsemor.core import Dictionary
from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols.separable import HeatBody, MovingBody
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.offline import Offline
from sparsemor.core.simulation.simulate import simulate
from sparsemor.core.status import SolveFailed
from sparsemor.core.testing.in_memory_run import March, march, scene_of
from sparsemor.plugins.comparison.compare import compare
from sparsemor.reducers.linalg.left_inverse import left_inverse
from sparsemor.reducers.projection.deim import Deim
from sparsemor.reducers.projection.force_modes import (
    differences,
    force_modes,
    interpolation,
)
from sparsemor.reducers.projection.operators_and_test_maps import LinearOperators, Reducible
from sparsemor.reducers.step.projected_operators import TestMap as Map

RULES = {"bdf1": {"use": "bdf1"}, "generalized_alpha": {"use": "generalized_alpha", "rho_inf": 0.5}}


def decoded(run: March) -> FloatArray:
    """(M, n) temperatures of a rod."""
    d = run.solver.dictionaries["rod.thermal"]
    return np.asarray(d.offset + run.block("rod.thermal") @ d.atoms.T)


def block_of(scene: Scene, full: March, name: str) -> Reducible:
    """One block of a full-order run, with no atoms yet."""
    model, X = full.model, full.block(name).T
    sources: dict[str, HeatBody | MovingBody] = {b.thermal: b for b in model.separated.heat}
    sources |= {m.elastic: m for m in model.separated.moving if m.operators is not None}
    linear = LinearOperators.of(sources[name], *scene.integrator.rules(scene.time.step).factors)
    empty = Dictionary(np.zeros((len(X), 0)), np.zeros(len(X)), ())
    return Reducible(name, empty, linear, model, Offline.from_snapshots(
        model, {name: X}), scene.integrator,
                     scene.time.step, np.random.default_rng(0))


@pytest.mark.full
@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("every", [1, 4])
def test_training_through_the_front_door(rule: str, every: int, tmp_path: Path) -> None:
    """The offline stage knows how snapshots were taken: replayed, or differences of every 4th."""
    scene = coarse_pendulum().using({"training.every": every, "integrator": RULES[rule]})
    cache = Cache(tmp_path)
    run, same = (simulate(scene.using({"reducer": r}), cache=cache) for r in ("deim", "galerkin"))
    found = compare(galerkin=run, reference=same).errors["galerkin"]
    bound = 1e-7 if every == 1 else 1e-4
    assert max(found[f] for f in ("rigid", "elastic", "thermal")) < bound
    facts = run.summary["facts"]
    assert facts["link1.elastic"]["points"] == 2 * facts["link1.elastic"]["force_modes"]
    assert (facts["link1.thermal"]["force_modes"] == 1) == (every == 1)


@pytest.mark.full
def test_a_constant_flux_is_one_mode_and_no_load_is_none() -> None:
    """Round-off of K T, whose rows cancel, makes no modes."""
    full = march(coarse_pendulum().using({"reducer": "full"}))
    deim = Deim.model_validate({})
    for link in ("link1", "link2"):
        block = block_of(coarse_pendulum(), full, f"{link}.thermal")
        assert force_modes(block, deim.force_basis).atoms.shape == (block.size, 1)
    rod = scene_of({
        "bodies": {"rod": {
            "use": "flexible", "fields": ["thermal"], "frame": "fixed", "thickness": 0.01,
            "mesh": {"use": "rectangle", "size": [0.2, 0.1], "divisions": [6, 3]},
            "material": {"rho": 1000, "k": 20, "c": 500}, "initial_temperature": "300 + 500*x"}},
        "time": {"end": 20.0, "step": 0.5}, "integrator": "bdf1", "reducer": "full"})
    full = march(rod)
    for method in ("deim", "gnat"):
        cooling = march(rod.using({"reducer": method}), model=full.model,
                        snapshots={"rod.thermal": full.block("rod.thermal").T})
        assert cooling.solver.facts["rod.thermal"]["force_modes"] == 0
        error = decoded(cooling) - full.block("rod.thermal")
        assert np.abs(error).max() < 1e-9 * np.ptp(full.block("rod.thermal"))
        assert (len(cooling.solver.rows["rod.thermal"]) == 0) == (method == "deim")


@pytest.mark.full
@given(st.integers(0, 2**32 - 1), st.integers(1, 8), st.integers(0, 6))
def test_left_inverse(seed: int, k: int, more: int) -> None:
    """left A = 1, left A x* = x for the least-squares problem, columns of any size."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((k + more, k)) * 10.0 ** rng.uniform(-8, 8, k)
    left = left_inverse("b", A)
    assert np.abs(left @ A / np.outer(1 / np.linalg.norm(A, axis=0),
                                      np.linalg.norm(A, axis=0)) - np.eye(k)).max() < 1e-6
    b = rng.standard_normal(k + more)
    assert np.abs(A.T @ (A @ (left @ b) - b) / np.linalg.norm(A, axis=0)).max() < 1e-6
    with pytest.raises(SolveFailed, match="rank_deficient at t = 0 s in b"):
        left_inverse("b", np.hstack([A, A @ rng.standard_normal((k, 1))]))
    with pytest.raises(SolveFailed, match="1 atoms vanish"):
        left_inverse("b", np.hstack([A, np.zeros((k + more, 1))]) if more else np.zeros((1, 1)))


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1), st.booleans(), st.booleans())
def test_a_map_times_a_matrix_is_one_matrix_on_the_whole_block(
    seed: int, some: bool, weighed: bool
) -> None:
    rng = np.random.default_rng(seed)
    n, m, mapped, s = 9, 5, 3, 2
    rows = np.sort(rng.choice(n, m, replace=False)) if some else None
    left = rng.standard_normal((mapped, m if some else n)) if weighed or not some else None
    test = Map(rows=rows, left=left)
    x, more = rng.standard_normal((n, 4)), rng.standard_normal((s, test(np.zeros(n)).size))
    np.testing.assert_allclose(test.times(more, n) @ x, more @ test(x), atol=1e-12)


@pytest.mark.full
@given(st.integers(0, 2**32 - 1), st.integers(1, 6), st.integers(0, 6))
def test_interpolation_gives_back_every_mode(seed: int, f: int, more: int) -> None:
    """(P^T U)^+ P^T U = 1, and errors beside the modes grow by the amplification at most."""
    rng = np.random.default_rng(seed)
    U = np.linalg.qr(rng.standard_normal((20, f)))[0]
    points = np.sort(rng.choice(20, f + more, replace=False))
    back, facts = interpolation("b", U, points)
    np.testing.assert_allclose(back @ U[points], np.eye(f), atol=1e-6)
    beside = rng.standard_normal(20)
    beside -= U @ (U.T @ beside)
    amplification = facts["amplification"]
    assert isinstance(amplification, float) and amplification >= 1.0 - 1e-12
    grown = float(np.linalg.norm(back @ beside[points]))
    assert grown <= amplification * np.linalg.norm(beside) * (1 + 1e-9)
    U[points] = 0.0
    with pytest.raises(SolveFailed, match="do not distinguish its"):
        interpolation("b", U, points)


def test_differences_are_exact_for_what_they_should_be() -> None:
    """Straight lines have their slope; a parabola its second derivative, away from the ends."""
    t = 0.1 * np.arange(9)
    V, A = differences(np.stack([3 * t, 2 * t * t]), 0.1)
    np.testing.assert_allclose(V[0], 3.0)
    np.testing.assert_allclose(V[1, 1:-1], 4 * t[1:-1])
    np.testing.assert_allclose(A[1, 2:-2], 4.0)
