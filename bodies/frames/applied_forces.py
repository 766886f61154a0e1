"""Loads on a body as parts of its frame's equations: forces and moments in space axes and in body
axes, and prescribed reactions of joints (notation: frame_items.py)."""

from dataclasses import dataclass, replace

from sparsemor.bodies.frames import plane_items as plane
from sparsemor.bodies.frames import space_items as spatial
from sparsemor.bodies.frames.frame_items import AXES, EYE, Item
from sparsemor.bodies.frames.motion import Motion, Moved, Pushed, Sums
from sparsemor.core import Amplitude, FloatArray, Table


@dataclass(frozen=True, slots=True, eq=False)
class SpaceForce(Item):
    """Nodal weights times one force in space axes (for gravity the weights are nodal masses).

    total = sum w, arm (d,) = sum w X, force (d,) per unit weight, N.
    """

    total: float
    arm: FloatArray
    force: FloatArray
    amplitude: Amplitude
    others = 0
    pushes = True

    @property
    def directions(self) -> int:
        return len(self.arm)

    def names(self, source: str) -> tuple[str, ...]:
        return tuple(f"{source} {a}" for a in AXES[: self.directions])

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "SpaceForce":
        return replace(self, arm=self.arm + s)

    def in_plane(self) -> plane.PlanePart:
        return plane.PlanePart(plane.space_force, (
            float(self.total), *self.arm.tolist(), *self.force.tolist()), self.amplitude)

    def in_space(self) -> tuple[spatial.SpacePart, ...]:
        return (spatial.SpacePart(spatial.space_force, (
            float(self.total), *self.arm.tolist(), *self.force.tolist()), self.amplitude),)

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        """Adds minus the force f sum w, and minus its generalized force f . d (A z) / dq, z = sum w
        (X + u), with derivatives: loads are subtracted on the left-hand side. q: attitude
        coordinates, entries m.at of the rows. Functionals from j on: sum w u (3,); o, k: not used.
        total = sum w, self.arm = sum w X; f: force per unit weight at the time m.t, space axes.
        """
        f = self.amplitude(m.t) * self.force
        arm = self.arm + m.s[j : j + 3] if m.elastic else self.arm
        out.rows[:3] -= self.total * f
        out.rows[m.at] -= f.dot(m.turn.of_body(arm))
        out.H[m.at, m.at] -= m.turn.bend(f, arm)  # second derivative of f . A z by q
        if m.elastic:
            at = slice(j, j + 3)
            self.push(m, j, out)
            # sigma = -A^T f: factors of the functionals s in the elastic rows; sigma_y: their
            # derivatives by y, tau: d rows / ds
            out.sigma_y[m.at, at] = out.tau[m.at, at] = -m.turn.of_space(f).T

    def push(self, m: Moved, j: int, out: Pushed) -> None:
        out.sigma[..., j : j + 3] = -m.factor(self.amplitude) * m.in_body(self.force)


@dataclass(frozen=True, slots=True, eq=False)
class BodyForce(Item):
    """Nodal load that rotates with the body: total (d,) = sum f, N; arm (r,) = sum X x f, N m; r =
    1 in the plane, 3 in space.

    Functionals of the displacements u, from number j on: f.u of the load itself, and the r
    components of sum u x f. Loads are subtracted on the left-hand side, hence the minus signs.
    """

    total: FloatArray
    arm: FloatArray
    amplitude: Amplitude
    others = 0
    pushes = True

    @property
    def directions(self) -> int:
        return 1 + len(self.arm)

    def names(self, source: str) -> tuple[str, ...]:
        return (source, *("" for _ in self.arm))

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "BodyForce":
        return replace(self, arm=self.arm + s[1:])

    def in_plane(self) -> plane.PlanePart:
        return plane.PlanePart(plane.body_force, (
            *self.total.tolist(), float(self.arm[0])), self.amplitude)

    def in_space(self) -> tuple[spatial.SpacePart, ...]:
        return (spatial.SpacePart(
            spatial.body_force, (*self.total.tolist(), *self.arm.tolist()), self.amplitude),)

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        """Adds minus the force A sum f and minus the torque sum z x f in body axes, z = X + u."""
        g = self.amplitude(m.t)
        out.rows[:3] -= g * m.A.dot(self.total)
        out.H[:3, m.at] -= g * m.turn.of_body(self.total)
        out.torque -= g * (self.arm + m.s[j + 1 : j + 4] if m.elastic else self.arm)
        if m.elastic:
            self.push(m, j, out)
            out.torque_s[:, j + 1 : j + 4] = -g * EYE  # derivative of the torque by sum u x f

    def push(self, m: Moved, j: int, out: Pushed) -> None:
        # sigma: factors of the functionals in the elastic rows
        out.sigma[..., j : j + 1] = -m.factor(self.amplitude)


@dataclass(frozen=True, slots=True, eq=False)
class Moment(Item):
    """Moment (r,), N m, on the body or, with `turns`, on the mean rotation of a set of its points,
    in axes of the body or of space; functionals: that mean rotation, in the plane followed by 0."""

    moment: FloatArray
    amplitude: Amplitude
    turns: bool
    space: bool
    others = 0
    pushes = True

    @property
    def directions(self) -> int:
        return 0 if not self.turns else 3 if len(self.moment) == 3 else 2

    def names(self, source: str) -> tuple[str, ...]:
        if not self.turns:
            return ()
        return (source, "") if len(self.moment) == 1 else tuple(f"{source} {a}" for a in AXES)

    def in_plane(self) -> plane.PlanePart:
        return plane.PlanePart(
            plane.moment, (float(self.moment[0]), float(self.turns)), self.amplitude)

    def in_space(self) -> tuple[spatial.SpacePart, ...]:
        return (spatial.SpacePart(spatial.moment, (
            *self.moment.tolist(), float(self.turns), float(self.space)), self.amplitude),)

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        """Subtracts the moment, in body axes A^T M if it is given in space axes, with its
        derivatives by the attitude. With `turns` it acts on the mean rotation (3,) of a set, the
        functionals from j on, which the rows do not depend on (tau = 0); o, k: not used.

        sigma (`push`): factors of the functionals s in the elastic rows; sigma_y: d sigma / dy,
        tau: d rows / ds, neither of which is cleared before; torque, in body axes on the left-hand
        side, and torque_y: d torque / dy.
        """
        M, acts = self.amplitude(m.t) * self.moment, self.turns and m.elastic
        out.torque -= m.in_body(M) if self.space else M
        if acts:
            self.push(m, j, out)
            out.sigma_y[:, j : j + 3] = out.tau[:, j : j + 3] = 0.0
        if self.space:
            by_attitude = m.turn.of_space(M)
            out.torque_y[:, m.at] -= by_attitude
            if acts:
                out.sigma_y[m.at, j : j + 3] = -by_attitude.T

    def push(self, m: Moved, j: int, out: Pushed) -> None:
        if self.turns:
            M = m.in_body(self.moment) if self.space else self.moment
            out.sigma[..., j : j + 3] = -m.factor(self.amplitude) * M


@dataclass(frozen=True, slots=True, eq=False)
class Reaction(Item):
    """Prescribed joint force (N) on the mean point of a set and, with `turns`, moment (N m) on its
    mean rotation: table (T, d + r), space axes.

    For a frame with prescribed motion, whose rigid equations are not solved: it acts on
    displacements alone. Functionals from number j on: mean displacement and, with `turns`, mean
    rotation, d each. The sign is that of multipliers, which stand on the left-hand side: sigma, the
    factors of the functionals in the elastic rows, are plus the table's values in body axes.
    others: coordinates of another body that it reads; pushes: `push` gives its loads on
    displacements under prescribed motion.
    """

    forces_at: Table
    turns: bool
    others = 0
    pushes = True

    @property
    def directions(self) -> int:
        d = 3 if self.forces_at.values.shape[1] == 6 else 2
        return 2 * d if self.turns else d

    def names(self, source: str) -> tuple[str, ...]:
        d = self.directions // 2 if self.turns else self.directions
        force = tuple(f"{source} {a}" for a in AXES[:d])
        turn = tuple(f"{source} turn {a}" for a in AXES) if d == 3 else (f"{source} turn", "")
        return force + turn if self.turns else force

    def in_plane(self) -> plane.PlanePart:
        return plane.PlanePart(plane.PlaneReaction(self.forces_at, self.turns), ())

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        if m.elastic:
            self.push(m, j, out)

    def push(self, m: Moved, j: int, out: Pushed) -> None:
        """Writes the force and, with `turns`, the moment, in body axes."""
        values = m.tabled(self.forces_at)
        for i in range(0, self.directions, 3):
            out.sigma[..., j + i : j + i + 3] = m.in_body(values[..., i : i + 3])
