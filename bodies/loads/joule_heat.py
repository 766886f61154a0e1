"""Heat of a steady electric current.

    div(sigma grad phi) = 0,    q = sigma |grad phi|^2,    nodal heats: integral of q phi_i

The potential phi is solved for once, with constant conductivity; a current that changes with time
by a factor f(t) heats with f(t)^2. Induction and the charging of surfaces are left out.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from sparsemor.bodies.body_set import find_body, find_target, need_field
from sparsemor.bodies.fem.integrals import conductivity, on_cells
from sparsemor.bodies.floating_body import FloatingBody
from sparsemor.bodies.loads.built_load import LoadPart, NumberOrFunction, unit
from sparsemor.bodies.material import cells_of_set
from sparsemor.core import (
    Csr,
    Effect,
    Equations,
    FloatArray,
    InputError,
    IntArray,
    LoadPlugin,
    Part,
    Plugin,
    TimeFunction,
    information,
)


@dataclass(frozen=True, slots=True, eq=False)
class Squared(TimeFunction):
    """Square of a function of time."""

    function: TimeFunction

    def value(self, t: float) -> float:
        return self.function.value(t) ** 2

    def rate(self, t: float) -> float:
        return 2.0 * self.function.value(t) * self.function.rate(t)

    def jumps(self, start: float, end: float) -> Sequence[float] | None:
        return self.function.jumps(start, end)


class Electrode(Plugin):
    """Set of the surface at one potential."""

    potential: float | None = None
    """Potential, V."""
    current: float | None = None
    """In place of `potential`: current into the body, A."""

    @model_validator(mode="after")
    def _one(self) -> Self:
        if (self.potential is None) is (self.current is None):
            raise ValueError("give either a potential, V, or a current, A")
        return self


class JouleHeat(LoadPlugin):
    """Joule heat: a steady current between electrodes heats a body by sigma |grad phi|^2, where
    the potential phi is constant on each electrode and no current leaves elsewhere."""

    acts_on: ClassVar[Effect] = "temperature"

    on: str
    """The body, with a mesh."""
    conductivity: float = Field(gt=0)
    """Electric conductivity sigma, S/m."""
    conductivities: dict[str, Annotated[float, Field(gt=0)]] = {}
    """Other conductivities, S/m, by set of cells."""
    electrodes: dict[str, Electrode] = Field(min_length=2)
    """Electrodes by set, such as `{left: {potential: 0.0}, right: {current: 50.0}}`; at least one
    with a potential."""
    factor: NumberOrFunction | None = None
    """Function of time that multiplies all potentials and currents; 1 by default."""

    def build(self, name: str, parts: Mapping[str, Part]) -> LoadPart:
        """The electric potential between the electrodes, and the heat sigma |grad phi|^2 of its
        current, times the squared factor."""
        body = find_body(parts, self.on, "on")
        if not isinstance(body, FloatingBody) or body.mesh is None:
            raise InputError(f"body {self.on!r} has no mesh, in which a current could flow", "on")
        need_field(body, "thermal", "on")
        nodes = self._electrodes(parts)
        sigma = self._conductivities(parts, body)
        K = csr_array((len(body.X), len(body.X)))
        for s, cells in sigma:
            K = K + conductivity(body.mesh, s, body.thickness, cells)
        phi, V, current = self._potential(K, nodes)
        # nodal heats (N,), W; axes e: element, n: node, d: direction, q: point
        heat = np.zeros(len(body.X))
        for s, cells in sigma:
            for _, at in on_cells(body.mesh, 1, cells):
                assert at.shape.gradients is not None
                slope = np.einsum("en,endq->edq", phi[at.shape.nodes], at.shape.gradients)
                q = s * body.thickness * (slope**2).sum(axis=1) * at.weights
                np.add.at(heat, at.shape.nodes, (q[:, None] * at.shape.values).sum(axis=2))
        function = self.factor
        amplitude = unit if function is None else Squared(function).value

        def write(equations: Equations) -> None:
            body.heat_load(equations, heat, amplitude)

        flows = ", ".join(f"{which} {v:.4g} V {i:.4g} A" for which, v, i in zip(
            self.electrodes, V, current, strict=True))
        return LoadPart(name, write, localized=False, notes=(information(
            f"loads.{name}: {heat.sum():.4g} W at factor 1; {flows}", "joule_heat"),))

    def _electrodes(self, parts: Mapping[str, Part]) -> list[IntArray]:
        """Nodes of each electrode. InputError for electrodes that touch, or without any
        potential."""
        found: list[IntArray] = []
        for which in self.electrodes:
            key = f"electrodes.{which}"
            nodes = find_target(parts, f"{self.on}:{which}", key).nodes
            if any(np.isin(nodes, others).any() for others in found):
                raise InputError("it touches another electrode: a short circuit", key)
            found.append(nodes)
        if all(e.potential is None for e in self.electrodes.values()):
            raise InputError("all electrodes have currents: give one of them a potential instead, "
                             "such as 0, from which the others are counted", "electrodes")
        return found

    def _conductivities(
        self, parts: Mapping[str, Part], body: FloatingBody
    ) -> list[tuple[float, IntArray]]:
        """Conductivities, S/m, and their cells (numbers), the general one first; of two sets with a
        cell in common the later one has it. which (E,): number of the conductivity of each cell."""
        assert body.mesh is not None
        which = np.zeros(len(body.mesh.cells), np.int64)
        for i, name in enumerate(self.conductivities, 1):
            find_target(parts, f"{self.on}:{name}", f"conductivities.{name}")
            cells = cells_of_set(body.mesh, name)
            if not cells.any():
                raise InputError(f"set {name!r} has no cells", f"conductivities.{name}")
            which[cells] = i
        values = [self.conductivity, *self.conductivities.values()]
        found = [(s, np.flatnonzero(which == i)) for i, s in enumerate(values)]
        return [(s, cells) for s, cells in found if len(cells)]

    def _potential(
        self, K: Csr, nodes: list[IntArray]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Potential at all nodes (N,), V, and of each electrode with its current, A.

        phi is a sum of the potentials of the electrodes times harmonic functions that are 1 on one
        of them and 0 on the others; K applied to these gives the matrix of conductances.
        """
        held = np.concatenate(nodes)
        _, part = connected_components(K, directed=False)
        if len(np.setdiff1d(part, part[held])):
            raise InputError(f"a part of {self.on!r} touches no electrode, so that its potential "
                             "is not determined", "electrodes")
        # H: harmonic functions as columns; G = H^T K H: conductances, A/V, currents G V
        H, free = np.zeros((K.shape[0], len(nodes))), np.setdiff1d(np.arange(K.shape[0]), held)
        for i, at in enumerate(nodes):
            H[at, i] = 1.0
        if len(free):
            H[free] = splu(K[free][:, free].tocsc()).solve(-np.asarray(K[free] @ H))
        G = H.T @ (K @ H)
        given = list(self.electrodes.values())
        V = np.array([0.0 if e.potential is None else e.potential for e in given])
        driven = np.array([e.potential is None for e in given])  # by a current
        if driven.any():
            currents = np.array([e.current or 0.0 for e in given])[driven]
            V[driven] = np.linalg.solve(G[np.ix_(driven, driven)], currents - (G @ V)[driven])
        return H @ V, V, G @ V
