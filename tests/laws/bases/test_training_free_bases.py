"""Eigenmodes, constraint modes and static responses are what they are called, to round-off."""

from dataclasses import replace
from functools import cache
from typing import Literal

import numpy as np
import pytest
from pydantic import ValidationError
from scipy import linalg
from scipy.sparse import csr_array

from sparsemor.core import BlockData, Dictionary, StepFactors
from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.model import Model
from sparsemor.core.scene.scene import load
from sparsemor.core.testing import check_basis
from sparsemor.core.testing.random_inputs import random_heat
from sparsemor.plugins.bases.modal import CraigBampton, Modal
from sparsemor.plugins.bases.pod import Pod
from sparsemor.plugins.bases.static import Static
from sparsemor.reducers.block_counts import most_atoms


@pytest.mark.parametrize("basis", [
    Modal(count=1), Modal(count=500), Modal(interface="fixed", correction=True),
    Modal(correction=True, start=False), CraigBampton(count=0),
    Static(rates=(0.0, 1.0, 100.0), orthonormal=True), Static(thermal=Modal(count=5)),
    Static(thermoelastic=False), Static(count=3)], ids=repr)
def test_laws_with_every_option(basis: Modal | CraigBampton | Static) -> None:
    check_basis(basis, seed=1, trials=3)


@cache
def pendulum(elements: int = 320) -> Model:
    return assemble(load("double_pendulum", {
        f"bodies.link{i}.mesh.elements": elements for i in (1, 2)}))


def link(name: str = "link1.elastic") -> BlockData:
    return pendulum().block_data(name)


def outside(x: FloatArray, dictionary: Dictionary) -> float:
    """Part of x (n,) or (n, j) that the atoms miss, worst column."""
    x = x.reshape(len(x), -1)
    rest = x - dictionary.atoms @ np.linalg.lstsq(dictionary.atoms, x, rcond=None)[0]
    return float((np.linalg.norm(rest, axis=0) / np.linalg.norm(x, axis=0)).max())


def test_block_data_names_what_loads_a_block() -> None:
    data, heat = link(), link("link2.thermal")
    assert data.load_names == (
        "inertia x", "inertia y", "inertia outward", "inertia around", "joint A x", "joint A y",
        "joint B x", "joint B y", "gravity x", "gravity y", "constant part")
    assert data.joints.tolist() == [4, 5, 6, 7] and heat.load_names == ("heating",)
    touched = np.flatnonzero(np.any(data.loads[:, data.joints] != 0.0, axis=1))
    assert np.array_equal(data.interface, touched)
    assert data.heat is not None and data.coupling is not None
    # the constant part holds the thermal forces of the reference temperature
    forces = data.coupling @ np.full(data.heat.size, 293.15)
    np.testing.assert_allclose(data.loads[:, -1], -forces, rtol=0, atol=1e-9 * abs(forces).max())
    weight, mass = data.loads[:, [8, 9]].sum(axis=0), data.mass.sum()
    assert weight.sum() == pytest.approx(mass, rel=0.02)  # but for the held displacements
    assert np.array_equal(heat.start, np.full(heat.size, 293.15))


@pytest.mark.parametrize("interface", ["free", "fixed"])
def test_modes_are_those_of_a_dense_solver(interface: Literal["free", "fixed"]) -> None:
    data = link()
    atoms = Modal(count=12, interface=interface).build(data).atoms
    P = data.loads[:, data.joints] if interface == "fixed" else np.zeros((data.size, 0))
    Z = linalg.null_space(P.T) if P.shape[1] else np.eye(data.size)
    values = linalg.eigvalsh(Z.T @ (data.stiffness @ Z), Z.T @ (data.mass @ Z))[:12]
    modal_mass = atoms.T @ (data.mass @ atoms)
    size = np.sqrt(np.diag(modal_mass))
    assert np.abs(modal_mass / np.outer(size, size) - np.eye(12)).max() < 1e-10
    rayleigh = np.diag(atoms.T @ (data.stiffness @ atoms)) / size**2
    np.testing.assert_allclose(rayleigh, values, rtol=1e-9)
    # lambda M x - K x is a joint force where the interface is fixed, and nothing where it is free
    rest = Z.T @ (data.stiffness @ atoms - data.mass @ atoms * values)
    assert np.linalg.norm(rest, axis=0).max() < 1e-8 * np.abs(data.stiffness @ atoms).max()
    if P.shape[1]:
        assert np.abs(P.T @ atoms).max() < 1e-12 * np.abs(P).max()


def test_thermal_modes_of_an_insulated_body_begin_with_the_uniform_one() -> None:
    data = link("link1.thermal")
    dictionary = Modal(count=4).build(data)
    assert dictionary.atoms.shape[1] == 4  # the start is uniform: the modes hold it
    np.testing.assert_allclose(dictionary.atoms[:, 0], data.size**-0.5, rtol=1e-9)
    slow = linalg.eigvalsh(data.stiffness.toarray(), data.mass.toarray())[1]
    shown = [float(v) for v in str(dictionary.info["decay_per_s"]).split(", ")]
    assert shown[0] < 1e-9 * slow and shown[1] == pytest.approx(slow, rel=1e-5)


@pytest.mark.parametrize("basis", [Static(), CraigBampton(count=0), Modal(correction=True)],
                         ids=repr)
def test_static_joint_forces_are_answered_exactly(basis: Static | CraigBampton | Modal) -> None:
    data = link()
    F = data.loads[:, data.joints] @ np.random.default_rng(0).standard_normal((4, 5))
    exact = linalg.solve(data.stiffness.toarray(), F)
    assert outside(exact, basis.build(data)) < 1e-8
    assert outside(exact, Modal(count=20).build(data)) > 1e-3  # modes alone do not do it


def test_static_responses_hold_every_load() -> None:
    data = link()
    dictionary = Static(thermoelastic=False).build(data)
    exact = linalg.solve(data.stiffness.toarray(), data.loads)
    assert outside(exact, dictionary) < 1e-9
    turned = Static(thermoelastic=False).build(replace(data, loads=-data.loads))
    assert np.array_equal(turned.atoms, dictionary.atoms)  # signs are those of the atoms
    # weight and inertia of the same direction are one response
    assert dictionary.info["dependent"] == "static gravity x, static gravity y"
    one = exact[:, 6] / np.linalg.norm(exact[:, 6])
    here = dictionary.atoms[:, dictionary.provenance.index("static joint B x")]
    assert abs(one @ here) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("count", [0, 3])
def test_fixed_modes_and_constraint_modes_are_orthogonal_in_energy(count: int) -> None:
    data = link()
    dictionary = CraigBampton(count=count).build(data)
    assert dictionary.provenance[count:] == tuple(
        f"constraint joint {j}" for j in ("A x", "A y", "B x", "B y"))
    energy = dictionary.atoms.T @ (data.stiffness @ dictionary.atoms)
    mixed = np.abs(energy[:count, count:]).max(initial=0.0)
    assert mixed < 1e-9 * np.abs(energy).max()
    assert np.linalg.matrix_rank(dictionary.atoms) == count + 4


def test_thermoelastic_responses_follow_the_temperatures() -> None:
    data = link()
    assert data.heat is not None and data.coupling is not None
    temperatures = Modal(count=6).build(data.heat).atoms
    exact = linalg.solve(data.stiffness.toarray(), data.coupling @ temperatures)
    dictionary = Static(thermal=Modal(count=6)).build(data)
    assert outside(exact, dictionary) < 1e-9
    assert "thermoelastic mode 5" in dictionary.provenance
    assert outside(exact, Static(thermoelastic=False).build(data)) > 1e-2


def test_insulated_heat_responses_are_what_constant_heat_tends_to() -> None:
    data = link("link1.thermal")
    f = data.loads[:, 0]
    dictionary = Static().build(data)
    assert dictionary.provenance == ("static uniform", "static heating")
    c = np.linalg.lstsq(dictionary.atoms, data.start, rcond=None)[0]
    np.testing.assert_allclose(dictionary.atoms @ c, data.start, rtol=1e-12)
    # T = T0 + t g 1 + r solves C T' + K T = f once transients are gone: K r = f - g C 1
    growth = f.sum() / data.mass.sum()
    r = dictionary.atoms[:, 1]
    left, right = data.stiffness @ r, f - growth * (data.mass @ np.ones(data.size))
    np.testing.assert_allclose(left / np.linalg.norm(left), right / np.linalg.norm(right),
                               rtol=0, atol=1e-9)


def test_rates_answer_the_first_step_of_implicit_euler() -> None:
    data = link("link1.thermal")
    first = linalg.solve((data.stiffness + 1e3 * data.mass).toarray(), data.loads)
    assert outside(first, Static(rates=(0.0, 1e3)).build(data)) < 1e-9
    assert outside(first, Static().build(data)) > 0.3
    assert "static heating at 1000/s" in Static(rates=(1e3,)).build(data).provenance


def test_a_number_of_rates_holds_for_any_heat_over_time() -> None:
    """Galerkin temperatures of the insulated, heated link in 400 steps of implicit Euler under
    pulses of random size and length, beside those of all unknowns: a decade closer with five rates
    more."""
    full = pendulum().block_data("link1.thermal", step=StepFactors(1e-2, 100.0, 1e4, 100.0))
    data = replace(full, start=np.zeros(full.size))
    rng = np.random.default_rng(3)
    heat = np.repeat(rng.uniform(-1.0, 1.0, 20), rng.multinomial(400, np.full(20, 0.05)))

    def temperatures(A: FloatArray) -> FloatArray:
        C, K = A.T @ (data.mass @ A), A.T @ (data.stiffness @ A)
        solve = linalg.lu_factor(K + 100.0 * C)
        f, x, X = A.T @ data.loads[:, 0], np.zeros(A.shape[1]), []
        for q in heat:
            x = linalg.lu_solve(solve, 100.0 * (C @ x) + q * f)
            X.append(A @ x)
        return np.array(X).T

    exact = temperatures(np.eye(data.size))
    errors = []
    for count in (6, 11, 16):
        dictionary = Static(rates=count, orthonormal=True).build(data)
        assert count <= dictionary.atoms.shape[1] <= count + 1  # and the uniform temperature
        difference = np.linalg.norm(temperatures(dictionary.atoms) - exact, axis=0).max()
        errors.append(difference / np.linalg.norm(exact, axis=0).max())
    assert errors[1] < 0.1 * errors[0] and errors[2] < 0.1 * errors[1] and errors[2] < 1e-4


def test_numbers_of_rates_are_from_the_slowest_response_to_the_step() -> None:
    data = pendulum().block_data("link1.thermal", step=StepFactors(1e-2, 100.0, 1e4, 100.0))
    names = Static(rates=5).build(data).provenance
    assert names[1] == "static heating"
    rates = [float(name.split(" at ")[1].removesuffix("/s")) for name in names[2:]]
    assert rates[-1] == pytest.approx(100.0)
    ratios = np.divide(rates[1:], rates[:-1])
    np.testing.assert_allclose(ratios, ratios[0], rtol=1e-4)
    decay, modes = linalg.eigh(data.stiffness.toarray(), data.mass.toarray())
    heated = np.abs(modes.T @ data.loads[:, 0])[1:]  # all but the uniform temperature
    slowest = decay[1:][heated > 0.1 * heated.max()][0]
    assert slowest < rates[0] < 2.0 * slowest
    assert Static(rates=1).build(data).provenance == Static().build(data).provenance
    with pytest.raises(InputError, match="time step that link1.thermal is reduced for is missing"):
        Static(rates=5).build(link("link1.thermal"))


def test_a_count_keeps_the_leading_directions_of_the_responses() -> None:
    data = link("link1.thermal")
    rates = (0.0, 1.0, 10.0, 100.0, 1000.0)
    whole = Static(rates=rates, orthonormal=True).build(data)
    few, all_of_them = (Static(rates=rates, count=count).build(data) for count in (2, 50))
    assert few.provenance == ("static uniform", "static mode 0", "static mode 1")
    assert np.abs(few.atoms.T @ few.atoms - np.eye(3)).max() < 1e-12
    assert outside(few.atoms, whole) < 1e-9 and outside(all_of_them.atoms, whole) < 1e-8
    responses = Static(rates=rates).build(data).atoms[:, 1:]
    rest = responses - few.atoms @ (few.atoms.T @ responses)
    u = few.atoms[:, :1]
    singular = np.linalg.svd(responses - u @ (u.T @ responses), compute_uv=False)
    assert np.linalg.norm(rest) == pytest.approx(np.linalg.norm(singular[2:]), rel=1e-9)


def test_a_start_that_modes_do_not_hold_is_added() -> None:
    data = random_heat(np.random.default_rng(1))
    with_start, without = (Modal(count=3, start=s).build(data) for s in (True, False))
    assert with_start.provenance == ("mode 0", "mode 1", "mode 2", "start")
    assert outside(data.start, with_start) < 1e-12 < outside(data.start, without)


def test_the_largest_dictionary_is_known_beforehand() -> None:
    """What preconditioners are refused by, before anything is trained."""
    for basis in (Modal(count=3), Modal(count=3, start=False), Modal(correction=True),
                  CraigBampton(count=3)):
        for name in ("link1.elastic", "link1.thermal"):
            data = link(name)
            if len(data.joints) or isinstance(basis, Modal):
                assert basis.build(data).atoms.shape[1] <= most_atoms(basis, data.size)
    assert most_atoms(Modal(count=3, start=False), 100) == 3
    assert most_atoms(Modal(count=3), 100) == 100


def without_loads(data: BlockData) -> BlockData:
    none = np.zeros(0, dtype=np.int64)
    return replace(data, loads=np.zeros((data.size, 0)), load_names=(), joints=none,
                   interface=none, start=np.zeros(data.size), heat=None, coupling=None)


@pytest.mark.parametrize("basis", [CraigBampton(), Modal(interface="fixed")], ids=repr)
def test_no_joint_no_interface(basis: CraigBampton | Modal) -> None:
    with pytest.raises(InputError, match="no joint acts on the unknowns of link1.thermal"):
        basis.build(link("link1.thermal"))


def test_what_cannot_be_built_is_refused_in_words() -> None:
    rigid_copy = without_loads(link())
    with pytest.raises(InputError, match="no load, joint or temperature acts on link1.elastic"):
        Static().build(rigid_copy)
    loose = rigid_copy.stiffness.tolil()
    loose[7, :] = 0.0
    loose[:, 7] = 0.0
    moving = replace(link(), stiffness=csr_array(loose))
    with pytest.raises(InputError, match="stiffness of link1.elastic is singular"):
        Static().build(moving)
    with pytest.raises(InputError, match="`thermal` names a basis that needs snapshots"):
        Static(thermal=Pod()).build(link())
    with pytest.raises(ValidationError):
        Static.model_validate({"rates": []})
    with pytest.raises(ValidationError):
        Static.model_validate({"rates": [-1.0]})
    with pytest.raises(ValidationError):
        Static.model_validate({"rates": 0})
