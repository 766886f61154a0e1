"""Energy-conserving sampling and weighting: Galerkin with few, weighted elements."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from pydantic import Field
from scipy.sparse import csr_array

from sparsemor.core import (
    AssembledModel,
    Csr,
    Dictionary,
    Fault,
    FloatArray,
    IntArray,
    Note,
    OfflineProducts,
    Term,
    information,
)
from sparsemor.core.protocols import (
    ElasticIntegrals,
    ElasticLocal,
    ElasticOperators,
    HeatBody,
    HeatIntegrals,
    Integrals,
    LoadColumn,
    MovingBody,
)
from sparsemor.reducers import (
    Approximation,
    Maps,
    ProjectionReducer,
    Reducible,
    TestMap,
    left_inverse,
)
from sparsemor.reducers.projection.ecsw.training import (
    CANDIDATES,
    Trained,
    elastic_equations,
    heat_equations,
    local_equations,
    train,
)
from sparsemor.reducers.projection.ecsw.training_matrix import WeightEquations

Fact = dict[str, float | int | str]


class Ecsw(ProjectionReducer):
    """ECSW, energy-conserving sampling and weighting: Galerkin with element integrals replaced by
    nonnegatively weighted sums over few elements (Farhat, Avery, Chapman & Cortial 2014).

    The weights reproduce the projected forces of the training run to `tau` (doi 10.1002/nme.4668
    and, 2015, 10.1002/nme.4820).

    Trial and test map are the atoms, and weighted element matrices stay symmetric and positive
    semidefinite: the structure, and with it the stability, of Galerkin is kept (of nonlinear
    strains, the part beyond the linear stress need not be semidefinite). Inertia of the floating
    frame, damping, joints, films and loads are projected exactly.
    """

    tau: float = Field(default=1e-6, ge=1e-8, lt=1.0)
    """Relative tolerance of the weights at the training states: errors of projected elastic forces
    are measured by the displacements they cause, of heat by the rates of temperature, of local
    terms such as radiation by the heat."""
    constant: Literal["exact", "weighted"] = "exact"
    """Stiffness, thermal forces, capacity and conduction with constant properties: `exact`,
    projected over all elements, or `weighted` like local terms. They are projected once, so that a
    step costs the same; `exact` has the errors of local terms alone and less training, and equals
    `galerkin` on bodies without local terms."""
    states: int = Field(default=200, ge=2)
    """Largest number of training states, evenly spread, for the weights of local terms such as
    radiation or temperature-dependent conductivity."""
    candidates: int = Field(default=CANDIDATES, ge=100)
    """Largest number of elements of a block among which weights are searched. Of more as many are
    drawn at random, by their share in the forces, which bounds the memory and time of training; the
    reproduced forces are those of all elements."""

    def check(self, model: AssembledModel) -> Sequence[Fault]:
        faults = [*super().check(model)]
        whole = "ecsw weighs mesh elements, which"
        weighted = self.constant == "weighted"
        for b in model.separated.heat:
            if weighted and b.integrals is None:
                faults.append(Fault("", f"{whole} body {b.name} does not offer for its heat: use "
                                    "reducer: galerkin"))
            kinds = {type(t).__name__ for t in b.local if not t.weighs_elements}
            faults += [Fault("", f"{whole} {kind} on body {b.name} does not offer: use reducer: "
                             "galerkin") for kind in sorted(kinds)]
        faults += [Fault("", f"{whole} body {m.name} does not offer for its elastic field: use "
                         "reducer: galerkin") for m in model.separated.moving
                   if weighted and m.operators is not None and m.operators.integrals is None]
        return faults

    def maps(self, block: Reducible) -> Maps:
        return Maps(TestMap(left=block.dictionary.atoms.T), facts={"norm": "D^-1"})

    def approximation(
        self, model: AssembledModel, dictionaries: Mapping[str, Dictionary],
        offline: OfflineProducts, h: float
    ) -> Approximation:
        """The model with element integrals replaced by ECSW-weighted sums, and facts of each
        block's weights."""
        training = WeightTraining(
            model, offline, h, self.tau, self.constant == "weighted", self.states,
            self.candidates, dictionaries)
        moving = tuple(training.elastic(m) for m in model.separated.moving)
        heat = tuple(training.heat(b) for b in model.separated.heat)
        weighed = replace(model.separated, moving=moving, heat=heat)
        facts = training.facts
        notes = tuple(
            Note(f"{n}: no choice of elements repeats the training forces to {self.tau:g}, the "
                 f"best comes to {f['residual']:.1e}", "ecsw_training")
            for n, f in facts.items() if float(f["residual"]) > 1.05 * self.tau)
        exact = [n for n in dictionaries if n not in facts]
        if exact:
            text = (f"reducer ecsw is galerkin in {', '.join(exact)}: without local terms a step "
                    "visits no elements, so none are selected (reducer.constant: weighted weighs "
                    "those of constant matrices)")
            notes += (information(text, "no_effect") if facts else Note(text, "no_effect"),)
        return Approximation(
            model.with_separated(weighed), facts,
            {n: int(f["elements_kept"]) for n, f in facts.items() if "elements_kept" in f}, notes)


@dataclass(frozen=True, slots=True, eq=False)
class WeightTraining:
    """Computation of the weighted operators of one model; collects the reported facts of each
    block. constant: True if operators with constant properties are weighted, too."""

    model: AssembledModel
    offline: OfflineProducts
    h: float
    tau: float
    constant: bool
    states: int
    candidates: int
    dictionaries: Mapping[str, Dictionary]
    facts: dict[str, Fact] = field(default_factory=dict)
    trained: dict[str, Trained] = field(default_factory=dict)

    def elastic(self, body: MovingBody) -> MovingBody:
        ops = body.operators
        if ops is None or (ops.integrals is None if self.constant else not ops.local):
            return body
        u = self._trained(body.elastic)
        T = self._trained(body.thermal) if body.thermal in self.dictionaries else None
        A = u.dictionary.atoms
        flexibility = left_inverse(body.elastic, A.T @ (ops.stiffness @ A))
        if self.constant and ops.integrals is not None:
            g = ops.integrals()
            ops = _weigh_elastic(ops, g, self._weights(
                body.elastic, "elements", elastic_equations(g, u, T, flexibility)))
        local = [self._elastic_local(body.elastic, one, u, T, flexibility) for one in ops.local]
        return replace(body, operators=replace(ops, local=tuple(local)))

    def heat(self, body: HeatBody) -> HeatBody:
        if body.integrals is None if self.constant else not body.local:
            return body
        T, name = self._trained(body.thermal), body.thermal
        A = T.dictionary.atoms
        C_inverse = left_inverse(name, A.T @ (body.capacity @ A))
        if self.constant and body.integrals is not None:
            g = body.integrals()
            body = _weigh_heat(body, g, self._weights(
                name, "elements", heat_equations(g, T, C_inverse)))
        local = [self._local(name, term, T, C_inverse @ A.T) for term in body.local]
        return replace(body, local=tuple(local))

    def _local(self, name: str, term: Any, T: Trained, left: FloatArray) -> Term:
        at, chosen = self.model.layout[name].start, self._chosen(len(T.t))
        x, v = T.states(term.columns - at, chosen)
        G = local_equations(term, left[:, term.rows - at], x, v, T.t[chosen])
        weighted: Term = term.weighted(self._weights(name, "local_elements", G))
        return weighted

    def _elastic_local(
        self, name: str, local: ElasticLocal, u: Trained, T: Trained | None,
        flexibility: FloatArray,
    ) -> ElasticLocal:
        """A local term of displacements with element weights, which repeat the displacements that
        it causes; terms without element contributions remain whole."""
        term = local.term
        if not term.weighs_elements:
            return local
        chosen, n = self._chosen(len(u.t)), len(local.columns)
        x, v = np.zeros((n, len(chosen))), np.zeros((n, len(chosen)))
        x[~local.hot], v[~local.hot] = u.states(local.columns[~local.hot], chosen)
        if T is not None and local.hot.any():
            x[local.hot], v[local.hot] = T.states(local.columns[local.hot], chosen)
        left = flexibility @ u.dictionary.atoms[local.rows].T
        some = term.weighted(self._weights(name, "local_elements", local_equations(
            term, left, x, v, u.t[chosen])))
        at = np.searchsorted(term.columns, some.columns)
        return ElasticLocal(some, local.rows[np.searchsorted(term.rows, some.rows)],
                            local.columns[at], local.hot[at])

    def _chosen(self, M: int) -> IntArray:
        """Numbers of the training states, evenly spread, at which local terms are evaluated."""
        return np.unique(np.linspace(0, M - 1, min(self.states, M)).round().astype(np.int64))

    def _weights(self, name: str, kind: str, G: WeightEquations) -> FloatArray:
        """Weights (E,) of the elements or facets of a block for the equations G w = G 1, cached for
        all blocks with equal equations; adds their number and residual to the block's facts."""
        def make() -> dict[str, Any]:
            found = train(G, self.tau, self.candidates)
            return {"weights": found.values, "residual": np.array(found.residual)}

        stored = self.offline.remember("weights", (self.tau, self.candidates, *G.content), make)
        w, fact = np.asarray(stored["weights"]), self.facts.setdefault(name, {"tau": self.tau})
        fact[kind] = int(fact.get(kind, 0)) + len(w)
        fact[f"{kind}_kept"] = int(fact.get(f"{kind}_kept", 0)) + int(np.count_nonzero(w))
        fact["residual"] = max(float(fact.get("residual", 0.0)), float(stored["residual"]))
        return w

    def _trained(self, name: str) -> Trained:
        if name not in self.trained:
            snapshots = self.offline.snapshots(name)
            self.trained[name] = Trained.of(
                self.dictionaries[name], snapshots, self._times(snapshots.shape[1]))
        return self.trained[name]

    def _times(self, M: int) -> FloatArray:
        """Times (M,) of the snapshots, s; snapshots without recorded times count as one per
        step."""
        r = self.offline.recording
        runs, spacing = (1, self.h) if r is None else (r.runs, r.step * r.every)
        t = np.arange(M // runs) * spacing
        if r is not None and r.integrator.order > 1:
            t[-1] = 0.0  # the extra one, made at the start
        return np.asarray(np.tile(t, runs))


def _weigh_elastic(ops: ElasticOperators, g: ElasticIntegrals, w: FloatArray) -> ElasticOperators:
    fixed, rest = _left_out(g.given, w)
    return replace(
        ops, stiffness=_weighed(ops.stiffness, g.stiffness, w),
        coupling=None if ops.coupling is None or g.coupling is None
        else _weighed(ops.coupling, g.coupling, w),
        constant=ops.constant + fixed, loads=np.concatenate([ops.loads, rest], axis=1),
        amplitudes=(*ops.amplitudes, *g.amplitudes),
        load_names=(*ops.load_names, *("left-out elements" for _ in g.amplitudes)))


def _weigh_heat(body: HeatBody, g: HeatIntegrals, w: FloatArray) -> HeatBody:
    fixed, rest = _left_out(g.given, w)
    return replace(
        body, capacity=_weighed(body.capacity, g.capacity, w),
        conductivity=_weighed(body.conductivity, g.conductivity, w),
        constant=body.constant + fixed, loads=np.concatenate([body.loads, rest], axis=1),
        amplitudes=(*body.amplitudes, *g.amplitudes),
        columns=(*body.columns, *(LoadColumn("left-out elements") for _ in g.amplitudes)))


def _left_out(g: Integrals, w: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Change of the constant forces (n,) and of the prescribed loads (n, j) by the weights w
    (E,)."""
    change = g.weighted(w - 1.0).toarray()
    return change[:, 0], change[:, 1:]


def _weighed(matrix: Csr, g: Integrals, w: FloatArray) -> Csr:
    """The matrix with its element contributions weighted; contributions that are not element
    integrals (convective films) remain unchanged."""
    other = csr_array(matrix - g.weighted(np.ones(g.count)))
    # rounding of elements that go must not stay behind: it is not positive semidefinite
    other.data[np.abs(other.data) < 1e-11 * np.abs(matrix).max()] = 0.0
    other.eliminate_zeros()
    return csr_array(g.weighted(w) + other)
