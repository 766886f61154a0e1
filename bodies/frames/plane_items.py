"""Parts of a planar frame's equations in complex numbers: inertia, forces, attachments,
constraints.

Each adds its force and torque to `total` (rows 0-2, then H02, H12, H20, H21, H22, H00 = H11) and
writes its own columns: pairs of functionals from number j on, coordinates of another body from o
on, multipliers from k on. The data are those of the classes of the same names in items.py,
inertia.py and constraints.py, whose `in_plane` creates them; notation: plane_motion.py.
"""

from cmath import exp
from dataclasses import dataclass
from typing import Protocol

from sparsemor.bodies.frames.plane_motion import Motion, Views
from sparsemor.core import Amplitude, Table


class PlaneItem(Protocol):
    """A part of a planar frame's equations, in complex numbers."""

    def evaluate(
        self, m: Motion, j: int, o: int, k: int, total: list[float], out: Views
    ) -> None: ...


@dataclass(frozen=True, slots=True)
class Inertia:
    """Inertia of a body in the plane: mass (kg), moment = sum m X (kg m), inertia = X.M X (kg m^2)
    about the frame origin.

    Two pairs of functionals: S = m 1 (first moment) and M X (equations.md, section 1).
    """

    mass: float
    moment: complex
    inertia: float

    def evaluate(self, m: Motion, j: int, o: int, k: int, total: list[float], out: Views) -> None:
        """Adds the inertia force A sum(M acc) and torque sum z x M acc, with acc = A^T R'' + ... .
        """
        e, ec, w, al, c1, c2 = m.e, m.ec, m.w, m.al, m.c1, m.c2
        spin = complex(-w * w, al)
        p, p1, p2, zz, zv, za = self._sums(m, j)
        swing = e * (spin * p + 2j * w * p1 + p2)
        f = self.mass * m.acc + swing
        lever = p.conjugate() * ec
        arm = lever * m.acc
        df = 1j * swing + e * (complex(-2 * w * c1, c2) * p + 2j * c1 * p1)
        total[0] += f.real
        total[1] += f.imag
        total[2] += arm.imag + al * zz + 2 * w * zv + za
        total[3] += df.real
        total[4] += df.imag
        total[5] += c2 * lever.imag
        total[6] += c2 * lever.real
        total[7] += -arm.real + c2 * zz + 2 * c1 * zv
        total[8] += self.mass * c2
        if m.s:
            self._on_displacements(m, j, spin, out)

    def _sums(
        self, m: Motion, j: int
    ) -> tuple[complex, complex, complex, float, float, float]:
        """First moments of z, u', u''; second moments z.M z, z.M u' and (J z).M u'', J a quarter
        turn."""
        if not m.s:
            return self.moment, 0j, 0j, self.inertia, 0.0, 0.0
        s, forms = m.s, m.forms
        return (
            self.moment + s[j], m.s1[j], m.s2[j],
            self.inertia + 2 * s[j + 1].real + forms[0],
            m.s1[j + 1].real + forms[2], m.s2[j + 1].imag - forms[5],
        )

    def _on_displacements(self, m: Motion, j: int, spin: complex, out: Views) -> None:
        w, al, c1, c2, ec = m.w, m.al, m.c1, m.c2, m.ec
        beta = ec * m.acc
        out.sigma[j], out.sigma[j + 1] = beta, spin
        sy, tau, turn = out.sigma_y, out.tau, -1j * beta
        pull = c2 * ec
        sy[0, j], sy[1, j], sy[2, j] = pull, 1j * pull, turn
        sy[2, j + 1] = complex(-2 * w * c1, c2)
        nu = (m.e * (spin + complex(c2, 2 * w * c1))).conjugate()
        tau[0, j], tau[1, j], tau[2, j] = nu, 1j * nu, turn
        tau[2, j + 1] = complex(2 * al + 2 * w * c1, c2)
        on_u = out.coefficients
        on_u[0], on_u[1], on_u[3] = -w * w, al, 2 * w


@dataclass(frozen=True, slots=True)
class BodyForce:
    """Load that rotates with the body: total = sum f (N), arm = sum X x f (N m). Pair of
    functionals: the load and sum u x f."""

    total: complex
    arm: float
    amplitude: Amplitude

    def evaluate(self, m: Motion, j: int, o: int, k: int, total: list[float], out: Views) -> None:
        g = self.amplitude(m.t)
        f = m.e * self.total * g
        total[0] -= f.real
        total[1] -= f.imag
        total[2] -= g * (self.arm + (m.s[j].imag if m.s else 0.0))
        total[3] += f.imag
        total[4] -= f.real
        if m.s:
            out.sigma[j] = -g
            out.tau[2, j] = -1j * g


@dataclass(frozen=True, slots=True)
class SpaceForce:
    """Nodal weights times one force in space axes: total = sum w, arm = sum w X, force per unit
    weight (N)."""

    total: float
    arm: complex
    force: complex
    amplitude: Amplitude

    def evaluate(self, m: Motion, j: int, o: int, k: int, total: list[float], out: Views) -> None:
        f = self.amplitude(m.t) * self.force
        fb = m.ec * f
        arm = self.arm + (m.s[j] if m.s else 0j)
        torque = arm.conjugate() * fb
        total[0] -= self.total * f.real
        total[1] -= self.total * f.imag
        total[2] -= torque.imag
        total[7] += torque.real
        if m.s:
            out.sigma[j] = -fb
            out.sigma_y[2, j] = out.tau[2, j] = 1j * fb


@dataclass(frozen=True, slots=True)
class Attachment:
    """Attachment of a joint at the mean point = sum w X (m) of a set, with sum w = 1."""

    point: complex

    def evaluate(self, m: Motion, j: int, o: int, k: int, total: list[float], out: Views) -> None:
        ec, y = m.ec, m.y
        z = self.point + (m.s[j] if m.s else 0j)
        f = complex(y[k], y[k + 1])
        fb, rz = ec * f, m.e * z
        at, torque = m.r + rz, z.conjugate() * fb
        total[0] += f.real
        total[1] += f.imag
        total[2] += torque.imag
        total[7] -= torque.real
        rows, H = out.rows, out.H
        rows[k], rows[k + 1] = at.real, at.imag
        H[0, k] = H[1, k + 1] = H[k, 0] = H[k + 1, 1] = 1.0
        H[2, k] = H[k, 2] = -rz.imag
        H[2, k + 1] = H[k + 1, 2] = rz.real
        if m.s:
            out.sigma[j] = fb
            sy, tau = out.sigma_y, out.tau
            sy[k, j] = tau[k, j] = ec
            sy[k + 1, j] = tau[k + 1, j] = 1j * ec
            sy[2, j] = tau[2, j] = -1j * fb


@dataclass(frozen=True, slots=True)
class Rotation:
    """Rotation of a body or mean rotation of a set as a joint coordinate. angle: mean rotation in
    the shape from which displacements are measured, rad."""

    turns: bool
    angle: float

    def evaluate(self, m: Motion, j: int, o: int, k: int, total: list[float], out: Views) -> None:
        moment, deforms = m.y[k], self.turns and bool(m.s)
        total[2] += moment
        out.rows[k] = m.y[2] + self.angle + (m.s[j].real if deforms else 0.0)
        out.H[2, k] = out.H[k, 2] = 1.0
        if deforms:
            out.sigma[j] = moment
            out.sigma_y[k, j] = out.tau[k, j] = 1.0


@dataclass(frozen=True, slots=True)
class Slide:
    """Point-on-line constraint g = Re(conj(n) (r + e z - r_o)) - base, n = e_o line.

    The own point z (m) stays on a line of the other body with unit normal `line` and offset `base`
    (m) in its axes; moves: the other body's coordinates are unknowns; place: its coordinates
    otherwise.
    """

    point: complex
    line: complex
    base: float
    moves: bool
    place: tuple[float, ...]

    def evaluate(self, m: Motion, j: int, o: int, k: int, total: list[float], out: Views) -> None:
        z, lam = self.point + (m.s[j] if m.s else 0j), m.y[k]
        x, y, angle = m.y[o : o + 3] if self.moves else self.place
        n, rz = exp(1j * angle) * self.line, m.e * z
        gap, f, fb = m.r + rz - complex(x, y), lam * n, lam * m.ec * n
        torque = z.conjugate() * fb
        total[0] += f.real
        total[1] += f.imag
        total[2] += torque.imag
        total[7] -= torque.real
        rows, H, pull = out.rows, out.H, n.conjugate() * gap
        rows[k] = pull.real - self.base
        H[k, 0], H[k, 1], H[k, 2] = n.real, n.imag, (rz.conjugate() * n).imag
        H[0, k], H[1, k], H[2, k] = H[k, 0], H[k, 1], H[k, 2]
        if self.moves:
            self._other(o, k, lam, n, pull, torque.real, out)
        if m.s:
            sy, tau = out.sigma_y, out.tau
            out.sigma[j] = fb
            sy[k, j] = tau[k, j] = m.ec * n
            sy[2, j] = tau[2, j] = -1j * fb
            if self.moves:
                sy[o + 2, j] = tau[o + 2, j] = 1j * fb

    @staticmethod
    def _other(
        o: int, k: int, lam: float, n: complex, pull: complex, along: float, out: Views
    ) -> None:
        """Rows and derivatives of the other body's coordinates, numbered from o; along = lam
        Re(conj(e z) n)."""
        rows, H, f = out.rows, out.H, lam * n
        rows[o], rows[o + 1], rows[o + 2] = -f.real, -f.imag, lam * pull.imag
        H[k, o], H[k, o + 1], H[k, o + 2] = -n.real, -n.imag, pull.imag
        H[0, o + 2], H[1, o + 2], H[2, o + 2] = -f.imag, f.real, along
        H[o, o + 2], H[o + 1, o + 2] = f.imag, -f.real
        for i in (k, 0, 1, 2, o, o + 1):
            H[o + 2, i] = H[i, o + 2]
        H[o, k], H[o + 1, k] = H[k, o], H[k, o + 1]
        H[o + 2, o + 2] = -lam * pull.real


@dataclass(frozen=True, slots=True, eq=False)
class Reaction:
    """Prescribed joint force (N) and moment (N m) in space axes: table `forces_at` (T, 3)."""

    forces_at: Table
    turns: bool

    def evaluate(self, m: Motion, j: int, o: int, k: int, total: list[float], out: Views) -> None:
        if m.s:
            x, y, moment = self.forces_at.at(m.t).tolist()
            out.sigma[j] = m.ec * complex(x, y)
            if self.turns:
                out.sigma[j + 1] = moment
