"""Atoms for loads that move: attachment, impulse and weighted POD hold a full-order run."""

from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.sparse.linalg import splu

from moving_plate import error, full, given, mesh, plate, run
from sparsemor.core import Basis, BlockData, Dictionary
from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.protocols.load_tables import Table, path_rows
from sparsemor.core.testing import check_basis
from sparsemor.plugins.bases.attachment import Attachment
from sparsemor.plugins.bases.impulse import Impulse
from sparsemor.plugins.bases.load_patterns import patch_weights
from sparsemor.plugins.bases.modal import Modal
from sparsemor.plugins.bases.pod import Pod
from sparsemor.plugins.bases.union import Overcomplete
from sparsemor.reducers.block_counts import most_atoms


@pytest.mark.parametrize("basis", [
    Attachment(), Attachment(patches=3, dynamic=True),
    Attachment(thermal=Modal(count=4), dynamic=True, orthonormal=True),
    Attachment(thermal=Impulse(count=4)), Attachment(count=3, dynamic=True, thermal=Modal(count=4)),
    Impulse(), Impulse(positions=2, delays=(0, 3)), Impulse(count=3), Impulse(count=500),
    Pod(weights="inverse_sqrt_norm"),
    Pod(energy=0.9, centred=True, weights="inverse_sqrt_norm"),
], ids=repr)
def test_laws_with_every_option(basis: Basis) -> None:
    check_basis(basis, seed=1, trials=3)


def orthonormal(basis: Basis, data: BlockData) -> FloatArray:
    return Overcomplete(bases=[basis], orthonormal=True).build(data).atoms


# ------------------------------------------------------------------------ path and places


def test_the_ring_is_all_nodes_of_the_elements_that_touch_the_path() -> None:
    data, heat = plate()
    m = mesh()
    loaded = path_rows(heat.moving)
    assert 0 < len(loaded) < len(m.point_sets["top"]), "the contact leaves some of it out"
    touching = np.unique(m.cells[np.isin(m.cells, loaded).any(axis=1)])
    assert np.array_equal(heat.ring, touching)
    free = np.setdiff1d(np.arange(2 * len(m.points)), np.ravel(
        [2 * m.point_sets["bottom"], 2 * m.point_sets["bottom"] + 1]))
    both = np.ravel([2 * touching, 2 * touching + 1])
    assert np.array_equal(data.ring, np.flatnonzero(np.isin(free, both)))


def test_patches_share_the_path() -> None:
    rng = np.random.default_rng(0)
    order = rng.permutation(21)
    angle = np.linspace(0.0, 2.0, 21)[order]
    for places in (angle[:, None], np.stack([np.cos(angle), np.sin(angle)], axis=1)):
        w = patch_weights(places, 5)[np.argsort(order)]
        np.testing.assert_allclose(w.sum(axis=1), 1.0)
        if w[0, 0] < 0.5:
            w = w[:, ::-1]
        np.testing.assert_allclose(w[::5], np.eye(5), atol=1e-12)  # hats along the line
        np.testing.assert_allclose(w[2, :2], [0.6, 0.4], atol=1e-12)
    space = rng.random((40, 3))
    w = patch_weights(space, 6)
    assert w.shape == (40, 6) and set(np.unique(w)) == {0.0, 1.0} and (w.sum(axis=0) > 0).all()
    assert np.array_equal(patch_weights(space, 50), np.eye(40))


# ------------------------------------------------------------------------ attachment


def test_static_answers_to_any_load_on_the_path_are_held() -> None:
    data = plate()[0]
    d = Attachment().build(data)
    loaded = path_rows(data.moving)
    assert d.atoms.shape[1] == len(loaded)
    f = np.zeros(data.size)
    f[loaded] = np.random.default_rng(0).standard_normal(len(loaded))
    u = splu(data.stiffness.tocsc()).solve(f)
    c = np.linalg.lstsq(d.atoms, u, rcond=None)[0]
    assert np.linalg.norm(d.atoms @ c - u) < 1e-10 * np.linalg.norm(u)
    assert d.provenance[0].startswith("attachment sole, node ") and d.provenance[0][-1] in "xy"


@pytest.mark.full
@pytest.mark.parametrize("speed", [1.0, 0.8])
def test_attachment_follows_what_moves_without_training(speed: float) -> None:
    """Made from the path of the one run, used for the others, too: its thermoelastic part holds the
    temperatures, D^-1 copies the inertia."""
    data, (u, T) = plate()[0], full(speed)
    force = given(plate(speed)[0]) + np.asarray(data.coupling @ T).T
    thermal = Impulse(count=70)
    plain = run(data, force, orthonormal(Attachment(thermal=thermal), data))
    basis = Attachment(thermal=thermal, dynamic=True)
    both = run(data, force, orthonormal(basis, data))
    mechanical = run(data, force, orthonormal(Attachment(), data))
    assert error(both, u) < 8e-5 < error(plain, u) < 2e-3 < 1e-2 < error(mechanical, u)
    said = basis.build(data).provenance
    for start in ("attachment sole", "thermoelastic impulse mode", "dynamic attachment sole",
                  "dynamic thermoelastic impulse mode"):
        assert any(p.startswith(start) for p in said), start


def test_pooled_attachment_keeps_what_counts() -> None:
    """Orthonormal, and twice as many are several times better."""
    data, (u, T) = plate()[0], full()
    force = given(data) + np.asarray(data.coupling @ T).T
    errors = []
    for count in (30, 60):
        d = Attachment(thermal=Impulse(count=70), count=count).build(data)
        assert d.atoms.shape[1] == count and d.provenance[-1] == f"attachment mode {count - 1}"
        assert np.abs(d.atoms.T @ d.atoms - np.eye(count)).max() < 1e-11
        errors.append(error(run(data, force, d.atoms), u))
    assert errors[1] < 3e-2 and errors[1] < 0.3 * errors[0], errors
    assert most_atoms(Attachment(count=60), data.size) == 62


def test_an_insulated_block_gets_the_uniform_temperature() -> None:
    d = Attachment(dynamic=True).build(plate()[1])
    assert d.provenance[0] == "uniform"
    np.testing.assert_allclose(d.atoms[:, 0], len(d.offset) ** -0.5)


def test_thermal_snapshots_reach_the_thermal_basis() -> None:
    data, heat = plate()
    basis = Attachment(thermal=Pod(count=5))
    assert basis.needs_snapshots and not Attachment(thermal=Impulse()).needs_snapshots
    d = basis.build(replace(data, heat=replace(heat, snapshots=full()[1])))
    assert sum(p.startswith("thermoelastic pod") for p in d.provenance) == 5


# ------------------------------------------------------------------------ impulse


def test_all_delays_hold_every_run_exactly() -> None:
    """Heat that walks over the path, in short: all places, all delays."""
    heat = plate()[1]
    short = replace(heat, moving=tuple(replace(
        m, table=Table(m.table.times[:7], m.table.values[100:107])) for m in heat.moving))
    T = run(short, given(short), np.eye(heat.size))
    d = Impulse(delays=tuple(range(7))).build(short)
    c = np.linalg.lstsq(d.atoms, T, rcond=None)[0]
    assert np.linalg.norm(d.atoms @ c - T) < 1e-10 * np.linalg.norm(T)
    assert d.provenance[1].startswith("impulse sole, node ")
    assert d.provenance[1].endswith(", delay 0")


@pytest.mark.parametrize("speed", [1.0, 0.8])
def test_impulses_follow_heat_at_any_speed(speed: float) -> None:
    """Made from the path of the one run, used for the others, too."""
    T, found = full(speed)[1], plate()[1]
    errors = [error(run(found, given(plate(speed)[1]), Impulse(count=k).build(found).atoms), T)
              for k in (40, 80, 120)]
    assert errors[0] < 0.1 and errors[1] < 8e-3 and errors[2] < 5e-4, errors


def test_pooled_impulses_are_orthonormal_and_say_what_they_are_of() -> None:
    heat = plate()[1]
    d = Impulse(count=40).build(heat)
    assert d.atoms.shape[1] == 41 <= most_atoms(Impulse(count=40), heat.size)
    assert np.abs(d.atoms.T @ d.atoms - np.eye(41)).max() < 1e-11
    assert d.provenance[:2] == ("uniform", "impulse mode 0")
    assert d.info["delays"] == "0, 1, 2, 4, 8, 16, 32, 64, 128, 220"
    few = Impulse(positions=6, count=40).build(heat)
    assert few.info["positions"] == 6 and few.info["responses"] == 60


# ------------------------------------------------------------------------ weights


def startup(got: FloatArray, want: FloatArray) -> float:
    """Largest error of the first steps, over the solution's own norm then."""
    missed, size = (np.linalg.norm(a, axis=0)[1:6] for a in (got - want, want))
    return float((missed / size).max())


def test_weights_count_a_small_start_for_more() -> None:
    heat, T = plate()[1], full()[1]
    data = replace(heat, snapshots=T)
    errors = [startup(run(heat, given(heat), Pod(count=30, weights=w).build(data).atoms), T)
              for w in ("none", "inverse_sqrt_norm")]
    assert errors[1] < 0.5 * errors[0] and errors[0] > 1e-4, errors


# ------------------------------------------------------------------------ refusals


def test_what_cannot_be_built_is_refused_in_words() -> None:
    data, heat = plate()
    still = replace(data, moving=())
    with pytest.raises(InputError, match="no load moves over plate.elastic"):
        Attachment().build(still)
    with pytest.raises(InputError, match="no load moves over plate.thermal"):
        Impulse().build(replace(heat, moving=()))
    unknown = replace(heat, factors=(0.0, 0.0), step=0.0)
    with pytest.raises(InputError, match="the time step that plate.thermal is reduced for"):
        Impulse().build(unknown)
    with pytest.raises(InputError, match="attachment with dynamic: true: the time step"):
        Attachment(dynamic=True).build(unknown)
    assert isinstance(Attachment(thermal=Modal(count=2)).build(still), Dictionary)
    for options in ({"delays": [3, 1]}, {"delays": [-1]}, {"delays": []}, {"positions": 0}):
        with pytest.raises(ValidationError):
            Impulse.model_validate(options)
