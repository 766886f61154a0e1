"""Radiation between surfaces that see each other, of one or several bodies.

    J = eps sigma T^4 + (1 - eps) H,   H = F J + F_a sigma T_a^4,   q = J - H

(grey, diffuse; Howell, Menguc and Siegel, Thermal Radiation Heat Transfer, 6th ed. 2015, ch. 5),
on patches of some facets each, with the view factors F of `fem/view_factors.py` and those to the
surroundings, F_a, which are what the rows of F lack of 1.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import Field
from scipy.sparse import csr_array

from sparsemor.bodies.body_set import find_surfaces
from sparsemor.bodies.fem.integrals import divided
from sparsemor.bodies.fem.view_factors import Facets, bounded, closed, exchange_areas
from sparsemor.bodies.floating_body import FloatingBody
from sparsemor.bodies.loads.built_load import LoadPart, NumberOrFunction
from sparsemor.bodies.loads.surface_heat import STEFAN_BOLTZMANN
from sparsemor.bodies.mesh.mesh_checks_and_repairs import celsius_notes
from sparsemor.core import (
    Amplitude,
    Csr,
    Effect,
    Equations,
    FloatArray,
    InputError,
    IntArray,
    LoadPlugin,
    Note,
    Part,
    ReducedTerm,
    Term,
    Trial,
    information,
)
from sparsemor.core.protocols.poses import points_in_space
from sparsemor.core.protocols.term import ResidualTerm

OPEN = 0.1
"""Largest share of 1 that a row of view factors of a closed cavity may lack before correction."""
MOST = 2000
"""Largest number of straight facets whose view factors are computed."""


@dataclass(frozen=True, slots=True, eq=False)
class Exchange:
    """Heat, W, by radiation of patches in some rows: shares q, with the net heat q = G T^4 + g
    T_a^4 (P,), W/m2, that patches with the mean temperatures T (P,), K, lose.

    G (P, P), g (P,), W/(m2 K^4): grey exchange with each other and with the surroundings at T_a.
    T = offset + W x + given: W (P, n), of the unknowns x, offset (P,), given: shapes (P,) and
    functions of time of the parts that are prescribed. shares (m, P): area, m2, of each patch at
    each row.
    """

    G: FloatArray
    g: FloatArray
    surroundings: Amplitude
    given: Sequence[tuple[FloatArray, Amplitude]]
    W: FloatArray
    offset: FloatArray
    shares: FloatArray

    def temperatures(self, x: FloatArray, t: float) -> FloatArray:
        """(P,) mean temperatures of the patches, K."""
        T = self.offset + self.W @ x
        for shape, f in self.given:
            T = T + shape * f(t)
        return T

    def heat(self, x: FloatArray, t: float) -> FloatArray:
        """(m,) heat lost in each row, W."""
        q = self.G @ self.temperatures(x, t) ** 4 + self.g * self.surroundings(t) ** 4
        return np.asarray(self.shares @ q)

    def slopes(self, x: FloatArray, t: float) -> FloatArray:
        """(m, n) derivatives of the heat by the unknowns, W/K."""
        return np.asarray(self.shares @ (4.0 * self.G * self.temperatures(x, t) ** 3) @ self.W)


class Radiating(ResidualTerm):
    """Heat lost by radiation, W, on the left-hand side, of all unknowns or of reduced ones;
    elements: number of patches, of which one evaluation needs all."""

    __slots__ = ()
    exchange: Exchange

    @property
    def elements(self) -> int:
        return len(self.exchange.W)

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        return self.exchange.heat(x, t)


@dataclass(frozen=True, slots=True, eq=False)
class CavityTerm(Radiating, Term):
    """Heat lost by radiation in the rows (m,) of temperatures, of temperatures in the columns (n,):
    shares (G T^4 + g T_a^4), with the mean temperatures T = offset + W x + given of the patches, W
    (patches, n), shares (m, patches)."""

    rows: IntArray
    columns: IntArray
    exchange: Exchange
    source: str = ""

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Csr:
        return csr_array(self.exchange.slopes(x, t))

    def restrict(self, keep: IntArray) -> Self:
        return replace(self, rows=self.rows[keep], exchange=replace(
            self.exchange, shares=self.exchange.shares[keep]))

    def compress(self, trial: Trial, left: FloatArray) -> "ReducedCavity":
        of = self.exchange
        return ReducedCavity(replace(
            of, W=of.W @ trial.atoms, offset=of.offset + of.W @ trial.offset,
            shares=left @ of.shares), self.source)


@dataclass(frozen=True, slots=True, eq=False)
class ReducedCavity(Radiating, ReducedTerm):
    """Projected radiation, which is evaluated at the patches alone."""

    exchange: Exchange
    source: str = ""

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> FloatArray:
        return self.exchange.slopes(x, t)


def nothing(t: float) -> float:
    """Temperature of surroundings that a closed cavity does not see, K."""
    return 0.0


class CavityRadiation(LoadPlugin):
    """Radiation between surfaces: each facet radiates outwards from its body, reflects diffusely,
    and is in the shadow of the other facets that are named. View factors are those of the start."""

    acts_on: ClassVar[Effect] = "temperature"
    levels: ClassVar[tuple[str, ...]] = ("surroundings",)

    on: Annotated[list[str], Field(min_length=1)]
    """Surfaces `body:set`, all in the plane (per unit depth) or all in space."""
    emissivity: float = Field(gt=0, le=1)
    """Emissivity of the surfaces."""
    emissivities: dict[str, Annotated[float, Field(gt=0, le=1)]] = {}
    """Other emissivities of some of the surfaces, `body:set`."""
    surroundings: NumberOrFunction | None = None
    """Temperature of what is seen through the openings, K, a number or a function of time; when not
    given, the surfaces enclose the cavity, and all radiation from one meets another."""
    patches: int = Field(default=40, ge=1, le=400)
    """Number of patches of all surfaces, each with one mean temperature."""
    seed: int = Field(default=0, ge=0)
    """Seed of the rays that find shadows."""

    def build(self, name: str, parts: Mapping[str, Part]) -> LoadPart:
        """The exchange between patches of the surfaces, with view factors at the initial position.
        S: A_i F_ij; eps, areas (m or m2): of the patches; G, g: of q = G T^4 + g T_a^4."""
        surfaces = find_surfaces(parts, self.on, "thermal")
        unknown = sorted(set(self.emissivities) - set(self.on))
        if unknown:
            raise InputError(f"{unknown[0]!r} is none of the surfaces in `on`",
                             f"emissivities.{unknown[0]}")
        bodies = {body.name: body for body, _, _ in surfaces}
        self._check(bodies)
        nodes, corners = [], []  # of the straight facets of each surface, in space at the start
        for body, mesh, facets in surfaces:
            facet_nodes = divided(mesh, facets)
            nodes.append(facet_nodes)
            X = points_in_space(np.tile(body.pose, (len(body.X), 1)), body.X)
            corners.append(X[facet_nodes])
        straight = Facets.from_corners(np.concatenate(corners))
        if len(straight.areas) > MOST:
            raise InputError(f"{len(straight.areas)} straight facets, of which view factors of at "
                             f"most {MOST} are computed: name smaller surfaces, or coarser ones",
                             "on")
        of = np.repeat(np.arange(len(surfaces)), [len(n) for n in nodes])  # surface of each facet
        patch = patches_of(straight, of, max(self.patches, len(surfaces)))
        areas = np.bincount(patch, straight.areas).astype(np.float64)
        S, notes = self._view_factors(name, straight, patch, areas)
        eps = np.zeros(len(areas))
        eps[patch] = np.array([self.emissivities.get(text, self.emissivity)
                               for text in self.on])[of]
        G, g = (STEFAN_BOLTZMANN * c for c in grey(S / areas[:, None], eps))
        loads = [(body, nodal_areas(body, surfaces, nodes, straight, patch, of)) for body in
                 bodies.values()]
        depth = surfaces[0][0].thickness
        ambient = nothing if self.surroundings is None else self.surroundings.value

        def write(equations: Equations) -> None:
            write_cavity(equations, loads, areas, depth, G, g, equations.over_steps(ambient))

        celsius = () if self.surroundings is None else celsius_notes(
            name, ambient(0.0), {n: b.T0 for n, b in bodies.items()},
            {n: b.T_ref for n, b in bodies.items()})
        return LoadPart(name, write, surroundings=None if self.surroundings is None else ambient,
                        notes=(*celsius, *notes, *_moving(name, bodies)))

    def _check(self, bodies: Mapping[str, FloatingBody]) -> None:
        """InputError for bodies that cannot radiate to each other."""
        if any(b.revolved for b in bodies.values()):
            raise InputError("view factors of axisymmetric bodies are not those of their section: "
                             "take radiation", "on")
        if len({b.d for b in bodies.values()}) > 1:
            raise InputError("bodies in the plane and in space cannot radiate to each other", "on")
        if len({b.thickness for b in bodies.values()}) > 1:
            raise InputError("the bodies have different thicknesses: what leaves one would not "
                             "arrive at the other", "on")

    def _view_factors(
        self, name: str, facets: Facets, patch: IntArray, areas: FloatArray
    ) -> tuple[FloatArray, tuple[Note, ...]]:
        """A_i F_ij (P, P), m2 or m, after correction, and a note that gives it. patch (n,): number
        of the patch of each facet, areas (P,): of the patches. Row sums of F_ij are 1 in a closed
        cavity (`closed`), with surroundings at most 1 (`bounded`): the rest reaches these."""
        S = exchange_areas(facets, patch, self.seed)
        sums = S.sum(axis=1) / areas
        if self.surroundings is None and sums.min() < 1.0 - OPEN:
            worst = facets.corners[patch == sums.argmin()].mean(axis=(0, 1))
            where = ", ".join(f"{c:.4g}" for c in worst)
            raise InputError(
                f"the cavity is open: the view factors of the patch at ({where}) m add up to "
                f"{sums.min():.3g}; name all surfaces around it, which face inwards, or give the "
                "temperature of the surroundings", "on")
        made = bounded(S, areas) if self.surroundings is not None else closed(S, areas)
        change = float(np.abs(made.sum(axis=1) / areas - sums).max())
        seen = "" if self.surroundings is None else (
            f"; {1.0 - float(made.sum() / areas.sum()):.3g} of the radiation leaves")
        return made, (information(
            f"loads.{name}: {len(areas)} patches of {len(facets.areas)} facets; the sums of view "
            f"factors were corrected by up to {change:.2g}{seen}", "view_factors"),)


def _moving(name: str, bodies: Mapping[str, FloatingBody]) -> tuple[Note, ...]:
    moving = [n for n, b in bodies.items() if b.moves or b.guide is not None]
    return () if len(bodies) == 1 or not moving else (information(
        f"loads.{name}: the view factors are those of the start, also where {', '.join(moving)} "
        "moves", "fixed_view_factors"),)


def patches_of(facets: Facets, of: IntArray, count: int) -> IntArray:
    """(n,) number of the patch of each facet: surfaces `of` (n,), of which the patch with the
    largest area times extent (of places and normals) is cut in two by its mean, until there are
    `count`."""
    # places and normals of the facets, without units
    z = np.concatenate([facets.corners.mean(axis=1) / facets.size, facets.normals], axis=1)

    def spread(here: IntArray) -> float:
        return float(facets.areas[here].sum() * np.ptp(z[here], axis=0).max())

    groups = [np.flatnonzero(of == i) for i in range(int(of.max()) + 1)]
    while len(groups) < count:
        at = max(range(len(groups)), key=lambda k: spread(groups[k]))
        here = groups[at]
        along = z[here, np.ptp(z[here], axis=0).argmax()]
        low = along <= np.average(along, weights=facets.areas[here])
        if spread(here) <= 0.0 or low.all():  # no patch can be cut any more
            break
        groups[at : at + 1] = [here[low], here[~low]]
    patch = np.zeros(len(of), np.int64)
    for i, here in enumerate(groups):
        patch[here] = i
    return patch


def grey(F: FloatArray, eps: FloatArray) -> tuple[FloatArray, FloatArray]:
    """G (P, P) and g (P,) of q = G E + g E_a: net heat lost by patches with emissive powers E of a
    black body, in surroundings with E_a.

    With J = R (eps E + (1 - eps) F_a E_a), R = (1 - (1 - eps) F)^-1, and H = F J + F_a E_a: q = (1
    - F) J - F_a E_a (module docstring); F (P, P): view factors, eps (P,): emissivities.
    """
    one, outside = np.eye(len(F)), np.maximum(0.0, 1.0 - F.sum(axis=1))
    R = np.linalg.inv(one - (1.0 - eps)[:, None] * F)
    net = one - F
    return net @ R * eps, net @ R @ ((1.0 - eps) * outside) - outside


def nodal_areas(
    body: FloatingBody, surfaces: Sequence[tuple[FloatingBody, object, IntArray]],
    nodes: Sequence[IntArray], facets: Facets, patch: IntArray, of: IntArray,
) -> FloatArray:
    """(N, P) area of each patch at each node of a body, m or m2: equal shares of the corners of its
    straight facets. surfaces: body, mesh and facets of each; nodes: corners (f, d) of the straight
    facets of each surface, `facets` one surface after the other; patch, of (n,): patch and surface
    of each facet."""
    found = np.zeros((len(body.X), int(patch.max()) + 1))
    for i, (owner, _, _) in enumerate(surfaces):
        if owner.name == body.name:
            here = of == i
            np.add.at(found, (nodes[i], patch[here][:, None]),
                      facets.areas[here][:, None] / facets.d)
    return found


def write_cavity(
    equations: Equations, loads: Sequence[tuple[FloatingBody, FloatArray]], areas: FloatArray,
    depth: float, G: FloatArray, g: FloatArray, ambient: Amplitude,
) -> None:
    """Adds the exchange to the temperatures of all bodies, with nodal areas (N, P) each.

    areas (P,): of the patches, m2 or in the plane m, with the thickness `depth`, m; G, g: as in
    `Exchange`; ambient: temperature of the surroundings, K. A patch's temperature is the mean over
    its nodal areas, of unknown and of prescribed temperatures.
    """
    numbers, shares, given, blocks = [], [], [], []
    for body, nodal in loads:
        assert body.heat is not None
        free = nodal[body.heat.free]
        used = np.flatnonzero(free.any(axis=1))
        if len(used):
            blocks.append(f"{body.name}.thermal")
            numbers.append(equations.numbers(blocks[-1])[used])
            shares.append(free[used])
        for at, function, shape in body.heat.prescribed:
            mean = nodal[at].T @ shape / areas
            if mean.any():
                given.append((mean, function.value))
    if not blocks:
        return
    at, S = np.concatenate(numbers), np.concatenate(shares)
    equations.local(blocks, CavityTerm(at, at, Exchange(
        G, g, surroundings=ambient, given=tuple(given), W=S.T / areas[:, None],
        offset=np.zeros(len(areas)), shares=depth * S)))
