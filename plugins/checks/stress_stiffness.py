"""Limits of linear strains: change of a body's stiffness by its stress, relative to its stiffness.

With the stiffness K of the body under its reference condition, and the geometric stiffness K_s of
the stress of a state, the eigenvalue of largest magnitude of

    K_s phi = mu K phi

shows both limits of linear strains, which leave K_s out. mu < 0: the body is compressed to -mu
times its buckling load, and its deflection is 1 / (1 + mu) times the linear one. mu > 0: tension,
as of spin, stiffens it by the share mu.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import inf

import numpy as np
from scipy.linalg import eigh
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh

from sparsemor.core import (
    Check,
    Csr,
    Factorized,
    Findings,
    FloatArray,
    Model,
    Note,
    OfflineProducts,
    PreparedRun,
    Quantity,
    RunResult,
    Scene,
    SolveFailed,
    Status,
)
from sparsemor.core.model.factorizations import BlockSolvers, solve_or_fail
from sparsemor.core.protocols.poses import angle_between
from sparsemor.core.protocols.separable import MovingBody, StressStiffness
from sparsemor.plugins.checks import place
from sparsemor.plugins.checks.plausibility import checked_steps

LINEAR_STRAINS, BUCKLED = "linear_strains", "buckled"
"""Identifiers of the warnings."""
LIMIT = 0.05
"""Relative change of stiffness, and so about the relative error of displacements, from which there
is a warning."""
DENSE = 50
"""Number of unknowns up to which eigenvalues are those of dense matrices."""
SPINS = 0.05
"""Spin relative to the lowest natural frequency from which it is a cause of tension."""
FAR = 4.0
"""Margin for states of another shape."""
ACCURACY = 1e-2
"""Relative accuracy of eigenvalues."""


class StressStiffening(Check):
    """Stress that changes the stiffness of a body with linear strains, or buckles it."""

    order = place("stress_stiffness")

    def on_training(self, scene: Scene, model: Model, offline: OfflineProducts) -> list[Note]:
        if scene.check_strains == "off":
            return []
        return [Note(text, BUCKLED) for text in buckled_in_training(model, offline)]

    def after_run(self, run: PreparedRun, result: RunResult) -> Findings:
        """Notes on stiffness that stress changes; a failure of the run where the scene refuses
        them."""
        if run.model is None or run.scene.check_strains == "off":
            return Findings()
        notes = tuple(stress_notes(run.model, result))
        refused = [n for n in notes if n.kind == LINEAR_STRAINS]
        if not refused or run.scene.check_strains != "refuse":
            return Findings(notes)
        end = float(result.times[-1])
        return Findings(notes, failure=SolveFailed(
            Status.OUTSIDE_THEORY, end, "", refused[0].text))


@dataclass(frozen=True, slots=True, eq=False)
class Ratio:
    """Largest change of a body's stiffness by its stress: mu of the state at time t, s; K (n, n),
    its stiffness, with its factorization."""

    mu: float
    t: float
    K: Csr
    factor: Factorized


def stress_notes(model: Model, result: RunResult) -> Iterator[Note]:
    """Warnings about bodies with linear strains whose stress changes their stiffness by more than
    `LIMIT`, and about bodies with nonlinear ones that are compressed beyond their buckling load.
    mu: relative change of stiffness, above 0 in tension, -1 at the buckling load."""
    for body in model.separated.moving:
        ops = body.operators
        if ops is None or ops.stress_stiffness is None:
            continue
        found = largest_ratio(model, result, body, ops.stress_stiffness)
        if found is None:
            continue
        if not ops.stress_stiffness.nonlinear:
            if abs(found.mu) >= LIMIT:
                yield Note(_linear(result, body, ops.mass, found), LINEAR_STRAINS)
        elif found.mu <= -1.0:
            which = ("its deflections grow without limit there; take "
                     f"bodies.{body.name}.strains: nonlinear") if ops.stress_stiffness.prestressed \
                else ("it has several equilibria, and steps that are long or damped may end at "
                      "another one than the body; compare smaller steps, and give a small load "
                      "across the body that decides to which side it bends")
            yield Note(f"{body.name} is compressed to {-found.mu:.3g} times its buckling load at t "
                       f"= {found.t:.6g} s: {which}", BUCKLED)


def _linear(result: RunResult, body: MovingBody, mass: Csr, found: Ratio) -> str:
    """Text of the note on the change of a body's stiffness by its stress, which linear strains
    neglect: mu of `found`, below 0 in compression (-1 at the buckling load), above 0 in tension.
    mass: mass matrix of the body."""
    mu, size = found.mu, f"{100.0 * abs(found.mu):.2g} %"
    if mu <= -1.0:
        what = (f"is compressed to {-mu:.3g} times its buckling load at t = {found.t:.6g} s: its "
                "shape is unstable there, which linear strains do not show")
    elif mu < 0.0:
        what = (f"is compressed to {size} of its buckling load at t = {found.t:.6g} s: with linear "
                f"strains its deflections may be {size} or more too small")
    else:
        what = (f"is stiffened by {size} at t = {found.t:.6g} s, by its tension: with linear "
                f"strains its deflections may be {size} or more too large")
    spin = largest_spin(result, body.name)
    # lowest natural frequency, rad/s: 1 / w^2 is the largest eigenvalue of M phi = mu K phi
    w = extreme_eigenvalue(mass, found.K, found.factor, body.elastic) ** -0.5
    if spin > SPINS * w:
        what += (f"; it turns at up to {spin:.4g} rad/s, {spin / w:.2g} of its lowest natural "
                 f"frequency of {w / (2.0 * np.pi):.4g} Hz")
    return f"{body.name} {what}; take bodies.{body.name}.strains: nonlinear"


def largest_ratio(
    model: Model, result: RunResult, body: MovingBody, stress: StressStiffness
) -> Ratio | None:
    """Largest change of stiffness, of the checked states with the largest displacements and the
    last; None where no state has a stress, or where a run of the same model before shows that it is
    far below the limit: it is linear in the displacements and temperatures."""
    name = body.name
    hot = result.layout.of(name, Quantity.TEMPERATURE) is not None
    checked = {int(i): result.nodal_displacement(name, int(i))
               for i in checked_steps(result, body.elastic)}
    largest = max(checked, key=lambda i: float(np.linalg.norm(checked[i])))
    states = [(float(result.times[i]), checked[i],
               result.nodal_temperature(name, i) if hot else None)
              for i in sorted({largest, len(result.times) - 1})]
    start = result.nodal_temperature(name, 0) if hot else np.zeros(1)
    moved = float(np.linalg.norm(checked[largest]))
    heated = max(0.0 if T is None else float(np.linalg.norm(T - start)) for _, _, T in states)
    known = model.stress_checks.get(name)  # displacement, heating and |mu| of an earlier run
    if known is not None and max(known[2], 1e-12) * FAR * max(
            _ratio(moved, known[0]), _ratio(heated, known[1])) < LIMIT:
        return None
    found = ratio_of(model, body, stress, states)
    if found is not None:
        model.stress_checks[name] = moved, heated, abs(found.mu)
    return found


def buckled_in_training(model: Model, offline: OfflineProducts) -> tuple[str, ...]:
    """Sentences on bodies with linear strains that their training run compresses beyond their
    buckling load."""
    texts = []
    for body in model.separated.moving if offline.trained else ():
        ops, shape = body.operators, model.shapes().get(body.name)
        if ops is None or ops.stress_stiffness is None or ops.stress_stiffness.nonlinear or (
                shape is None or shape.elastic_dofs is None):
            continue
        moved = offline.snapshots(body.elastic)
        states = []
        for i in {int(np.linalg.norm(moved, axis=0).argmax()), moved.shape[1] - 1}:
            # nodal displacements and temperatures, with prescribed ones as at the start
            u, T = np.zeros(shape.points.shape), None
            u.ravel()[shape.elastic_dofs] = moved[:, i]
            if shape.thermal_nodes is not None:
                T = np.zeros(len(shape.points))
                for nodes, function, share in shape.given:
                    T[nodes] += share * function.value(0.0)
                T[shape.thermal_nodes] = offline.snapshots(body.thermal)[:, i]
            states.append((0.0, u, T))
        found = ratio_of(model, body, ops.stress_stiffness, states)
        if found is not None and found.mu <= -1.0:
            texts.append(f"{body.name} is compressed to {-found.mu:.3g} times its buckling load in "
                         "training: its shape is unstable, which linear strains do not show; take "
                         f"bodies.{body.name}.strains: nonlinear")
    return tuple(texts)


def ratio_of(
    model: Model, body: MovingBody, stress: StressStiffness,
    states: Sequence[tuple[float, FloatArray, FloatArray | None]],
) -> Ratio | None:
    """Largest change of stiffness of states: time, s, displacements (N, d), m, and temperatures
    (N,), K, or None. It is the eigenvalue mu of largest magnitude of K_s phi = mu K phi, K:
    stiffness, K_s: geometric stiffness of the stress. None without a stress, or where K is
    singular."""
    found, factor = None, None
    for t, u, T in states:
        if not np.isfinite(u).all() or not (u.any() or T is not None):
            continue
        K, K_s = stress.matrices(u, T)
        try:
            factor = factor or BlockSolvers(model.linear_solver(body.elastic)).factorize(
                body.elastic, K, model.places(body.elastic), "buckling")
            mu = extreme_eigenvalue(K_s, K, factor, body.elastic)
        except (SolveFailed, ArpackError):  # a reference condition that leaves rigid motion
            return None
        if found is None or abs(mu) > abs(found.mu):
            found = Ratio(mu, t, K, factor)
    return found


def _ratio(size: float, other: float) -> float:
    """size / other, at least 1; infinite where only `other` is 0."""
    return 1.0 if size <= other else size / other if other > 0.0 else inf


def extreme_eigenvalue(A: Csr, K: Csr, factor: Factorized, name: str) -> float:
    """Eigenvalue mu of largest magnitude of A phi = mu K phi, to a hundredth. factor: of K; name:
    of the block. Raises SolveFailed where the factor does not solve, ArpackError where the
    iteration fails."""
    n = K.shape[0]
    if n <= DENSE:
        try:
            values = eigh(A.toarray(), K.toarray(), eigvals_only=True)
        except np.linalg.LinAlgError:
            raise SolveFailed(Status.SINGULAR, 0.0, name) from None
        return float(values[np.abs(values).argmax()])
    solve = LinearOperator((n, n), lambda b: solve_or_fail(
        factor, np.ascontiguousarray(b).reshape(n), name), dtype=np.float64)
    start = np.random.default_rng(0).standard_normal(n)
    return float(eigsh(A, k=1, M=K, Minv=solve, which="LM", tol=ACCURACY, v0=start,
                       return_eigenvectors=False)[0])


def largest_spin(result: RunResult, body: str) -> float:
    """Largest rate of rotation of a body's frame between two stored states, rad/s."""
    block = result.layout.of(body, Quantity.POSE)
    if block is None or len(result.times) < 2:
        return 0.0
    pose = result.block(block.name)
    return float((angle_between(pose[:-1], pose[1:]) / np.diff(result.times)).max())
