"""New atoms for a reduced model whose estimated error is too large: full-order steps, whose part
outside the span of the atoms is compressed by POD."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sparsemor.core import Basis, Dictionary, OfflineProducts, State, StepFactors, StepSolver
from sparsemor.core.arrays import Arrays, FloatArray
from sparsemor.core.linalg.dense import least_squares_coefficients, svd
from sparsemor.core.protocols.layout import Layout
from sparsemor.core.protocols.reducer import Recording
from sparsemor.core.results.probes import ProbeReader
from sparsemor.core.simulation.prepared_run import PreparedRun
from sparsemor.core.simulation.step_control import controlled
from sparsemor.core.simulation.time_stepping import problem_of

STEPS = 10
"""Least number of full-order steps from which atoms are added."""
MOST = 20
"""Largest number of such additions in a run, which then goes on at full order."""
LEFT_OUT = 0.01
"""Share of the tolerance by which the new atoms may miss the full-order steps."""


@dataclass(frozen=True, slots=True, eq=False)
class OtherBases:
    """Offline products with other trial bases."""

    base: OfflineProducts
    dictionaries: Mapping[str, Dictionary]

    @property
    def trained(self) -> bool:
        return self.base.trained

    @property
    def recording(self) -> Recording | None:
        return self.base.recording

    def snapshots(self, name: str) -> FloatArray:
        return self.base.snapshots(name)

    def dictionary(
        self, name: str, basis: Basis, step: StepFactors | None = None
    ) -> tuple[Dictionary, float]:
        return self.dictionaries[name], self.base.dictionary(name, basis, step)[1]

    def remember(
        self, kind: str, depends: Sequence[object], make: Callable[[], Arrays]
    ) -> Arrays:
        return self.base.remember(kind, depends, make)

    def learning(self, count: int) -> OfflineProducts:
        return replace(self, base=self.base.learning(count))


def complete(dictionary: Dictionary) -> bool:
    """True if the atoms are as many as the unknowns, so that there are no further ones."""
    n, k = dictionary.atoms.shape
    return bool(k >= n)


def with_new_atoms(
    known: Mapping[str, Dictionary], states: Sequence[State], layout: Layout,
    permitted: Mapping[str, float],
) -> dict[str, Dictionary]:
    """Dictionaries with the atoms that full-order states need in addition. permitted: block ->
    largest distance (2-norm) of a state from the atoms; blocks without one stay as they are."""
    found = dict(known)
    for name, distance in permitted.items():
        d = known[name]
        X = np.stack([s.x[layout[name]] for s in states], axis=1) - d.offset[:, None]
        rest = X - d.atoms @ least_squares_coefficients(d.atoms, X)
        U, s, _ = svd(rest)
        new = U[:, s > distance]
        found[name] = replace(
            d, atoms=np.hstack([d.atoms, new]),
            provenance=(*d.provenance, *(["full-order steps of the run"] * new.shape[1])))
    return found


def enriched(run: PreparedRun, dictionaries: Mapping[str, Dictionary], t: float) -> PreparedRun:
    """The same run with other trial bases from t, s, on. Raises InputError and SolveFailed where
    the reducer does not apply to them."""
    scene, model, reducer = run.scene, run.model, run.scene.reducer
    assert model is not None and run.offline is not None
    offline = OtherBases(run.offline, dictionaries)
    problem = problem_of(scene, model, offline)
    solver: StepSolver = scene.reducer.prepare(problem)
    estimator = reducer.error_estimator(problem, solver)
    solver = controlled(scene, model, offline, solver)
    return replace(
        run, solver=solver, estimator=estimator, kept={}, trained_to=None,
        probes=tuple(ProbeReader.at_place(
            p, solver.layout, solver.dictionaries) for p in model.probes),
        header=replace(run.header, layout=solver.layout, dictionaries=solver.dictionaries,
                       rows=solver.rows, enriched=(*run.header.enriched, t)))


def coefficient_maps(
    old: Mapping[str, Dictionary], new: Mapping[str, Dictionary]
) -> dict[str, FloatArray]:
    """Block -> matrix (l, k) from its coefficients in k old atoms to those in l new ones, which
    span these."""
    maps = {}
    for name, d in old.items():
        A, k = new[name].atoms, d.atoms.shape[1]
        same = np.array_equal(A[:, :k], d.atoms)
        maps[name] = np.eye(A.shape[1], k) if same else least_squares_coefficients(A, d.atoms)
    return maps


def in_atoms(state: State, layout: Layout, full: Layout, bases: Mapping[str, Dictionary]) -> State:
    """Full-order state, with the layout `full`, in the unknowns `layout` of a reduced model with
    `bases`, by least squares."""
    x, v, a = (np.zeros(layout.size) for _ in range(3))
    for b in layout:
        columns = np.stack([z[full[b.name]] for z in (state.x, state.v, state.a)], axis=1)
        d = bases.get(b.name)
        if d is not None:
            columns[:, 0] -= d.offset
            columns = least_squares_coefficients(d.atoms, columns)
        for part, column in zip((x, v, a), columns.T, strict=True):
            part[layout[b.name]] = column
    return State(state.t, x, v, a, np.zeros((layout.size, 0)))
