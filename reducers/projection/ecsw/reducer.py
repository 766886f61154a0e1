"""Energy-conserving sampling and weighting: Galerkin with few, weighted elements."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from pydantic import Field
from scipy.sparse import csr_array

from sparsemor.core import (
    AssembledModel,
    Csr,
    Dictionary,
    Fault,
    FloatArray,
    Note,
    OfflineProducts,
    information,
)
from sparsemor.core.protocols.separable import (
    ElasticIntegrals,
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
from sparsemor.reducers.projection.ecsw.element_weights import STATES, WeightTraining
from sparsemor.reducers.projection.ecsw.training import (
    CANDIDATES,
    elastic_equations,
    heat_equations,
)


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
    states: int = Field(default=STATES, ge=2)
    """Largest number of training states, evenly spread, for the weights of local terms such as
    radiation or temperature-dependent conductivity."""
    candidates: int = Field(default=CANDIDATES, ge=100)
    """Largest number of elements of a block among which weights are searched. Of more as many are
    drawn at random, by their share in the forces, which bounds the memory and time of training; the
    reproduced forces are those of all elements."""

    def check(self, model: AssembledModel) -> Sequence[Fault]:
        """Faults of the options, and of bodies and terms without integrals per element, which
        cannot be weighted."""
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
        block's weights. inverses: block -> (k, k), by which its projected forces become rates of
        temperature (inverse of the capacity) or displacements (inverse of the stiffness); weights
        are trained on these effects. A block without weighted elements is as in `galerkin`."""
        def left(name: str, K: Csr) -> FloatArray:
            """Inverse (k, k) of a matrix projected on the atoms of a block."""
            A = dictionaries[name].atoms
            return left_inverse(name, A.T @ (K @ A))

        inverses = {b.thermal: left(b.thermal, b.capacity) for b in model.separated.heat
                    if self._weighs(b.integrals, b.local)}
        inverses |= {m.elastic: left(m.elastic, m.operators.stiffness)
                     for m in model.separated.moving if m.operators is not None
                     and self._weighs(m.operators.integrals, m.operators.local)}
        training = WeightTraining(
            model, offline, h, self.tau, dictionaries,
            effect=lambda name: inverses[name] @ dictionaries[name].atoms.T, states=self.states,
            candidates=self.candidates)
        moving = tuple(self._elastic(training, m, inverses) for m in model.separated.moving)
        heat = tuple(self._heat(training, b, inverses) for b in model.separated.heat)
        facts, notes = training.facts, training.notes()
        exact = [n for n in dictionaries if n not in facts]  # blocks without weighted elements
        if exact:
            text = (f"reducer ecsw is galerkin in {', '.join(exact)}: without local terms a step "
                    "visits no elements, so none are selected (reducer.constant: weighted weighs "
                    "those of constant matrices)")
            # a warning if no block at all is weighted
            notes += (information(text, "no_effect") if facts else Note(text, "no_effect"),)
        return Approximation(
            model.with_separated(replace(model.separated, moving=moving, heat=heat)), facts,
            {n: int(f["elements_kept"]) for n, f in facts.items() if "elements_kept" in f}, notes)

    def _weighs(self, integrals: object, local: Sequence[object]) -> bool:
        """True if the elements of a block are weighed: those of local terms, or all."""
        return bool(local) or self.constant == "weighted" and integrals is not None

    def _elastic(
        self, training: WeightTraining, body: MovingBody, inverses: Mapping[str, FloatArray]
    ) -> MovingBody:
        """A moving body with weighted elements in its constant operators, if wanted, and in its
        local terms."""
        ops, name = body.operators, body.elastic
        if self.constant == "weighted" and ops is not None and ops.integrals is not None:
            g = ops.integrals()  # by elements
            # training states of the temperatures, which load the displacements
            T = training.at(body.thermal) if body.thermal in training.dictionaries else None
            ops = _weigh_elastic(ops, g, training.weights(
                name, "elements", elastic_equations(g, training.at(name), T, inverses[name])))
            body = replace(body, operators=ops)
        return training.elastic(body)

    def _heat(
        self, training: WeightTraining, body: HeatBody, inverses: Mapping[str, FloatArray]
    ) -> HeatBody:
        """A thermal block with weighted elements in its constant operators, if wanted, and in its
        local terms."""
        name = body.thermal
        if self.constant == "weighted" and body.integrals is not None:
            g = body.integrals()
            body = _weigh_heat(body, g, training.weights(
                name, "elements", heat_equations(g, training.at(name), inverses[name])))
        return training.heat(body)


def _weigh_elastic(ops: ElasticOperators, g: ElasticIntegrals, w: FloatArray) -> ElasticOperators:
    """Operators with element integrals times weights w (E,); given loads of elements that are left
    out stay, as they are constant vectors."""
    fixed, rest = _left_out(g.given, w)
    return replace(
        ops, stiffness=_weighted_matrix(ops.stiffness, g.stiffness, w),
        coupling=None if ops.coupling is None or g.coupling is None
        else _weighted_matrix(ops.coupling, g.coupling, w),
        constant=ops.constant + fixed, loads=np.concatenate([ops.loads, rest], axis=1),
        amplitudes=(*ops.amplitudes, *g.amplitudes),
        load_names=(*ops.load_names, *("left-out elements" for _ in g.amplitudes)))


def _weigh_heat(body: HeatBody, g: HeatIntegrals, w: FloatArray) -> HeatBody:
    """The block with element integrals times weights w (E,); heat of elements that are left out
    stays, as constant vectors."""
    fixed, rest = _left_out(g.given, w)
    return replace(
        body, capacity=_weighted_matrix(body.capacity, g.capacity, w),
        conductivity=_weighted_matrix(body.conductivity, g.conductivity, w),
        constant=body.constant + fixed, loads=np.concatenate([body.loads, rest], axis=1),
        amplitudes=(*body.amplitudes, *g.amplitudes),
        columns=(*body.columns, *(LoadColumn("left-out elements") for _ in g.amplitudes)))


def _left_out(g: Integrals, w: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Change of the constant forces (n,) and of the prescribed loads (n, j) by the weights w
    (E,)."""
    change = g.weighted(w - 1.0).toarray()
    return change[:, 0], change[:, 1:]


def _weighted_matrix(matrix: Csr, g: Integrals, w: FloatArray) -> Csr:
    """The matrix with its element contributions weighted; contributions that are not element
    integrals (convective films) remain unchanged."""
    other = csr_array(matrix - g.weighted(np.ones(g.count)))
    # rounding of elements that go must not stay behind: it is not positive semidefinite
    other.data[np.abs(other.data) < 1e-11 * np.abs(matrix).max()] = 0.0
    other.eliminate_zeros()
    return csr_array(g.weighted(w) + other)
