"""What the bodies of a model consist of: nodes, unknowns, sets, masses and first frequencies."""

from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.linalg import LinAlgError, eigh
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh

from sparsemor.core.arrays import Csr
from sparsemor.core.model.model import Model
from sparsemor.plugins.publishing.tables import text_table

MODES = 3
"""Number of frequencies of a body."""
DENSE, LARGEST = 200, 30_000
"""Numbers of displacements up to which frequencies are computed by a dense solver, and at all."""


@dataclass(frozen=True, slots=True)
class BodyFacts:
    """A body: number of its nodes, unknowns by field, mass (kg, None if unknown), sets with their
    numbers of points, and lowest natural frequencies, Hz, with the frame held."""

    nodes: int
    unknowns: Mapping[str, int]
    mass: float | None
    sets: Mapping[str, int]
    frequencies: tuple[float, ...]

    def plain(self) -> dict[str, Any]:
        return asdict(self)


def body_facts(model: Model, names: Collection[str]) -> dict[str, BodyFacts]:
    """Body -> what it consists of; names: of the bodies of the scene, without the massless frames
    of joints."""
    found = {}
    moving = {m.name: m for m in model.separated.moving}
    for name, body in ((n, b) for n, b in model.bodies.items() if n in names):
        own, mesh = moving.get(name), body.mesh
        operators = None if own is None else own.operators
        frequencies = () if own is None or operators is None else first_frequencies(
            model, own.elastic, operators.stiffness, operators.mass)
        found[name] = BodyFacts(
            0 if mesh is None else len(mesh.points),
            {b.field: b.size for b in model.layout if b.owner == name and b.kind.order > 0},
            body.total_mass, dict(sorted(body.set_sizes.items())), frequencies)
    return found


def first_frequencies(model: Model, block: str, K: Csr, M: Csr) -> tuple[float, ...]:
    """Lowest natural frequencies, Hz, of an elastic block; () where they are not found, and for
    blocks of more than `LARGEST` unknowns."""
    n = K.shape[0]
    count = min(MODES, n)
    if not 0 < n <= LARGEST:
        return ()
    try:
        if n <= DENSE:
            values = eigh(K.toarray(), M.toarray(), eigvals_only=True,
                          subset_by_index=(0, count - 1))
        else:
            factor = model.factorize(block, K, "frequencies")
            if not factor.status.ok:
                return ()
            values = eigsh(
                K, count, M, sigma=0.0, return_eigenvectors=False,
                OPinv=LinearOperator(K.shape, factor.solve, dtype=np.float64),
                v0=np.random.default_rng(0).standard_normal(n))
    except (ArpackError, LinAlgError, RuntimeError, ValueError):  # mass or stiffness is singular
        return ()
    ordered = np.sort(np.maximum(values, 0.0))
    return tuple(float(v) for v in np.sqrt(ordered) / (2.0 * np.pi))


def in_words(found: Mapping[str, BodyFacts]) -> str:
    """Table of the bodies, and a line for each with its sets."""
    rows = [["body", "nodes", "unknowns", "mass (kg)", "first frequencies (Hz), frame held"]]
    for name, b in found.items():
        rows.append([
            name, str(b.nodes or "-"), ", ".join(f"{k} {n}" for k, n in b.unknowns.items()) or "-",
            "-" if b.mass is None else f"{b.mass:.5g}",
            ", ".join(f"{f:.4g}" for f in b.frequencies) or "-"])
    sets = [f"sets of {name}: " + ", ".join(f"{k} ({n})" for k, n in b.sets.items())
            for name, b in found.items() if b.sets]
    return "\n".join([text_table(rows), *sets])
