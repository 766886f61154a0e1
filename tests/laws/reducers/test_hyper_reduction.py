"""DEIM, GNAT and LSPG: what their maps are, where they agree with Galerkin, how they fail."""

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
import pytest

from reduced_runs import decoded
from small_scenes import everything
from sparsemor.core import Basis, BlockData, Dictionary
from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.equations import system_residual
from sparsemor.core.model.model import Model
from sparsemor.core.scene.scene import Scene, load
from sparsemor.core.simulation.offline import Offline
from sparsemor.core.status import SolveFailed, Status
from sparsemor.core.testing.in_memory_run import March, march
from sparsemor.plugins.bases.pod import Pod
from sparsemor.reducers.projection.deim import Deim
from sparsemor.reducers.projection.galerkin import Galerkin
from sparsemor.reducers.projection.least_squares import Gnat
from sparsemor.reducers.projection.operators_and_test_maps import LinearOperators, Reducible
from sparsemor.reducers.projection.projection_reducer import ProjectionReducer

METHODS: dict[str, dict[str, Any]] = {
    "deim": {"use": "deim"}, "lspg": {"use": "lspg", "norm": "rows"},
    "gnat": {"use": "gnat", "norm": "rows"}, "gnat, energy": {"use": "gnat"},
    "lspg, energy": {"use": "lspg"}}
SAMPLED: dict[str, dict[str, Any]] = {
    "galerkin": {"use": "galerkin"},
    # every row that a joint or load touches is kept; a few more of the elastic ones
    "sparse": {"use": "sparse", "budgets": {"*.elastic": {"rows": 8}, "*.thermal": {"rows": 0}}}}
FEW = {"use": "pod", "count": 6}


def pendulum(reducer: Any = "full", **changes: Any) -> Scene:
    return load("double_pendulum", {
        "bodies.link1.capacity": "consistent", "bodies.link2.capacity": "consistent",
        "bodies.link1.mesh.elements": 320, "bodies.link2.mesh.elements": 320, "time.end": 0.15,
        "training.end": 0.15, "reducer": reducer, **changes})


@cache
def pendulum_model() -> Model:
    return assemble(pendulum())


@cache
def trained(name: str) -> tuple[Scene, March, Mapping[str, FloatArray]]:
    """A scene, its full-order run, and that run's snapshots (n, M) by block."""
    scene = everything() if name == "everything" else pendulum()
    full = march(scene, model=None if name == "everything" else pendulum_model())
    return scene, full, {n: full.block(n).T for n in full.model.reducible()}


KNOWN: dict[str, March] = {}


def repeated(name: str, reducer: Any, seed: int = 1) -> March:
    """The trained run again, reduced; each once."""
    scene, full, snapshots = trained(name)
    key = f"{name} {reducer} {seed}"
    if key not in KNOWN:
        KNOWN[key] = march(scene.using({"reducer": reducer, "seed": seed}), model=full.model,
                           snapshots=snapshots)
    return KNOWN[key]


def errors(run: March, reference: March) -> dict[str, float]:
    """By field: largest difference over the reference's largest change (angles: over 1 rad)."""
    found: dict[str, float] = {}
    for b in run.model.layout:
        if b.field == "multiplier":
            continue
        want = decoded(reference, b.name)
        size = 1.0 if b.field == "rigid" else np.linalg.norm(want - want[0], axis=1).max()
        error = np.linalg.norm(decoded(run, b.name) - want, axis=1).max() / size
        found[b.field] = max(found.get(b.field, 0.0), float(error))
    return found


def blocks(name: str) -> dict[str, Reducible]:
    """All reducible blocks of a trained scene, as `ProjectionReducer.maps` gets them."""
    scene, full, snapshots = trained(name)
    model, h = full.model, scene.time.step
    factors = scene.integrator.rules(h).factors
    sources = {b.thermal: b for b in model.separated.heat} | {
        m.elastic: m for m in model.separated.moving if m.operators is not None}
    offline, rng = Offline.from_snapshots(model, snapshots), np.random.default_rng(0)
    basis = Galerkin.model_validate({}).basis
    return {n: Reducible(
        n, offline.dictionary(n, basis)[0], LinearOperators.of(source, *factors), model, offline,
        scene.integrator, h, rng) for n, source in sources.items()}


class Doubled(Basis):
    """The first four POD atoms; `again`: the first of them twice."""

    again: bool = True

    @property
    def needs_snapshots(self) -> bool:
        return True

    def build(self, data: BlockData) -> Dictionary:
        d = Pod(count=4).build(data)
        kept = [0, 1, 2, 0, 3] if self.again else [0, 1, 2, 3]
        return Dictionary(d.atoms[:, kept], d.offset, tuple("abcde"[: len(kept)]))


@pytest.mark.full
def test_with_enough_points_the_pendulum_moves_as_under_galerkin() -> None:
    """Default options; 1e-8 is asked of deim."""
    full, galerkin = trained("pendulum")[1], repeated("pendulum", "galerkin")
    run = repeated("pendulum", METHODS["deim"])
    assert max(errors(galerkin, full).values()) < 1e-10
    assert set(errors(run, galerkin)) == {"rigid", "elastic", "thermal"}
    assert max(errors(run, galerkin).values()) < 2e-9
    assert max(errors(run, full).values()) < 2e-9


@pytest.mark.full
@pytest.mark.parametrize("method,centred", [
    ("galerkin", True), ("sparse", False), ("sparse", True), ("deim", True), ("lspg", True),
    ("gnat", False), ("gnat, energy", True)])
def test_every_body_joint_and_load_is_given_back(method: str, centred: bool) -> None:
    """Radiation, fixed frames and given temperatures survive trial and test maps, also where
    displacements are counted from the mean of the training run."""
    reducer = {**(METHODS | SAMPLED)[method], "basis": {"use": "pod", "centred": centred}}
    run, full = repeated("everything", reducer), trained("everything")[1]
    found = errors(run, full)
    assert found["rigid"] < 1e-11 and found["elastic"] < 1e-8 and found["thermal"] < 1e-9
    bounds = {"rigid": 1e-11, "elastic": 1e-8, "thermal": 1e-11, "multiplier": 1e-7}
    for b in full.model.layout if method in SAMPLED else ():
        want = full.block(b.name)
        error = np.abs(decoded(run, b.name) - want)[1:].max() / np.abs(want).max()
        assert error < bounds[b.field], b.name


@pytest.mark.full
@pytest.mark.parametrize("norm", ["rows", "energy"])
def test_gnat_that_sees_all_rows_is_lspg_or_galerkin(norm: str) -> None:
    """Both are the same least squares then; only the norm decides."""
    sizes = {n: b.size for n, b in blocks("pendulum").items()}
    lspg, galerkin = ({**use, "basis": FEW} for use in (METHODS["lspg"], {"use": "galerkin"}))
    seen = repeated("pendulum", {"use": "gnat", "norm": norm, "points": sizes, "basis": FEW})
    same, other = (galerkin, lspg) if norm == "energy" else (lspg, galerkin)
    found = errors(seen, repeated("pendulum", same))
    # in the energy norm what the modes leave of the residual counts, too
    assert max(found.values()) < (1e-6 if norm == "energy" else 1e-9)
    assert errors(seen, repeated("pendulum", other))["elastic"] > 1e-5


@pytest.mark.full
@pytest.mark.parametrize("method", ["deim", "gnat, energy", "lspg, energy"])
def test_few_atoms_cost_no_more_than_under_galerkin(method: str) -> None:
    """Six atoms leave a residual, and the plain norm of its rows costs some accuracy."""
    full = trained("pendulum")[1]
    exact, plain, run = (errors(repeated("pendulum", {**use, "basis": FEW}), full)["elastic"]
                         for use in ({"use": "galerkin"}, METHODS["gnat"], METHODS[method]))
    assert run < 1.5 * exact and plain > 3.0 * exact


def rows_at(run: March, step: int) -> FloatArray:
    """Residual of the full-order equations at a decoded state of a reduced run."""
    model = run.model
    full = np.zeros((3, model.layout.size))
    for b in model.layout:
        d = run.solver.dictionaries.get(b.name)
        here, there = run.solver.layout[b.name], model.layout[b.name]
        for i, series in enumerate((run.x, run.v, run.a)):
            c = series[step, here]
            full[i, there] = c if d is None else d.atoms @ c + (d.offset if i == 0 else 0.0)
    return system_residual(model.layout, model.terms, *full, float(run.t[step]))


@pytest.mark.full
def test_lspg_leaves_a_residual_at_right_angles_to_its_images() -> None:
    """The plain norm of all rows of a block cannot be lowered by any change of coefficients."""
    run = repeated("pendulum", {**METHODS["lspg"], "basis": FEW})
    r = rows_at(run, 100)
    for name, block in blocks("pendulum").items():
        B = block.linear.operator @ run.solver.dictionaries[name].atoms
        own = r[run.model.layout[name]]
        slope = B.T @ own / np.linalg.norm(B, axis=0)
        part = np.linalg.norm(block.linear.stiffness @ decoded(run, name)[100])
        assert np.linalg.norm(own) > 1e-9 * part, name  # there is something to be minimised
        assert np.abs(slope).max() < 1e-3 * np.linalg.norm(own), name


@pytest.mark.full
def test_deim_projects_what_is_linear_and_interpolates_the_rest() -> None:
    """atoms^T (K x + D v + M a) + atoms^T U (P^T U)^+ P^T rest = 0, from the full-order terms."""
    options = {"use": "deim", "basis": FEW, "force_basis": {"use": "pod", "count": 4}}
    run, step = repeated("pendulum", options), 100
    reducer, r = Deim.model_validate({k: v for k, v in options.items() if k != "use"}), rows_at(
        run, step)
    for name, block in blocks("pendulum").items():
        d, here = run.solver.dictionaries[name], run.solver.layout[name]
        x, v, a = (d.atoms @ s[step, here] for s in (run.x, run.v, run.a))
        linear = block.linear.force(x + d.offset, v, a)
        rest = r[run.model.layout[name]] - linear
        maps = reducer.maps(Reducible(**{**fields(block), "dictionary": d}))
        projected, interpolated = maps.test(linear), maps.forces(rest)
        assert np.abs(projected + interpolated).max() < 1e-8 * np.abs(projected).max(), name
        np.testing.assert_allclose(projected, d.atoms.T @ linear)
        np.testing.assert_array_equal(maps.rows, run.solver.rows[name])


def fields(block: Reducible) -> dict[str, Any]:
    return {name: getattr(block, name) for name in Reducible.__dataclass_fields__}


@pytest.mark.full
@pytest.mark.parametrize("method", ["deim", "gnat"])
def test_only_elements_at_the_points_are_visited(method: str) -> None:
    run = repeated("everything", {"use": method, "oversampling": 1.0})
    whole = repeated("everything", "galerkin")
    fewer = 0
    for body in run.model.separated.heat:
        start, points = run.model.layout[body.thermal].start, run.solver.rows[body.thermal]
        want = sum(t.restrict(np.flatnonzero(np.isin(t.rows - start, points))).elements
                   for t in body.local)
        seen = run.solver.elements_touched[body.thermal]
        assert seen == want <= 2 * len(points)
        fewer += seen < whole.solver.elements_touched[body.thermal]
    assert fewer >= 2


@pytest.mark.full
def test_lspg_visits_all_elements() -> None:
    run, whole = repeated("everything", "lspg"), repeated("everything", "galerkin")
    assert run.solver.elements_touched == whole.solver.elements_touched
    assert max(run.solver.elements_touched.values()) == 10


@pytest.mark.parametrize("options,key,words", [
    ({"points": {"*.elastic": 5}, "force_basis": {"use": "pod", "count": 9}}, "points",
     "5 points cannot determine 9 modes"),
    ({"points": {"*.thermal": 10**6}}, "points", "1000000 points were requested of link1.thermal"),
    ({"points": {"*.rigidd": 5}}, "points.*.rigidd", "fits no block"),
    ({"force_bases": {"link3.*": "pod"}}, "force_bases.link3.*", "fits no block"),
])
@pytest.mark.parametrize("reducer", [Deim, Gnat])
def test_refused_by_counting(
    reducer: type[ProjectionReducer], options: dict[str, Any], key: str, words: str
) -> None:
    model = pendulum_model()
    assert not reducer.model_validate({}).check(model)
    faults = reducer.model_validate(options).check(model)
    assert {f.key for f in faults} == {key}
    assert words in faults[0].message


@pytest.mark.full
@pytest.mark.parametrize("method", ["deim", "gnat"])
def test_fewer_points_than_modes_are_refused_once_these_are_known(method: str) -> None:
    with pytest.raises(InputError, match=r"link\d.elastic: 3 points cannot determine \d+ modes"):
        repeated("pendulum", {"use": method, "points": {"*.elastic": 3}})


@pytest.mark.full
def test_force_modes_counted_from_a_mean_are_refused() -> None:
    with pytest.raises(InputError, match="take centred: false"):
        repeated("pendulum", {"use": "deim", "force_basis": {"use": "pod", "centred": True}})


@pytest.mark.full
def test_points_that_see_nothing_are_named() -> None:
    """One random row a link misses the heated edge, where the only thermal mode lives."""
    with pytest.raises(SolveFailed) as caught:
        repeated("pendulum", {"use": "deim", "sampler": "random", "points": {"*.thermal": 1}})
    assert caught.value.status is Status.RANK_DEFICIENT
    assert caught.value.block in ("link1.thermal", "link2.thermal")
    assert "do not distinguish its 1 modes" in caught.value.detail


@pytest.mark.full
def test_points_without_a_load_say_so() -> None:
    options = {"use": "deim", "points": {"*.thermal": 1}, "sampler": {"use": "deim"}}
    assert repeated("pendulum", options).solver.notes == ()
    block = blocks("pendulum")["link1.thermal"]
    away = np.flatnonzero(~np.isin(np.arange(block.size), block.model.required[block.name]))[:3]
    (note,) = Deim.model_validate({}).notes(
        block, away, np.zeros((block.size, 0)), np.zeros((0, len(away))))
    assert "one that heating acts on" in note.text and "required: true" in note.text


@pytest.mark.full
@pytest.mark.parametrize("reducer", ["galerkin", "lspg", "gnat", "deim"])
def test_dependent_atoms_are_replaced_by_their_span(reducer: str) -> None:
    twice, once = (repeated("pendulum", {
        "use": reducer, "bases": {"link2.elastic": Doubled(again=again)}})
        for again in (True, False))
    (note,) = [n for n in twice.solver.notes if n.kind == "span"]
    assert "the 5 atoms of its basis depend on each other, so that 4 orthonormal" in note.text
    assert not [n for n in once.solver.notes if n.kind == "span"]
    u, want = (r.x[:, r.solver.layout["link1.rigid"]] for r in (twice, once))
    np.testing.assert_allclose(u, want, atol=1e-9)
