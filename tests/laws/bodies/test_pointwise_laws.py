"""Pointwise laws and weak terms: derivatives, restriction, weights, and evaluation by points."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from sparsemor.bodies import Isotropic, PointwiseLaw
from sparsemor.bodies.fem.elasticity import law as constants
from sparsemor.bodies.loads.surface_heat import Film, GreyBody
from sparsemor.bodies.temperature_curve import TemperatureCurve
from sparsemor.bodies.terms.material_laws import (
    Conduction,
    Departure,
    Expansion,
    Softening,
    StoredHeat,
)
from sparsemor.bodies.terms.nonlinear_strains import NonlinearStrains
from sparsemor.bodies.terms.weak_term import WeakTerm
from sparsemor.core import FloatArray, Term, Trial
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.compressed_local import CompressedLocal
from sparsemor.core.model.model import Model
from sparsemor.core.testing import check_term
from sparsemor.core.testing.in_memory_run import scene_of

TABLE = TemperatureCurve(temperatures=(200.0, 400.0, 900.0), values=(30.0, 50.0, 20.0))
CUBIC = TemperatureCurve(polynomial=(2.0, 1e-3, -2e-6, 1e-9), origin=300.0, range=(100.0, 2000.0))
STEEL = Isotropic(rho=7850, E=2e11, nu=0.3, alpha=1.2e-5)
LAWS: dict[str, PointwiseLaw] = {
    "radiation": GreyBody(0.7, lambda t: 290.0 + t),
    "film": Film(CUBIC, 1.5, lambda t: 280.0 + 3.0 * t),
    "conduction": Conduction(Departure(TABLE, 44.0), 2),
    "conduction in space": Conduction(Departure(CUBIC, 1.7), 3),
    "stored heat": StoredHeat(7850.0, Departure(TABLE, 44.0)),
    "softening": Softening(Departure(TABLE, 44.0), constants(STEEL, "plane_stress"), 2),
    "softening in space": Softening(Departure(CUBIC, 1.7), constants(STEEL, "solid"), 3),
    "expansion": Expansion(TABLE, CUBIC, 1.4, 60.0, 293.15, 2),
    "expansion with constant E": Expansion(2e11, CUBIC, 2.5, 6e11, 293.15, 3),
    "nonlinear strains": NonlinearStrains(
        constants(STEEL, "plane_stress"), 2, 2e11, 2e11, 1.2e-5, 1.4, 293.15, False),
    "nonlinear strains in space": NonlinearStrains(
        constants(STEEL, "solid"), 3, TABLE, 44.0, CUBIC, 2.5, 293.15, True)}


def drawn(law: PointwiseLaw, rng: np.random.Generator) -> list[FloatArray]:
    """Temperatures of 300 to 800 K, and other variables of size 1, at 5 elements of 3 points."""
    return [300.0 + 500.0 * rng.random((5, 3)) if v.axis is None and not v.rate else
            rng.standard_normal((5, 3)) for v in law.reads]


@pytest.mark.parametrize("name", LAWS)
def test_derivatives_of_a_law_are_those_of_its_values(name: str) -> None:
    law, rng = LAWS[name], np.random.default_rng(1)
    z, x = drawn(law, rng), rng.random((2, 5, 3))
    found = law(z, x, 0.7)
    assert len(found.y) == len(law.tests)
    for j in range(len(z)):
        step = 1e-4 * np.abs(z[j]).max()
        ahead, behind = (law([*z[:j], z[j] + s * step, *z[j + 1:]], x, 0.7).y for s in (1, -1))
        for i, (a, b, y) in enumerate(zip(ahead, behind, found.y, strict=True)):
            size = np.abs(y).max() / np.abs(z[j]).max()
            got = found.derivatives.get((i, j), 0.0)
            np.testing.assert_allclose(
                np.broadcast_to(got, (5, 3)), np.broadcast_to((a - b) / (2 * step), (5, 3)),
                rtol=1e-5, atol=1e-5 * size)


@pytest.mark.parametrize("name", [n for n, one in LAWS.items() if n not in ("radiation", "film")])
def test_functions_on_arrays_are_the_laws(name: str) -> None:
    law, rng = LAWS[name], np.random.default_rng(3)
    z, made = drawn(law, rng), law.arrays()
    assert made is not None
    found, x = law(z, np.zeros((2, 5, 3)), 0.0), np.zeros((2, 15))
    flat = np.array([a.ravel() for a in z])
    y, slopes = np.zeros((len(law.tests), 15)), np.zeros((len(made.pairs), 15))
    made.function(made.numbers, np.zeros(0), flat, x, y, slopes)
    for got, want in zip(y, found.y, strict=True):
        np.testing.assert_allclose(got, want.ravel(), rtol=1e-12, atol=1e-12 * np.abs(y).max())
    assert {(int(i), int(j)) for i, j in made.pairs} == set(found.derivatives)
    for got, (i, j) in zip(slopes, made.pairs.tolist(), strict=True):
        want = np.broadcast_to(found.derivatives[i, j], (5, 3)).ravel()
        np.testing.assert_allclose(got, want, rtol=1e-10, atol=1e-12 * np.abs(slopes).max())
    values = y.copy()
    made.function(made.numbers, np.zeros(0), flat, x, values, np.zeros((0, 15)))
    np.testing.assert_array_equal(values, y)


CURVED = {"rho": 7850, "nu": 0.3,
          "E": {"temperatures": [250, 500, 1000], "values": [2.1e11, 1.8e11, 0.4e11]},
          "alpha": {"polynomial": [1.2e-5, 4e-9], "origin": 293.15, "range": [200, 1200]},
          "k": {"temperatures": [250, 1000], "values": [54, 27]},
          "c": {"polynomial": [440, 0.4], "origin": 293.15, "range": [200, 1200]}}


def body(d: int, **changes: Any) -> dict[str, Any]:
    plane = {"use": "rectangle", "size": [0.2, 0.1], "divisions": [3, 2]}
    solid = {"use": "block", "size": [0.2, 0.1, 0.1], "divisions": [2, 1, 1]}
    return {"use": "flexible", "fields": ["elastic", "thermal"], "frame": "fixed",
            "mesh": plane if d == 2 else solid, "material": CURVED,
            "reference": {"clamp": "left"}, "initial_temperature": "500 + 1000*x",
            **({"thickness": 0.02} if d == 2 else {}), **changes}


def hot(d: int, **changes: Any) -> Model:
    """A body with all properties dependent on temperature, prescribed on one side."""
    loads = {
        "glow": {"use": "radiation", "on": ["bar:top"], "emissivity": 0.6, "surroundings": 290.0},
        "air": {"use": "convection", "on": ["bar:right"], "temperature": 300.0,
                "film": {"temperatures": [290, 900], "values": [5, 25]}}}
    wave = {"use": "sine", "amplitude": 30.0, "frequency": 0.1, "offset": 600.0}
    return assemble(scene_of({
        "bodies": {"bar": body(d, **changes)}, "loads": loads,
        "joints": {"held": {"use": "prescribed_temperature", "on": ["bar:left"],
                            "temperature": wave}},
        "time": {"end": 1.0, "step": 0.1}}))


def terms(model: Model) -> Sequence[WeakTerm]:
    return [t for t in model.terms if isinstance(t, WeakTerm)]


@pytest.mark.full
@pytest.mark.parametrize(("d", "strains"), [
    (2, "linear"), (3, "linear"), (2, "nonlinear"),
    pytest.param(3, "nonlinear", marks=pytest.mark.full)])
def test_weak_terms_keep_the_laws_of_terms(d: int, strains: str) -> None:
    model = hot(d, strains=strains)
    found = terms(model)
    assert len(found) == (6 if strains == "linear" else 5)
    for i, term in enumerate(found):
        base = np.full(len(term.columns), 1e-3)
        base[term.columns >= model.layout.first.start] = 600.0
        check_term(term, np.random.default_rng(i), base=base, scale=1e-2, trials=2, rtol=1e-5,
                   same_rates=True)
    assert model.separated.other == ()


def states(term: Term, model: Model, rng: np.random.Generator) -> tuple[FloatArray, ...]:
    n = len(term.columns)
    warm = term.columns >= model.layout.first.start
    x = np.where(warm, 600.0 + 50.0 * rng.standard_normal(n), 1e-3 * rng.standard_normal(n))
    return x, rng.standard_normal(n)


@pytest.mark.parametrize(("d", "strains"), [(2, "linear"), (3, "linear"), (2, "nonlinear")])
def test_points_and_elements_give_the_same_projection(d: int, strains: str) -> None:
    """z = P c + o, r = L y, J = (L dy/dz) P against the projected element-wise evaluation."""
    model, rng = hot(d, strains=strains), np.random.default_rng(4)
    for term in terms(model):
        n, k = len(term.columns), 4
        x, v = states(term, model, rng)
        trial = Trial(1e-3 * rng.standard_normal((n, k)), x)
        left = rng.standard_normal((3, len(term.rows))) * (rng.random(len(term.rows)) < 0.5)
        points, elements = term.compress(trial, left), CompressedLocal.of(term, trial, left)
        c, c1 = rng.standard_normal((2, k)), rng.random(k)
        args = c[0], c[1], np.zeros(k), 0.3
        r, J = points.linearized(*args, c1, np.zeros(k))
        want, slope = elements.residual(*args), elements.jacobian(*args, c1, np.zeros(k))
        size = max(float(np.abs(want).max()), 1e-300)
        np.testing.assert_allclose(r, want, rtol=0, atol=1e-11 * size)
        np.testing.assert_array_equal(r, points.residual(*args))
        np.testing.assert_allclose(J, slope, rtol=0, atol=1e-11 * np.abs(slope).max())
        np.testing.assert_array_equal(J, points.jacobian(*args, c1, np.zeros(k)))
        assert points.elements == elements.elements


@pytest.mark.parametrize("d", [2, 3])
def test_contributions_add_up_and_weights_scale_them(d: int) -> None:
    model, rng = hot(d), np.random.default_rng(5)
    for term in terms(model):
        assert term.weighs_elements
        x, v = states(term, model, rng)
        left = rng.standard_normal((3, len(term.rows)))
        zero = np.zeros(len(x))
        shares = term.contributions(left, x[:, None], v[:, None], np.array([0.2]))
        whole = left @ term.residual(x, v, zero, 0.2)
        size = np.abs(left) @ np.abs(term.residual(x, v, zero, 0.2))
        np.testing.assert_allclose(shares.sum(axis=0)[:, 0], whole, rtol=0, atol=1e-10 * size.max())
        few = np.array([0, term.elements - 1])
        np.testing.assert_array_equal(
            term.contributions(left, x[:, None], v[:, None], np.array([0.2]), few), shares[few])
        w = rng.random(term.elements) * (rng.random(term.elements) < 0.5)
        some = term.weighted(w)
        assert some.elements == np.count_nonzero(w)
        at, there = np.searchsorted(term.rows, some.rows), np.searchsorted(
            term.columns, some.columns)
        r = some.residual(x[there], v[there], zero[there], 0.2)
        np.testing.assert_allclose(left[:, at] @ r, np.tensordot(w, shares[:, :, 0], 1),
                                   rtol=0, atol=1e-10 * size.max())
