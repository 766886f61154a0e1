"""Nonlinear strains on few atoms as a polynomial of their coefficients, against the sum over
elements; runs of such models visit none."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor import load_model, reduce, simulate
from sparsemor.bodies.terms.polynomial_term import PolynomialTerm
from sparsemor.bodies.terms.weak_term import WeakTerm
from sparsemor.core import Trial
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.compressed_local import CompressedLocal
from sparsemor.core.scene.scene import Scene
from sparsemor.core.testing import check_term
from sparsemor.core.testing.in_memory_run import scene_of
from tiers import full

STEEL = {"rho": 7850, "E": 2e11, "nu": 0.3, "alpha": 1.2e-5, "k": 40.0, "c": 450.0}


def scene(d: int, order: int, hot: bool, n: int = 4, **more: Any) -> Scene:
    """A bar held at its left side and bent by a force, cold or heated from there."""
    mesh = {"use": "rectangle", "size": [0.4, 0.1], "divisions": [2 * n, 1]} if d == 2 else {
        "use": "block", "size": [0.4, 0.1, 0.1], "divisions": [n, 1, 1]}
    held = {"held": {"use": "prescribed_temperature", "on": ["bar:left"], "temperature": {
        "use": "sine", "amplitude": 30.0, "frequency": 0.1, "offset": 400.0}}} if hot else {}
    return scene_of({
        "bodies": {"bar": {
            "use": "flexible", "fields": ["elastic", *(["thermal"] if hot else [])],
            "frame": "fixed", "mesh": mesh, "order": order, "material": STEEL,
            "strains": "nonlinear", "reference": {"clamp": "left"},
            **({"thickness": 0.02} if d == 2 else {"capacity": "consistent"}),
            **({"capacity": "consistent"} if hot and order == 2 else {})}},
        "joints": held, "loads": {"f": {
            "use": "traction", "on": ["bar:right"], "traction": [0.0, 3e7, 1e7][:d],
            "factor": {"use": "smooth_step", "end": 0.01, "final": 1.0}}},
        "integrator": {"use": "generalized_alpha", "rho_inf": 0.8},
        "time": {"end": 0.01, "step": 5e-4}, "probes": {"end": {"body": "bar", "at": "right"}},
        **more})


@pytest.mark.parametrize(("d", "order", "hot"), [
    (2, 1, True), full(2, 2, False), full(2, 2, True), full(3, 1, False), full(3, 2, True)])
def test_the_polynomial_is_the_sum_over_elements(d: int, order: int, hot: bool) -> None:
    """Force and tangent, with and without an offset of the atoms, under any test basis, and as a
    law on arrays."""
    model, rng = assemble(scene(d, order, hot, n=24)), np.random.default_rng(d)
    term, = (t for t in model.terms if isinstance(t, WeakTerm))
    n, warm = len(term.columns), term.columns >= model.layout.first.start
    assert warm.any() == hot
    for moved in (0.0, 1e-3):
        atoms = np.zeros((n, 5))
        atoms[~warm, :3] = 1e-3 * rng.standard_normal((int((~warm).sum()), 3))
        atoms[warm, 3:] = 20.0 * rng.standard_normal((int(warm.sum()), 2))
        offset = np.where(warm, 350.0, moved * rng.standard_normal(n))
        trial, left = Trial(atoms, offset), rng.standard_normal((2, len(term.rows)))
        made, sums = term.compress(trial, left), CompressedLocal.of(term, trial, left)
        assert isinstance(made, PolynomialTerm)
        assert (made.elements, sums.elements) == (0, term.elements)
        x, zero = rng.standard_normal(5), np.zeros(5)
        want, slope = sums.residual(x, zero, zero, 0.3), sums.jacobian(
            x, zero, zero, 0.3, zero, zero)
        r, J = made.linearized(x, zero, zero, 0.3, zero, zero)
        np.testing.assert_allclose(r, want, rtol=0, atol=1e-10 * np.abs(want).max())
        np.testing.assert_allclose(J, slope, rtol=0, atol=1e-10 * np.abs(slope).max())
    base = np.where(warm, 350.0, 0.0)
    check_term(term, rng, base=base, scale=1e-3, trials=1, rtol=1e-5, same_rates=True)


@pytest.mark.full
@pytest.mark.parametrize(("d", "hot"), [(2, False), (3, False), (2, True)])
def test_a_reduced_run_visits_no_element(d: int, hot: bool, tmp_path: Path) -> None:
    """Galerkin with four atoms repeats its training, also with another load from a file."""
    galerkin = {"use": "galerkin", "basis": {"use": "pod", "count": 4}}
    of = scene(d, 2, hot, n=8, reducer=galerkin)
    full, run = simulate(of.using({"reducer": "full"})), simulate(of)
    assert sum(run.summary["elements_touched"].values()) == 0
    size = np.abs(full.probe("end")[-1, :2] - full.probe("end")[0, :2]).max()
    assert np.abs(run.probe("end") - full.probe("end"))[:, :2].max() < 2e-3 * size
    model, change = reduce(of), {"loads.f.factor.final": 0.8}
    model.save(tmp_path / "bar.model")
    kept = load_model(tmp_path / "bar.model").run(change)
    np.testing.assert_allclose(kept.probe("end"), model.run(change).probe("end"), rtol=0,
                               atol=1e-10)
