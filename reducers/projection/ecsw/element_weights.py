"""Element weights of local terms, learned from the training states: a model that visits few of its
elements in a step."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from sparsemor.core import (
    AssembledModel,
    Dictionary,
    FloatArray,
    IntArray,
    Note,
    OfflineProducts,
    Term,
)
from sparsemor.core.protocols.separable import ElasticLocal, HeatBody, MovingBody
from sparsemor.reducers.projection.ecsw.training import (
    CANDIDATES,
    Trained,
    local_equations,
    train,
)
from sparsemor.reducers.projection.ecsw.training_matrix import WeightEquations

STATES = 200
"""Largest number of training states at which local terms are evaluated."""


@dataclass(frozen=True, slots=True, eq=False)
class WeightTraining:
    """Training of the element weights of one model; collects the reported facts of each block.

    effect: returns the map (k, n) from forces on a block to what they change in its coefficients,
    in which the error of weighted forces is measured, relative to those of all elements: `tau`.
    h: step, s; states, candidates: largest numbers of training states and of elements among which
    weights are searched.
    """

    model: AssembledModel
    offline: OfflineProducts
    h: float
    tau: float
    dictionaries: Mapping[str, Dictionary]
    effect: Callable[[str], FloatArray]
    states: int = STATES
    candidates: int = CANDIDATES
    facts: dict[str, dict[str, float | int | str]] = field(default_factory=dict)
    trained: dict[str, Trained] = field(default_factory=dict)

    def heat(self, body: HeatBody) -> HeatBody:
        """The block with its local terms weighted."""
        if not body.local:
            return body
        T, name, effect = self.at(body.thermal), body.thermal, self.effect(body.thermal)
        return replace(body, local=tuple(self._local(name, t, T, effect) for t in body.local))

    def elastic(self, body: MovingBody) -> MovingBody:
        """The block with its local terms weighted; those without element contributions remain
        whole."""
        ops = body.operators
        if ops is None or not any(one.term.weighs_elements for one in ops.local):
            return body
        u, effect = self.at(body.elastic), self.effect(body.elastic)
        T = self.at(body.thermal) if body.thermal in self.dictionaries else None
        local = tuple(self._elastic_local(body.elastic, one, u, T, effect) for one in ops.local)
        return replace(body, operators=replace(ops, local=local))

    def _local(self, name: str, term: Any, T: Trained, effect: FloatArray) -> Term:
        """A local term of a thermal block on the elements with a weight."""
        at, chosen = self.model.layout[name].start, self._chosen(len(T.t))
        x, v = T.states(term.columns - at, chosen)
        G = local_equations(term, effect[:, term.rows - at], x, v, T.t[chosen])
        weighted: Term = term.weighted(self.weights(name, "local_elements", G))
        return weighted

    def _elastic_local(
        self, name: str, local: ElasticLocal, u: Trained, T: Trained | None, effect: FloatArray
    ) -> ElasticLocal:
        """A term of an elastic block on the elements with a weight; u, T: training states of its
        displacements and temperatures; effect (k, n): displacements of the reduced model due to
        forces on its rows, by which the weights are trained. local.hot: True for those columns of
        the term that are temperatures; its rows and columns are numbers in the body's blocks."""
        term = local.term
        if not term.weighs_elements:
            return local
        chosen, n = self._chosen(len(u.t)), len(local.columns)
        x, v = np.zeros((n, len(chosen))), np.zeros((n, len(chosen)))
        x[~local.hot], v[~local.hot] = u.states(local.columns[~local.hot], chosen)
        if T is not None and local.hot.any():
            x[local.hot], v[local.hot] = T.states(local.columns[local.hot], chosen)
        some = term.weighted(self.weights(name, "local_elements", local_equations(
            term, effect[:, local.rows], x, v, u.t[chosen])))
        # it has fewer rows and columns: those of `term`, whose numbers increase
        at = np.searchsorted(term.columns, some.columns)
        return ElasticLocal(some, local.rows[np.searchsorted(term.rows, some.rows)],
                            local.columns[at], local.hot[at])

    def _chosen(self, M: int) -> IntArray:
        """Numbers of the training states, evenly spread, at which local terms are evaluated."""
        return np.unique(np.linspace(0, M - 1, min(self.states, M)).round().astype(np.int64))

    def weights(self, name: str, kind: str, G: WeightEquations) -> FloatArray:
        """Weights (E,) of the elements or facets of a block for the equations G w = G 1, cached for
        all blocks with equal equations; adds their number and residual to the block's facts. kind:
        name of their number there; content: the arrays that determine G; tau: tolerance of |G w -
        G 1|."""
        def make() -> dict[str, Any]:
            found = train(G, self.tau, self.candidates)
            return {"weights": found.values, "residual": np.array(found.residual)}

        stored = self.offline.remember("weights", (self.tau, self.candidates, *G.content), make)
        # facts add up over the terms of a block
        w, fact = np.asarray(stored["weights"]), self.facts.setdefault(name, {"tau": self.tau})
        fact[kind] = int(fact.get(kind, 0)) + len(w)
        fact[f"{kind}_kept"] = int(fact.get(f"{kind}_kept", 0)) + int(np.count_nonzero(w))
        fact["residual"] = max(float(fact.get("residual", 0.0)), float(stored["residual"]))
        return w

    def at(self, name: str) -> Trained:
        """Training coefficients of a block."""
        if name not in self.trained:
            snapshots = self.offline.snapshots(name)
            self.trained[name] = Trained.fit(
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

    def notes(self) -> tuple[Note, ...]:
        """A note for each block whose training forces no choice of elements repeats to `tau`."""
        return tuple(
            Note(f"{n}: no choice of elements repeats the training forces to {self.tau:g}, the "
                 f"best comes to {f['residual']:.1e}", "ecsw_training")
            for n, f in self.facts.items() if float(f["residual"]) > 1.05 * self.tau)
