"""Parts of the planar frame equations: inertia, forces, attachments (notation: motion.py).

Each item adds its force and torque to `total` (rows 0-2, then H02, H12, H20, H21, H22, H00) and
writes its own columns: pairs from j on, border unknowns from k on. `names` says what each of its
directions is a load of, two a pair; "" where it only serves the rows of the frame.
"""

from dataclasses import dataclass, replace

from sparsemor.bodies.frames.plane_motion import Motion, Views
from sparsemor.core import FloatArray, Table
from sparsemor.core.protocols.separable import Amplitude


@dataclass(frozen=True, slots=True)
class Inertia:
    """Two pairs: S = m 1 (first moment) and M X (equations.md, section 1).

    mass (kg), moment = sum m X (kg m, complex), inertia = X.M X (kg m^2) about the frame origin.
    """

    mass: float
    moment: complex
    inertia: float
    pairs = 2
    forces = 0

    def names(self, source: str) -> tuple[str, ...]:
        return ("inertia x", "inertia y", "inertia outward", "inertia around")

    def shifted(self, s: list[complex], quadratic: FloatArray) -> "Inertia":
        return Inertia(self.mass, self.moment + s[0],
                       self.inertia + 2 * s[1].real + float(quadratic[0]))

    def evaluate(self, m: Motion, j: int, k: int, total: list[float], out: Views) -> None:
        """Translation A sum(M acc), rotation sum z x M acc, with acc = A^T R'' + ... ."""
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
        """First moments of z, u', u''; z.M z, z.M u' and (J z).M u''."""
        if not m.s:
            return self.moment, 0j, 0j, self.inertia, 0.0, 0.0
        s, c1, c2, form, forms = m.s, m.c1, m.c2, m.form, m.forms
        a, b = s[j], s[j + 1]
        return (
            self.moment + a, c1 * a + m.s1[j], c2 * a + m.s2[j],
            self.inertia + 2 * b.real + form[0],
            c1 * (b.real + form[0]) + m.s1[j + 1].real + forms[0],
            c2 * (b.imag - form[1]) + m.s2[j + 1].imag - forms[3],
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
        on_u[0], on_u[1], on_u[3] = -w * w, al + 2 * w * c1, 2 * w

    def exact(self, m: Motion, out: Views) -> None:
        """Derivatives that are quadratic in u, which only the exact Jacobian needs."""
        out.kappa_y[2, 0], out.kappa_y[2, 1] = -2 * m.w * m.c1, m.c2
        out.mu_y[2, 1] = 2 * m.c1
        out.quad[2, 0, 0], out.quad[2, 1, 0], out.quad[2, 2, 1] = m.al, 2 * m.w, -1.0


@dataclass(frozen=True, slots=True)
class BodyForce:
    """A nodal load that turns with the body. total = sum f (N), arm = <f, X> = sum conj(f) X."""

    total: complex
    arm: complex
    amplitude: Amplitude
    pairs = 1
    forces = 0

    def names(self, source: str) -> tuple[str, ...]:
        return (source, "")

    def shifted(self, s: list[complex], quadratic: FloatArray) -> "BodyForce":
        return replace(self, arm=self.arm + s[0])

    def evaluate(self, m: Motion, j: int, k: int, total: list[float], out: Views) -> None:
        g = self.amplitude(m.t)
        arm = self.arm + (m.s[j] if m.s else 0j)
        f = m.e * self.total * g
        total[0] -= f.real
        total[1] -= f.imag
        total[2] += g * arm.imag  # sum z x f = -Im <f, z>
        total[3] += f.imag
        total[4] -= f.real
        if m.s:
            out.sigma[j] = -g
            out.tau[2, j] = 1j * g


@dataclass(frozen=True, slots=True)
class SpaceForce:
    """Nodal weights times one force in space axes (gravity: weights are nodal masses).

    total = sum w, arm = sum w X (complex), force per unit weight (complex, N).
    """

    total: float
    arm: complex
    force: complex
    amplitude: Amplitude
    pairs = 1
    forces = 0

    def names(self, source: str) -> tuple[str, ...]:
        return (f"{source} x", f"{source} y")

    def shifted(self, s: list[complex], quadratic: FloatArray) -> "SpaceForce":
        return replace(self, arm=self.arm + s[0])

    def evaluate(self, m: Motion, j: int, k: int, total: list[float], out: Views) -> None:
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
    """Mean position of a weighted set of points; its border unknown is the force on it.

    point = sum w X with sum w = 1 (complex, m). With `turns` a second pair gives the mean
    rotation of the set (rad) and a third border unknown, the moment (N m).
    """

    point: complex
    turns: bool = False
    angle: float = 0.0
    """Mean rotation of the set in the shape that displacements count from, rad."""

    @property
    def pairs(self) -> int:
        return 2 if self.turns else 1

    @property
    def forces(self) -> int:
        return 3 if self.turns else 2

    def names(self, source: str) -> tuple[str, ...]:
        turn = (f"joint {source} turn", "") if self.turns else ()
        return (f"joint {source} x", f"joint {source} y", *turn)

    def shifted(self, s: list[complex], quadratic: FloatArray) -> "Attachment":
        angle = self.angle + s[1].real if self.turns else 0.0
        return replace(self, point=self.point + s[0], angle=angle)

    def evaluate(self, m: Motion, j: int, k: int, total: list[float], out: Views) -> None:
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
        if self.turns:
            self._rotation(m, j + 1, k + 2, total, out)

    def _rotation(self, m: Motion, j: int, k: int, total: list[float], out: Views) -> None:
        moment = m.y[k]
        total[2] += moment
        out.rows[k] = m.y[2] + self.angle + (m.s[j].real if m.s else 0.0)
        out.H[2, k] = out.H[k, 2] = 1.0
        if m.s:
            out.sigma[j] = moment
            out.sigma_y[k, j] = out.tau[k, j] = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Reaction:
    """Prescribed reaction on an `Attachment`: (T, 2) N in space axes or, with the
    moment (N m) on the mean rotation of the set, (T, 3)."""

    point: complex
    forces_at: Table
    forces = 0

    @property
    def turns(self) -> bool:
        return bool(self.forces_at.values.shape[1] == 3)

    @property
    def pairs(self) -> int:
        return 2 if self.turns else 1

    def names(self, source: str) -> tuple[str, ...]:
        turn = (f"{source} turn", "") if self.turns else ()
        return (f"{source} x", f"{source} y", *turn)

    def shifted(self, s: list[complex], quadratic: FloatArray) -> "Reaction":
        return replace(self, point=self.point + s[0])

    def evaluate(self, m: Motion, j: int, k: int, total: list[float], out: Views) -> None:
        known = self.forces_at.at(m.t).tolist()
        f = complex(known[0], known[1])
        fb = m.ec * f
        torque = (self.point + (m.s[j] if m.s else 0j)).conjugate() * fb
        total[0] += f.real
        total[1] += f.imag
        total[2] += torque.imag
        total[7] -= torque.real
        if m.s:
            out.sigma[j] = fb
            out.sigma_y[2, j] = out.tau[2, j] = -1j * fb
        if self.turns:
            total[2] += known[2]
            if m.s:
                out.sigma[j + 1] = known[2]


Item = Inertia | BodyForce | SpaceForce | Attachment | Reaction
