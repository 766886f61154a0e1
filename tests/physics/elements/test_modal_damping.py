"""Modal damping: the decrements of free vibrations are those of the given ratios."""

from typing import Any

import numpy as np
import pytest
from scipy.linalg import eigh

from sparsemor import reduce, simulate
from sparsemor.bodies.floating_body import FloatingBody
from sparsemor.bodies.terms.body_terms import generator
from sparsemor.bodies.terms.modal_damping import modal_factors
from sparsemor.core import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.model.assembly import assemble
from sparsemor.core.testing.body import check_body
from sparsemor.core.testing.in_memory_run import scene_of

RATIOS = [0.01, 0.02, 0.05]


def scene(frame: str, reducer: Any = "full", ratio: Any = RATIOS, **changes: Any) -> dict[str, Any]:
    bar = {
        "use": "flexible", "mesh": {"use": "rectangle", "size": [0.4, 0.02], "divisions": [10, 1]},
        "thickness": 0.01, "order": 2, "material": {"rho": 2700, "E": 70e9, "nu": 0.3},
        "fields": ["elastic"], "frame": frame, "reference": {"clamp": "left"},
        "damping": {"ratio": ratio}, **changes}
    pulse = {"use": "pulse", "start": 0.0, "duration": 2e-4, "level": 1.0}
    kick = {"use": "traction", "on": ["bar:right"], "traction": [0.0, -1e4], "factor": pulse}
    return {"format": 1, "bodies": {"bar": bar}, "loads": {"kick": kick},
            "time": {"end": 1.5e-3, "step": 1e-5}, "reducer": reducer,
            "integrator": {"use": "generalized_alpha", "rho_inf": 1.0}}


def decrements(content: dict[str, Any], free: bool, run: Any = None) -> FloatArray:
    """Logarithmic decrements per radian of the first three modes, from the coefficients of
    a_(n + 1) = 2 exp(-d h) cos(w h) a_n - exp(-2 d h) a_(n - 1)."""
    run = run or simulate(scene_of(content))
    body = assemble(scene_of({**content, "reducer": "full"})).parts["bar"]
    assert isinstance(body, FloatingBody) and body.elasticity is not None
    M = generator(body.mass_matrix, np.eye(2)).toarray()
    F, K = body.elasticity.free, body.elasticity.stiffness.toarray()
    if free:
        shapes = eigh(K, M, subset_by_index=(3, 5))[1]
    else:
        shapes = np.zeros((len(M), 3))
        shapes[F] = eigh(K[np.ix_(F, F)], M[np.ix_(F, F)], subset_by_index=(0, 2))[1]
    a, found = run.block("bar.elastic")[40:] @ (M @ shapes)[F], []
    for x in a.T:
        c = np.linalg.lstsq(np.stack([x[1:-1], x[:-2]], axis=1), x[2:], rcond=None)[0]
        s = np.log(np.roots([1.0, -c[0], -c[1]]).astype(complex)[0])
        found.append(-s.real / abs(s))
    return np.array(found)


@pytest.mark.full
def test_decrements_of_three_modes_of_a_cantilever() -> None:
    np.testing.assert_allclose(decrements(scene("fixed"), False), RATIOS, rtol=0.01)


@pytest.mark.full
def test_decrements_of_a_free_body() -> None:
    np.testing.assert_allclose(decrements(scene("floating"), True), RATIOS, rtol=0.01)
    x = simulate(scene_of(scene("floating"))).block("bar.rigid")
    calm = simulate(scene_of(scene("floating", ratio=0.0))).block("bar.rigid")
    mass = 2700 * 0.4 * 0.02 * 0.01  # the body's centre of mass moves as without damping
    speed = 1e4 * 0.02 * 0.01 * 2e-4 / mass
    assert abs((x - calm)[-1, 1]) < 0.05 * speed * 2e-3


@pytest.mark.full
@pytest.mark.parametrize("frame, reducer", [
    ("fixed", "galerkin"), ("fixed", "deim"), ("fixed", "lspg"), ("floating", "sparse"),
    ("floating", "ecsw"), ("floating", "gnat")])
def test_every_reducer_has_the_same_damping(frame: str, reducer: str) -> None:
    content = scene(frame, {"use": reducer, "compiled": "off"})
    np.testing.assert_allclose(decrements(content, frame == "floating"), RATIOS, rtol=0.02)


@pytest.mark.slow  # compiles
def test_a_compiled_step_and_a_kept_model_have_it(tmp_path: Any) -> None:
    content = scene("fixed", {"use": "galerkin", "compiled": "on"})
    model = reduce(scene_of(content))
    np.testing.assert_allclose(
        decrements(content, False, model.run()), decrements(content, False), rtol=1e-9)


@pytest.mark.full
def test_laws_of_a_body_with_modal_damping() -> None:
    check_body(scene_of(scene("floating")).bodies["bar"])


def test_one_ratio_damps_no_part_of_equal_frequencies() -> None:
    """A square has pairs of equal modes; a cut between them would depend on its direction."""
    from scipy.sparse import csr_array, diags_array

    K, M = csr_array(diags_array([0.0, 1.0, 4.0, 4.0, 9.0])), csr_array(np.eye(5))
    none = np.zeros(0, dtype=np.int64)
    assert modal_factors(K, M, none, 1, 0.1, 2).c.shape == (1,)
    np.testing.assert_allclose(modal_factors(K, M, none, 1, 0.1, 3).c, [0.2, 0.4, 0.4])
    np.testing.assert_allclose(modal_factors(K, M, none, 1, [0.1, 0.2], 9).c, [0.2, 0.8])


def test_more_ratios_than_modes_are_refused() -> None:
    content = scene("fixed", ratio=[0.01] * 500)
    with pytest.raises(InputError, match="bodies.bar.damping.ratio: gives 500 ratios, and the"):
        simulate(scene_of(content))


@pytest.mark.parametrize(("damping", "message"), [
    ({"modes": 3}, "modes is the number of modes that have one ratio"),
    ({"ratio": [0.1, 0.2], "modes": 3}, "modes is the number of modes that have one ratio"),
    ({"modes_of": "held"}, "modes_of says nothing without a ratio")])
def test_options_that_say_nothing_are_refused(damping: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        scene_of(scene("fixed", damping=damping))
