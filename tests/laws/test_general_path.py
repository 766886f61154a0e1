"""Steps with a term between bodies: full order and reduced models, solved as a whole."""

import pickle
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.sparse import csr_array

from sparsemor.bodies.body_part import PlanarBody
from sparsemor.bodies.local import CompressedLocal
from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.assemble import assemble
from sparsemor.core.errors import InputError
from sparsemor.core.initial import consistent_state
from sparsemor.core.layout import Layout
from sparsemor.core.model import Model
from sparsemor.core.offline import Offline
from sparsemor.core.protocols import StepSolver, Term, Trial
from sparsemor.core.scene import Scene, load
from sparsemor.core.stability.differences import step_map
from sparsemor.core.testing.run import March, march, scene_of
from sparsemor.core.testing.term import check_term
from sparsemor.reducers.general import GeneralStepper
from sparsemor.reducers.reduced_general import ReducedGeneral

PLACES = 12
"""Unknowns of a pair: two frames (R_x, R_y, theta), two displacements each, two temperatures."""


@dataclass(frozen=True, slots=True, eq=False)
class Springs:
    """Force (k + k3 |d|^2) d + c d' on d = r_1 - r_2, heat h (T_1 - T_2)(1 + b (T_1 - T_2)).

    X (P, 4): body-frame positions of the pairs' ends; row_of, column_of (P, 12): their places in
    rows and columns, -1 for none.
    """

    rows: IntArray
    columns: IntArray
    X: FloatArray
    row_of: IntArray
    column_of: IntArray
    stiffness: tuple[float, float]
    damping: float
    film: tuple[float, float]
    source: str = "springs"

    @classmethod
    def between(
        cls, layout: Layout, first: PlanarBody, second: PlanarBody,
        nodes: tuple[IntArray, IntArray],
        stiffness: tuple[float, float] = (2e3, 5e5), damping: float = 3.0,
        film: tuple[float, float] = (5.0, 0.02),
    ) -> "Springs":
        """Pairs of nodes of two bodies with the same fields."""
        places, X = [], []
        for body, at in zip((first, second), nodes, strict=True):
            rigid, elastic, thermal = (_numbers(layout, f"{body.name}.{f}") for f in (
                "rigid", "elastic", "thermal"))
            u = np.full(2 * len(body.X), -1)
            T = np.full(len(body.X), -1)
            if body.elasticity is not None:
                u[body.elasticity.free] = elastic
            if body.heat is not None:
                T[body.heat.free] = thermal
            frame = rigid if len(rigid) else np.full(3, -1)
            places.append((np.tile(frame, (len(at), 1)), u.reshape(-1, 2)[at], T[at][:, None]))
            X += [body.X[at].real, body.X[at].imag]
        (q1, u1, T1), (q2, u2, T2) = places
        at = np.concatenate([q1, q2, u1, u2, T1, T2], axis=1)
        numbers = np.unique(at[at >= 0])
        local = np.where(at >= 0, np.searchsorted(numbers, at), -1)
        return cls(numbers, numbers, np.stack(X, axis=1), local, local, stiffness, damping, film)

    @property
    def elements(self) -> int:
        return len(self.X)

    def _local(self, q: Any, w: Any) -> Any:
        """(P, 12) rows of each pair from its unknowns q and rates w, real or complex (P, 12)."""
        ends, rates, turns = [], [], []
        for k, (frame, u) in enumerate(((0, 6), (3, 8))):
            c, s = np.cos(q[:, frame + 2]), np.sin(q[:, frame + 2])
            zx, zy = (self.X[:, 2 * k + i] + q[:, u + i] for i in range(2))
            rx, ry = c * zx - s * zy, s * zx + c * zy
            ux, uy = w[:, u], w[:, u + 1]
            turn = w[:, frame + 2]
            ends.append((q[:, frame] + rx, q[:, frame + 1] + ry))
            rates.append((w[:, frame] + c * ux - s * uy - turn * ry,
                          w[:, frame + 1] + s * ux + c * uy + turn * rx))
            turns.append((c, s, rx, ry))
        dx, dy = (ends[0][i] - ends[1][i] for i in range(2))
        k = self.stiffness[0] + self.stiffness[1] * (dx * dx + dy * dy)
        fx = k * dx + self.damping * (rates[0][0] - rates[1][0])
        fy = k * dy + self.damping * (rates[0][1] - rates[1][1])
        dT = q[:, 10] - q[:, 11]
        heat = self.film[0] * dT * (1.0 + self.film[1] * dT)
        out = np.zeros_like(q)
        for sign, frame, u, (c, s, rx, ry) in ((1, 0, 6, turns[0]), (-1, 3, 8, turns[1])):
            out[:, frame], out[:, frame + 1] = sign * fx, sign * fy
            out[:, frame + 2] = sign * (rx * fy - ry * fx)
            out[:, u], out[:, u + 1] = sign * (c * fx + s * fy), sign * (c * fy - s * fx)
        out[:, 10], out[:, 11] = heat, -heat
        return out

    def _gathered(self, x: FloatArray) -> FloatArray:
        padded = np.append(x, 0.0)
        return np.asarray(padded[self.column_of])

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        local = self._local(self._gathered(x), self._gathered(v))
        keep = self.row_of >= 0
        return np.bincount(
            self.row_of[keep], local[keep], minlength=len(self.rows)).astype(np.float64)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Csr:
        q, w, c = (self._gathered(z) for z in (x, v, c1))
        J, tiny = np.zeros((len(q), PLACES, PLACES)), 1e-30
        for j in range(PLACES):  # complex steps: exact to rounding
            dq, dw = q.astype(complex), w.astype(complex)
            dq[:, j] += 1j * tiny
            dw[:, j] += 1j * tiny * c[:, j]
            J[:, :, j] = self._local(dq, dw).imag / tiny
        i, j = np.broadcast_arrays(self.row_of[:, :, None], self.column_of[:, None, :])
        keep = (i >= 0) & (j >= 0)
        return csr_array((J[keep], (i[keep], j[keep])), shape=(len(self.rows), len(self.columns)))

    def restrict(self, keep: IntArray) -> "Springs":
        new = np.full(len(self.rows) + 1, -1)
        new[keep] = np.arange(len(keep))
        rows = new[self.row_of]
        near = (rows >= 0).any(axis=1)
        at = self.column_of[near]
        used = np.unique(at[at >= 0])
        return replace(
            self, rows=self.rows[keep], columns=self.columns[used], X=self.X[near],
            row_of=rows[near], column_of=np.where(at >= 0, np.searchsorted(used, at), -1))

    def compress(self, trial: Trial, left: FloatArray) -> CompressedLocal:
        return CompressedLocal.of(self, trial, left)


def _numbers(layout: Layout, name: str) -> IntArray:
    return np.arange(layout.size)[layout[name]] if name in layout else np.zeros(0, np.int64)


EVERYTHING = load(Path(__file__).parents[1] / "scenes" / "everything.yaml", {"time.end": 0.016})


def bars(divisions: tuple[int, int] = (8, 2), **changes: Any) -> Scene:
    """Two heated bars, end to end, each on a pin at its far end."""
    bodies = {}
    for name, x, reference in (("one", 0.0, 300.0), ("two", 0.55, 280.0)):
        bodies[name] = {
            "use": "flexible", "thickness": 0.02, "fields": ["elastic", "thermal"],
            "material": {"E": 7e8, "nu": 0.3, "rho": 2700, "alpha": 2e-5, "k": 1500, "c": 90},
            "mesh": {"use": "rectangle", "lower": [0.0, -0.05], "size": [0.5, 0.1],
                     "divisions": list(divisions)},
            "reference": {"chord": ["bottom_left", "bottom_right"]},
            "reference_temperature": reference, "pose": {"position": [x, 0.0]}}
    return scene_of({
        "bodies": bodies,
        "joints": {"a": {"use": "revolute", "between": ["ground", "one:left"]},
                   "b": {"use": "revolute", "between": ["ground", "two:right"]}},
        "loads": {"gravity": {"use": "gravity", "g": [0.0, -9.81]}},
        "time": {"end": 0.03, "step": 1e-3}, **changes})


def coupled(scene: Scene) -> Model:
    """Three springs and heat links between the facing ends' lower, middle and upper points."""
    model = assemble(scene)
    one, two = (model.parts[n] for n in ("one", "two"))
    right, left = one.points["right"], two.points["left"]  # type: ignore[attr-defined]
    some = np.linspace(0, len(right) - 1, 3).astype(int)
    term = Springs.between(model.layout, one, two, (right[some], left[some]))  # type: ignore[arg-type]
    return with_other(model, term)


def with_other(model: Model, term: Term) -> Model:
    """As assembly does with a term that no body claims."""
    required = {}
    for name, rows in model.required.items():
        at = model.layout[name]
        here = term.rows[(term.rows >= at.start) & (term.rows < at.stop)] - at.start
        required[name] = np.union1d(rows, here)
    return replace(model, terms=(*model.terms, term), required=required,
                   separated=replace(model.separated, other=(term,)))


def nowhere() -> IntArray:
    return np.zeros(0, np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class Nothing:
    """A term without rows: it only asks for the general path."""

    rows: IntArray = field(default_factory=nowhere)
    columns: IntArray = field(default_factory=nowhere)
    elements: int = 0

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        return np.zeros(0)

    def jacobian(self, *args: Any) -> FloatArray:
        return np.zeros((0, 0))

    def restrict(self, keep: IntArray) -> "Nothing":
        return self

    def compress(self, trial: Any, left: FloatArray) -> "Nothing":
        return self


def decoded(run: March, name: str) -> FloatArray:
    x, maps = run.block(name), run.solver.dictionaries
    return x if name not in maps else np.asarray(maps[name].offset + x @ maps[name].atoms.T)


def errors(run: March, reference: March) -> dict[str, float]:
    """Largest difference of each block after the start, relative to its largest value."""
    return {b.name: float(np.abs(decoded(run, b.name) - reference.block(b.name))[1:].max()
                          / np.abs(reference.block(b.name)).max()) for b in reference.model.layout}


def whole(model: Model) -> dict[str, FloatArray]:
    """Snapshots whose POD spans each block completely."""
    rng = np.random.default_rng(0)
    sizes = {n: model.layout[n].stop - model.layout[n].start for n in model.reducible()}
    return {n: np.linalg.qr(rng.standard_normal((k, k)))[0] for n, k in sizes.items()}


def learnt(run: March) -> dict[str, FloatArray]:
    return {n: run.block(n).T for n in run.model.reducible()}


# --------------------------------------------------------------------------- the same equations


def test_the_springs_are_a_term() -> None:
    """The law kit, where rates of both orders differ as well as where they agree."""
    model = coupled(bars())
    term = model.separated.other[0]
    base = model.x0[term.columns]
    check_term(term, np.random.default_rng(1), base, scale=0.01, trials=2, same_rates=True)


@cache
def everything() -> March:
    return march(EVERYTHING)


ROWS = {"*.elastic": {"rows": 8}, "*.thermal": {"rows": 0}}
SCALED = {"use": "sparse", "budgets": ROWS, "preconditioner": "row_scaling"}
INVERSE = {"use": "sparse", "budgets": ROWS, "residual": {"*.elastic": "preconditioned"}}


@pytest.mark.parametrize("options", [
    {"use": "galerkin"}, {"use": "deim"}, {"use": "gnat"}, {"use": "lspg"}, {"use": "ecsw"},
    {"use": "sparse", "budgets": ROWS}, SCALED, INVERSE], ids=str)
def test_without_a_coupling_term_both_paths_are_one(options: Mapping[str, Any]) -> None:
    """Joints of all kinds, loads, radiation, fixed frames and given temperatures."""
    full = everything()
    scene = EVERYTHING.using({"reducer": options})
    fast = march(scene, model=full.model, snapshots=learnt(full))
    general = march(scene, model=with_other(full.model, Nothing()), snapshots=learnt(full))
    assert isinstance(general.solver, ReducedGeneral)
    assert not isinstance(fast.solver, ReducedGeneral)
    for b in fast.solver.layout:
        one, other = fast.block(b.name)[1:], general.block(b.name)[1:]
        tolerance = 1e-6 if b.field == "multiplier" else 1e-9
        assert np.abs(one - other).max() < tolerance * np.abs(one).max(), b.name


def test_consistent_start_of_a_second_order_integrator() -> None:
    scene = load("double_pendulum", {"time.end": 0.02, "integrator": {
        "use": "generalized_alpha", "rho_inf": 0.6}})
    full = march(scene.using({"reducer": "full"}))
    scene = scene.using({"reducer": "galerkin"})
    fast = march(scene, model=full.model, snapshots=learnt(full))
    general = march(scene, model=with_other(full.model, Nothing()), snapshots=learnt(full))
    for b in fast.solver.layout:
        one, other = fast.block(b.name), general.block(b.name)
        tolerance = 1e-4 if b.field == "multiplier" else 1e-8
        assert np.abs(one - other).max() < tolerance * np.abs(one).max(), b.name


def test_a_kept_factor_changes_no_step() -> None:
    scene = bars()
    model = coupled(scene)
    chord, textbook = (march(scene.using({"reducer": {"use": "full", "method": m}}), model=model)
                       for m in ("bordered", "newton"))
    assert isinstance(chord.solver, GeneralStepper)
    assert max(errors(chord, textbook).values()) < 1e-9
    assert np.abs(chord.block("one.elastic")).max() > 1e-6  # the springs do bend the bars


# --------------------------------------------------------------------------- reduced models


@pytest.mark.parametrize("integrator", ["bdf1", "bdf2", "generalized_alpha"])
def test_a_complete_basis_is_full_order(integrator: str) -> None:
    """Mechanics and heat coupled across the bodies, rates of both orders different."""
    scene = bars(integrator=integrator)
    model = coupled(scene)
    full = march(scene, model=model)
    run = march(scene.using({"reducer": "galerkin"}), model=model, snapshots=whole(model))
    found = errors(run, full)
    forces = [found.pop(n) for n in ("a.multiplier", "b.multiplier")]
    assert max(found.values()) < 1e-8 and max(forces) < 1e-6, found
    warmed = full.block("two.thermal")[-1] - full.block("two.thermal")[0]
    assert warmed.max() > 0.1


@pytest.mark.parametrize("options", [
    {"use": "galerkin"}, {"use": "galerkin", "basis": {"use": "pod", "centred": True}},
    {"use": "deim"}, {"use": "gnat"}, {"use": "lspg"},
    {"use": "sparse", "budgets": {"*.elastic": {"rows": 35}, "*.thermal": {"rows": 20}}}], ids=str)
def test_a_run_that_was_learnt_is_given_back(options: Mapping[str, Any]) -> None:
    scene = bars()
    model = coupled(scene)
    full = march(scene, model=model)
    run = march(scene.using({"reducer": options}), model=model, snapshots=learnt(full))
    assert max(errors(run, full).values()) < 1e-6
    assert run.solver.layout.size < 0.7 * full.solver.layout.size


def test_what_a_step_visits_does_not_grow_with_the_mesh() -> None:
    sizes = []
    for divisions in ((8, 2), (24, 6)):
        scene = bars(divisions)
        model = coupled(scene)
        full = march(scene.using({"time.end": 0.003}), model=model)
        run = march(scene.using({"time.end": 0.003, "reducer": {
            "use": "galerkin", "basis": {"use": "pod", "count": 3}}}),
            model=model, snapshots=learnt(full))
        solver = run.solver
        assert isinstance(solver, ReducedGeneral)
        assert "springs" in solver.notes[-1] and "3 elements" in solver.notes[-1]
        inner: Any = solver.equations.coupled[0].term
        sizes.append((dict(solver.elements_touched), solver.layout.size, inner.atoms.shape))
    assert sizes[0] == sizes[1]
    assert set(sizes[0][0].values()) == {3}


def test_rows_without_a_spring_visit_none() -> None:
    """GNAT's points decide: springs are evaluated only where one of their rows is a point."""
    scene = bars((12, 4))
    model = coupled(scene)
    full = march(scene.using({"time.end": 0.01}), model=model)
    run = march(scene.using({"time.end": 0.01, "reducer": {
        "use": "gnat", "basis": {"use": "pod", "count": 2}, "oversampling": 1.0}}),
        model=model, snapshots=learnt(full))
    assert isinstance(run.solver, ReducedGeneral)
    seen: Any = run.solver.equations.coupled[0].term
    thermal = {n: set(r + model.layout[n].start) for n, r in run.solver.rows.items()}
    hit = set().union(*thermal.values()) & set(model.separated.other[0].rows.tolist())
    rigid = {r for r in model.separated.other[0].rows.tolist() if r < 6}
    assert set(seen.term.rows.tolist()) == {int(r) for r in hit} | rigid


def test_sparse_without_a_choice_only() -> None:
    scene = bars(reducer={"use": "sparse", "basis": {"use": "pod", "count": 5}, "resample": 2,
                          "budgets": {"*": {"rows": 20, "atoms": 3}}})
    faults = scene.reducer.check(coupled(scene))
    assert [f.key for f in faults] == ["resample", *["budgets.*.atoms"] * 4]
    assert all("springs couples bodies" in f.message for f in faults)
    late = scene.using({"reducer": {"use": "sparse", "budgets": {"*": {"rows": 20, "atoms": 3}}}})
    model = coupled(late)
    snapshots = {n: s[:, :5] for n, s in whole(model).items()}
    with pytest.raises(InputError, match="3 of 5 atoms would be selected"):
        late.reducer.prepare(model, late.integrator, 1e-3, Offline.of(model, snapshots),
                             np.random.default_rng(0))


class ByDifferences:
    """The same solver without its own response."""

    def __init__(self, solver: Any) -> None:
        self._solver = solver

    def __getattr__(self, name: str) -> Any:
        if name == "response":
            raise AttributeError(name)
        return getattr(self._solver, name)


def test_the_response_of_a_step_is_its_derivative() -> None:
    """What the stability check linearises with, for both orders of rates."""
    scene = bars(integrator={"use": "generalized_alpha", "rho_inf": 0.7})
    model = coupled(scene)
    full = march(scene, model=model)
    scene = scene.using({"reducer": {"use": "galerkin", "basis": {"use": "pod", "count": 6}}})
    solver: Any = scene.reducer.prepare(
        model, scene.integrator, 1e-3, Offline.of(model, learnt(full)), np.random.default_rng(0))
    state, memory = solver.start(consistent_state(model))
    state = scene.integrator.start(solver.layout, state)
    exact, near = (step_map(s, scene.integrator, 1e-3, state, memory)
                   for s in (solver, ByDifferences(solver)))
    size = np.abs(exact.response).max(axis=0) + 1e-12 * np.abs(exact.response).max()
    assert np.abs(exact.response - near.response).max(axis=0).max() > 0.0
    assert (np.abs(exact.response - near.response).max(axis=0) < 1e-4 * size).all()


# --------------------------------------------------------------------------- going on


@pytest.mark.parametrize("reducer", ["full", "galerkin"])
def test_memory_that_went_through_pickle_repeats_every_digit(reducer: str) -> None:
    scene = bars(reducer=reducer)
    model = coupled(scene)
    snapshots = learnt(march(scene.using({"reducer": "full"}), model=model))
    solver: StepSolver = scene.reducer.prepare(
        model, scene.integrator, 1e-3, Offline.of(model, snapshots), np.random.default_rng(0))
    ends = []
    for broken in (None, 9):
        state, memory = solver.start(consistent_state(model))
        state = scene.integrator.start(solver.layout, state)
        for n in range(20):
            if n == broken:
                memory = pickle.loads(pickle.dumps(memory))
            formula = scene.integrator.formula(solver.layout, state, 1e-3)
            outcome, memory = solver.solve(formula, memory)
            assert outcome.status.ok
            state = scene.integrator.advance(solver.layout, state, formula, outcome.x, 1e-3)
        ends.append(state.x)
        assert solver.counters(memory)["factorizations"] < 20
    assert np.array_equal(ends[0], ends[1])
