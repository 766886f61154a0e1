"""Local terms of elastic blocks: springs on a mesh whose stiffness depends on displacement and
temperature are iterated inside the step, at full order and reduced."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from scipy.sparse import csr_array

from sparsemor.core import (
    Csr,
    Equations,
    FloatArray,
    InputError,
    IntArray,
    Load,
    LoadPlugin,
    Part,
    Term,
    Trial,
)
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.compressed_local import CompressedLocal
from sparsemor.core.scene.scene import Scene
from sparsemor.core.testing import check_term
from sparsemor.core.testing.in_memory_run import March, march, scene_of
from sparsemor.reducers.step.blockwise_solver import BlockwiseSolver
from springs import bars
from tiers import quick

REDUCERS: dict[str, dict[str, Any]] = {
    use: {"use": use, "basis": {"use": "pod", "count": 14}}
    for use in ("galerkin", "lspg", "deim", "gnat", "ecsw", "sparse")}
REDUCERS["sparse"]["sampler"] = {"use": "deim", "method": "qr"}
LIMITS = {"ecsw": 1e-3}


@dataclass(frozen=True, slots=True, eq=False)
class Springs(Term):
    """Rows += ((k + k3 u^2) u + c u') (1 - b (T - T0)) of each spring.

    u_of, T_of (S,): place of each spring's displacement and temperature in the columns; row_of
    (S,): its place in the rows, -1 for none.
    """

    rows: IntArray
    columns: IntArray
    u_of: IntArray
    T_of: IntArray
    row_of: IntArray
    stiffness: tuple[float, float]
    damping: float = 2.0
    softening: float = 2e-3
    T0: float = 300.0

    @property
    def elements(self) -> int:
        return len(self.u_of)

    def _parts(self, x: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        u, (k, k3) = x[self.u_of], self.stiffness
        force = (k + k3 * u**2) * u + self.damping * v[self.u_of]
        return force, k + 3 * k3 * u**2, 1.0 - self.softening * (x[self.T_of] - self.T0)

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        force, _, soft = self._parts(x, v)
        r, here = np.zeros(len(self.rows)), self.row_of >= 0
        r[self.row_of[here]] = (force * soft)[here]
        return r

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Csr:
        force, slope, soft = self._parts(x, v)
        here = self.row_of >= 0
        of_u = (slope + self.damping * c1[self.u_of]) * soft
        values = np.concatenate([of_u[here], (-self.softening * force)[here]])
        places = (np.tile(self.row_of[here], 2),
                  np.concatenate([self.u_of[here], self.T_of[here]]))
        return csr_array((values, places), shape=(len(self.rows), len(self.columns)))

    def restrict(self, keep: IntArray) -> "Springs":
        new = np.full(len(self.rows) + 1, -1)
        new[keep] = np.arange(len(keep))
        row_of = new[self.row_of]
        some = row_of >= 0
        used = np.unique(np.concatenate([self.u_of[some], self.T_of[some]]))
        return replace(
            self, rows=self.rows[keep], columns=self.columns[used], row_of=row_of[some],
            u_of=np.searchsorted(used, self.u_of[some]),
            T_of=np.searchsorted(used, self.T_of[some]))

    def compress(self, trial: Trial, left: FloatArray) -> CompressedLocal:
        return CompressedLocal.of(self, trial, left)


@dataclass(frozen=True, slots=True, eq=False)
class Bed(Load):
    """Springs on all displacements of a set, each with the temperature of its node."""

    name: str
    body: str
    dofs: IntArray
    warmth: IntArray
    stiffness: tuple[float, float]

    def contribute(self, equations: Equations) -> None:
        elastic, thermal = f"{self.body}.elastic", f"{self.body}.thermal"
        u, T = equations.numbers(elastic)[self.dofs], equations.numbers(thermal)[self.warmth]
        columns = np.unique(np.concatenate([u, T]))
        rows = np.unique(u)
        equations.local([elastic, thermal], Springs(
            rows, columns, np.searchsorted(columns, u), np.searchsorted(columns, T),
            np.searchsorted(rows, u), self.stiffness))


class SpringBed(LoadPlugin):
    """Nonlinear springs under a set of a body."""

    on: str
    """The set `body:set`."""
    stiffness: tuple[float, float]
    """N/m and N/m^3 of each spring."""

    def build(self, name: str, parts: Mapping[str, Part]) -> Bed:
        body, _, which = self.on.partition(":")
        part: Any = parts[body]
        place = part.probe(name, which)
        (X, component), (hot, _) = (part.geometry()[f"{body}.{f}"] for f in ("elastic", "thermal"))
        nodes = np.flatnonzero(place.temperature)
        dofs = np.flatnonzero(place.displacement.any(axis=1))
        at = [int(np.argmin(np.linalg.norm(hot[nodes] - X[d], axis=1))) for d in dofs]
        assert set(component[dofs]) == {0, 1}
        return Bed(name, body, dofs, nodes[at], self.stiffness)


def run(scene: Scene, reducer: Any, on: str, k: tuple[float, float], of: March | None = None,
        ) -> March:
    scene = scene.using({"reducer": reducer})
    bed = SpringBed(on=on, stiffness=k)
    model = assemble(scene.model_copy(update={"loads": {**scene.loads, "bed": bed}}))
    snapshots = None if of is None else {n: of.block(n).T for n in of.model.reducible()}
    return march(scene, model=model, snapshots=snapshots)


def fixed() -> Scene:
    """A heated bar that is held at its left end, on springs, under its weight."""
    return scene_of({
        "bodies": {"bar": {
            "use": "flexible", "thickness": 0.02, "fields": ["elastic", "thermal"],
            "frame": "fixed", "reference": {"clamp": "left"},
            "material": {"E": 7e8, "nu": 0.3, "rho": 2700, "alpha": 2e-5, "k": 1500, "c": 90},
            "mesh": {"use": "rectangle", "size": [0.5, 0.05], "divisions": [8, 2]}}},
        "loads": {"weight": {"use": "gravity", "g": [0.0, -500.0]},
                  "lamp": {"use": "heat_flux", "on": ["bar:right"], "flux": 4e6}},
        "integrator": "bdf1", "time": {"end": 0.02, "step": 1e-3}})


SCENES = {
    "moving": (lambda: bars(divisions=(6, 2)).using({"time.end": 0.02}), "one:right", (2e4, 1e11)),
    "fixed": (fixed, "bar:right", (2e4, 1e9))}


@pytest.fixture(scope="module", params=quick(SCENES, "fixed"))
def case(request: pytest.FixtureRequest) -> tuple[Scene, str, tuple[float, float], March]:
    make, on, k = SCENES[request.param]
    scene = make()
    return scene, on, k, run(scene, {"use": "full", "method": "newton"}, on, k)


def error(found: March, truth: March) -> float:
    """Largest, relative to the largest value of the block."""
    worst = 0.0
    for name in truth.model.reducible():
        x, d = found.block(name), found.solver.dictionaries.get(name)
        x = x if d is None else d.offset + x @ d.atoms.T
        size = np.abs(truth.block(name)).max()
        worst = max(worst, float(np.abs(x - truth.block(name)).max() / size))
    return worst


@pytest.mark.full
def test_the_term_keeps_the_laws_and_its_block_holds_it(case) -> None:
    truth = case[3]
    (term,) = truth.model.by_part["bed"]
    check_term(term, np.random.default_rng(1), base=truth.model.x0[term.columns], scale=1e-2)
    s = truth.model.separated
    assert s.other == () and s.elastic_local == (term,)


@pytest.mark.full
def test_full_order_is_the_textbook_newton_and_the_springs_matter(case) -> None:
    scene, on, k, truth = case
    fast = run(scene, "full", on, k)
    assert isinstance(fast.solver, BlockwiseSolver)
    assert error(fast, truth) < 1e-9
    assert error(march(scene.using({"reducer": "full"})), truth) > 1e-2
    name = f"{on.partition(':')[0]}.elastic"
    (term,) = fast.model.separated.elastic_local
    assert fast.solver.elements_touched[name] == term.elements > 4


@pytest.mark.parametrize("use", quick(REDUCERS, "galerkin", "ecsw"))
def test_reduced(use: str, case) -> None:
    scene, on, k, truth = case
    reduced = run(scene, REDUCERS[use], on, k, truth)
    assert isinstance(reduced.solver, BlockwiseSolver)
    assert error(reduced, truth) < LIMITS.get(use, 1e-5)


@pytest.mark.full
def test_springs_stiffer_than_the_body_are_left_to_the_exact_jacobian() -> None:
    make, on, _ = SCENES["fixed"]
    scene, k = make(), (1e9, 1e13)
    truth, fast = (run(scene, r, on, k) for r in ({"use": "full", "method": "newton"}, "full"))
    assert error(fast, truth) < 1e-8


def test_a_choice_of_atoms_is_refused(case) -> None:
    scene, on, k, truth = case
    chosen = {**REDUCERS["sparse"], "budgets": {"*.elastic": {"atoms": 5}}}
    with pytest.raises(InputError, match="Springs acts on displacements by elements"):
        run(scene, chosen, on, k, truth)
