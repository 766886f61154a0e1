"""Plane flexible pendulums twice: as a scene, and in absolute coordinates by other equations.

`Pendulum` has nothing in common with the product but the mesh. The unknowns are the positions x_k
of the nodes in space: no floating frame, no rotation, no reference conditions. Total Lagrangian,
constant strain triangles of Saint Venant-Kirchhoff material in plane stress (Belytschko, Liu, Moran
and Elkhodary, Nonlinear Finite Elements for Continua and Structures, 2nd ed. 2014, ch. 4):

    F = sum_k x_k (x) grad N_k,    E = (F^T F - I) / 2,    f_k = -V F S(E) grad N_k

with the consistent mass matrix M. Revolute joints between mean points are linear in x: C x = const,
so x'' = M^-1 (f + C^T lambda) with C x'' = 0 is x'' = P f with a constant matrix P. Integrated with
the classical explicit Runge-Kutta method of order 4, so nothing is iterated. All in SI units.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sparsemor.bodies.floating_body import FloatingBody
from sparsemor.core import FloatArray, IntArray
from sparsemor.core.testing.in_memory_run import March, march, scene_of

G = 9.81
NU, RHO, THICKNESS = 0.3, 1000.0, 0.03
BAR = {"use": "rectangle", "lower": [-0.1, -0.1], "size": [1.2, 0.2], "divisions": [12, 2],
       "diagonal": "alternating"}
SETS = {"chord_a": {"nearest": [0, 0]}, "chord_b": {"nearest": [1, 0]},
        "bore_a": {"box": [[-0.11, 0.11], [-0.11, 0.11]]},
        "bore_b": {"box": [[0.89, 1.11], [-0.11, 0.11]]}}


def swing(links: int, E: float, h: float, end: float, interval: float) -> March:
    """The product's run of one bar of 1 m between its joints, or of two, from rest, level (the
    second 5 degrees above), under gravity; states `interval` s apart. Undamped, second order."""
    bar = {"use": "flexible", "mesh": BAR, "sets": SETS, "thickness": THICKNESS,
           "material": {"E": E, "nu": NU, "rho": RHO}, "fields": ["elastic"],
           "reference": {"chord": ["chord_a", "chord_b"]}}
    bodies: dict[str, Any] = {"link1": bar}
    joints = {"A": {"use": "revolute", "between": ["ground", "link1:bore_a"]}}
    if links == 2:
        angle = float(np.radians(5.0))
        bodies["link2"] = {**bar, "pose": {"position": [1, 0], "angle": angle}}
        joints["B"] = {"use": "revolute", "between": ["link1:bore_b", "link2:bore_a"]}
    return march(scene_of({
        "bodies": bodies, "joints": joints,
        "loads": {"gravity": {"use": "gravity", "g": [0.0, -G]}},
        "time": {"end": end, "step": h},
        "integrator": {"use": "generalized_alpha", "rho_inf": 1.0}}), every=round(interval / h))


def bodies_of(run: March) -> list[FloatingBody]:
    return [part for part in run.model.parts.values() if isinstance(part, FloatingBody)]


def nodes_of(body: FloatingBody, name: str) -> IntArray:
    """The points of a set."""
    return body.named(name, name)


def displacements(run: March, body: FloatingBody) -> FloatArray:
    """Nodal displacements (M, N, 2) in the body frame, m."""
    assert body.elasticity is not None
    u = np.zeros((len(run.t), 2 * len(body.X)))
    u[:, body.elasticity.free] = run.block(f"{body.name}.elastic")
    return u.reshape(len(run.t), -1, 2)


def positions(run: March, body: FloatingBody) -> FloatArray:
    """Nodal positions (M, N, 2) in space, m."""
    q, z = run.block(f"{body.name}.rigid"), body.X + displacements(run, body)
    c, s = np.cos(q[:, 2]), np.sin(q[:, 2])
    turn = np.stack([np.stack([c, -s], axis=1), np.stack([s, c], axis=1)], axis=1)
    found: FloatArray = q[:, None, :2] + np.einsum("tij,tnj->tni", turn, z)
    return found


def tip(run: March) -> FloatArray:
    """Positions (M, 2) of the far end of the last link's chord, m."""
    body = bodies_of(run)[-1]
    return positions(run, body)[:, nodes_of(body, "chord_b")[0]]


@dataclass(frozen=True, slots=True)
class Link:
    """A body: points (N, 2), m, in space, undeformed; triangles (E, 3); ends: the two sets of
    points, whose triangles' centres of area are joined."""

    points: FloatArray
    triangles: IntArray
    ends: tuple[IntArray, IntArray]

    def centre(self, end: int) -> FloatArray:
        """Weights (N,) of the points in the centre of an end."""
        inside = np.zeros(len(self.points), dtype=np.bool_)
        inside[self.ends[end]] = True
        own = self.triangles[inside[self.triangles].all(axis=1)]
        corners, weights = self.points[own], np.zeros(len(self.points))
        area = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
        np.add.at(weights, own, area[:, None])
        return np.asarray(weights / weights.sum())


@dataclass(frozen=True, slots=True)
class Material:
    E: float
    nu: float
    rho: float
    thickness: float


class Pendulum:
    """A chain of links: the first end of the first link fixed in space, the others joined in turn.

    start: positions (N, 2) of all points; gradients (E, 3, 2) of the shape functions, 1/m; volumes
    (E,), m3; mass (N, N), kg; P (N, N): accelerations of a force that the joints allow.
    """

    def __init__(self, links: list[Link], material: Material, g: float) -> None:
        first = np.cumsum([0, *(len(link.points) for link in links)])
        self.first = first
        self.start = np.concatenate([link.points for link in links])
        self.triangles = np.concatenate(
            [link.triangles + n for link, n in zip(links, first, strict=False)])
        corners = self.start[self.triangles]
        sides = (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
        inverse = np.linalg.inv(sides)
        self.gradients = np.concatenate([-inverse.sum(axis=1, keepdims=True), inverse], axis=1)
        self.volumes = material.thickness * np.abs(np.linalg.det(sides)) / 2
        factor = material.E / (1 - material.nu**2)
        self.lame = factor * material.nu, factor * (1 - material.nu)  # S = a tr(E) I + b E

        n = len(self.start)
        self.mass = np.zeros((n, n))
        for i in range(3):
            for j in range(3):
                np.add.at(self.mass, (self.triangles[:, i], self.triangles[:, j]),
                          material.rho * self.volumes * (2 if i == j else 1) / 12)
        joints = np.zeros((len(links), n))
        for k, link in enumerate(links):
            joints[k, first[k] : first[k + 1]] = link.centre(0)
            if k:
                joints[k, first[k - 1] : first[k]] = -links[k - 1].centre(1)
        inverse_mass = np.linalg.inv(self.mass)
        allowed = inverse_mass @ joints.T
        self.P = inverse_mass - allowed @ np.linalg.solve(joints @ allowed, allowed.T)
        self.gravity = self.mass.sum(axis=1)[:, None] * [0.0, -g]
        self.scatter = np.zeros((n, 3 * len(self.triangles)))
        self.scatter[self.triangles.ravel(), np.arange(3 * len(self.triangles))] = 1.0

    def stresses(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Deformation gradients, strains and stresses (E, 2, 2)."""
        F = x[self.triangles].transpose(0, 2, 1) @ self.gradients
        strain = (F.transpose(0, 2, 1) @ F - np.eye(2)) / 2
        a, b = self.lame
        trace = strain[:, 0, 0] + strain[:, 1, 1]
        return F, strain, a * trace[:, None, None] * np.eye(2) + b * strain

    def acceleration(self, x: FloatArray) -> FloatArray:
        F, _, S = self.stresses(x)
        forces = -self.volumes[:, None, None] * (self.gradients @ (F @ S).transpose(0, 2, 1))
        return self.P @ (self.scatter @ forces.reshape(-1, 2) + self.gravity)

    def energy(self, x: FloatArray, v: FloatArray) -> float:
        """Kinetic, elastic and potential, J."""
        _, strain, S = self.stresses(x)
        elastic = (self.volumes * (strain * S).sum(axis=(1, 2))).sum() / 2
        return float((v * (self.mass @ v)).sum() / 2 + elastic - (self.gravity * x).sum())

    def fall(self, h: float, steps: int, every: int) -> tuple[FloatArray, FloatArray]:
        """From rest: positions (M, N, 2) of every `every`-th step, and the energies (M,) there."""
        x, v = self.start, np.zeros_like(self.start)
        kept, energies = [x], [self.energy(x, v)]
        for n in range(1, steps + 1):
            a1 = self.acceleration(x)
            v2 = v + h / 2 * a1
            a2 = self.acceleration(x + h / 2 * v)
            v3 = v + h / 2 * a2
            a3 = self.acceleration(x + h / 2 * v2)
            v4 = v + h * a3
            a4 = self.acceleration(x + h * v3)
            x = x + h / 6 * (v + 2 * v2 + 2 * v3 + v4)
            v = v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
            if n % every == 0:
                kept.append(x)
                energies.append(self.energy(x, v))
        return np.stack(kept), np.array(energies)

    def fastest(self) -> float:
        """Bound on the largest angular frequency, rad/s: h below 2.8 / it is stable. The largest of
        the free elements' (Irons and Treharne), of which the joints take some away."""
        a, b = self.lame
        worst = 0.0
        for G in self.gradients:
            B = np.zeros((3, 6))
            B[0, 0::2], B[1, 1::2] = G[:, 0], G[:, 1]
            B[2, 0::2], B[2, 1::2] = G[:, 1], G[:, 0]
            D = np.array([[a + b, a, 0], [a, a + b, 0], [0, 0, b / 2]])
            m = np.kron(np.linalg.inv((np.ones((3, 3)) + np.eye(3)) / 12), np.eye(2))
            worst = max(worst, float(np.abs(np.linalg.eigvals(m @ B.T @ D @ B)).max()))
        density = self.mass.sum() / self.volumes.sum()
        return float(np.sqrt(worst / density))


def absolute(run: March, E: float) -> tuple[Pendulum, int]:
    """The same pendulum in absolute coordinates, from the meshes of a run, and its tip's number."""
    bodies = bodies_of(run)
    links = []
    for body in bodies:
        assert body.mesh is not None
        links.append(Link(positions(run, body)[0], body.mesh.cells,
                          (nodes_of(body, "bore_a"), nodes_of(body, "bore_b"))))
    made = Pendulum(links, Material(E, NU, RHO, THICKNESS), G)
    return made, int(made.first[len(bodies) - 1] + nodes_of(bodies[-1], "chord_b")[0])


def absolute_tip(
    run: March, E: float, end: float, interval: float, halved: int = 0
) -> tuple[FloatArray, float]:
    """Positions (M, 2) of the tip, `interval` s apart, and the step: the largest stable one that
    divides the interval, halved so many times."""
    other, at = absolute(run, E)
    each = int(np.ceil(interval * other.fastest() / 2.2)) * 2**halved
    x, _ = other.fall(interval / each, round(end / interval) * each, each)
    return x[:, at], interval / each
