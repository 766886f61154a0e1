"""Parts of the planar frame equations: inertia, forces, attachments.

The plane is the complex plane: a position is x + i y, the frame rotation e = exp(i theta), and
each pair of directions (f, J f) is one complex vector with one complex factor. Real and imaginary
parts are interleaved in the real arrays, so `array.view(complex)` costs nothing.

A derivative row tau means d row = Re(conj(tau) ds): for a complex equation d = a ds the real row
has tau = conj(a) and the imaginary row tau = i conj(a).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sparsemor.core.arrays import FloatArray

Amplitude = Callable[[float], float]


class Motion:
    """Rigid state of one body: R (m), e = exp(i theta), rates and the formula's c1, c2."""

    __slots__ = ("a", "acc", "c1", "c2", "e", "ec", "r", "w")

    def __init__(
        self, r: complex, e: complex, w: float, a: float, acc: complex, c1: float, c2: float
    ) -> None:
        self.r, self.e, self.ec = r, e, e.conjugate()
        self.w, self.a, self.acc, self.c1, self.c2 = w, a, acc, c1, c2


class Views:
    """Complex views of a FrameWork and its small arrays, made once."""

    __slots__ = ("H", "kappa", "kappa_y", "mu", "mu_y", "quad", "rows", "sigma", "sigma_y", "tau")

    def __init__(self, work: "object") -> None:
        for name in ("H", "kappa", "kappa_y", "mu", "mu_y", "quad", "rows"):
            setattr(self, name, getattr(work, name))
        for name in ("sigma", "sigma_y", "tau"):
            setattr(self, name, getattr(work, name).view(np.complex128))


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

    def shifted(self, s: list[complex], quadratic: FloatArray) -> "Inertia":
        return Inertia(self.mass, self.moment + s[0],
                       self.inertia + 2 * s[1].real + float(quadratic[0]))

    def evaluate(
        self, m: Motion, j: int, k: int, s: list[complex], s1: list[complex], s2: list[complex],
        y: list[float], q: FloatArray | None, t: float, out: Views,
    ) -> None:
        """Translation A sum(M acc), rotation sum z x M acc, with acc = A^T R'' + ... ."""
        e, ec, w, al, c1, c2 = m.e, m.ec, m.w, m.a, m.c1, m.c2
        beta = ec * m.acc
        spin = complex(-w * w, al)
        if self.pairs and s:
            p, p1, p2 = self.moment + s[j], s1[j], s2[j]
            zz, zv, za = self.inertia + 2 * s[j + 1].real, s1[j + 1].real, s2[j + 1].imag
        else:
            p, p1, p2, zz, zv, za = self.moment, 0j, 0j, self.inertia, 0.0, 0.0
        if q is not None:
            zz, zv, za = zz + q[0, 0], zv + q[1, 0], za - q[2, 1]
        swing = e * (spin * p + 2j * w * p1 + p2)
        f = self.mass * m.acc + swing
        rows, H = out.rows, out.H
        rows[0] += f.real
        rows[1] += f.imag
        rows[2] += (p.conjugate() * beta).imag + al * zz + 2 * w * zv + za
        df = 1j * swing + e * (complex(-2 * w * c1, c2) * p + 2j * c1 * p1)
        mc = self.mass * c2
        H[0, 0] += mc
        H[1, 1] += mc
        H[0, 2] += df.real
        H[1, 2] += df.imag
        lever = c2 * p.conjugate() * ec
        H[2, 0] += lever.imag
        H[2, 1] += lever.real
        H[2, 2] += -(p.conjugate() * beta).real + c2 * zz + 2 * c1 * zv
        if not s:
            return
        out.sigma[j] += beta
        out.sigma[j + 1] += spin
        sy, tau = out.sigma_y, out.tau
        sy[0, j], sy[1, j], sy[2, j] = c2 * ec, 1j * c2 * ec, -1j * beta
        sy[2, j + 1] = complex(-2 * w * c1, c2)
        nu = (e * (spin + complex(c2, 2 * w * c1))).conjugate()
        tau[0, j], tau[1, j], tau[2, j] = nu, 1j * nu, -1j * beta
        tau[2, j + 1] = complex(2 * al + 2 * w * c1, c2)
        if q is not None:
            out.kappa[0] += -w * w
            out.kappa[1] += al
            out.mu[1] += 2 * w
            out.kappa_y[2, 0], out.kappa_y[2, 1] = -2 * w * c1, c2
            out.mu_y[2, 1] = 2 * c1
            out.quad[2, 0, 0], out.quad[2, 1, 0], out.quad[2, 2, 1] = al, 2 * w, -1.0


@dataclass(frozen=True, slots=True)
class BodyForce:
    """A nodal load that turns with the body. total = sum f (N), arm = <f, X> = sum conj(f) X."""

    total: complex
    arm: complex
    amplitude: Amplitude
    pairs = 1
    forces = 0

    def shifted(self, s: list[complex], quadratic: FloatArray) -> "BodyForce":
        return replace(self, arm=self.arm + s[0])

    def evaluate(
        self, m: Motion, j: int, k: int, s: list[complex], s1: list[complex], s2: list[complex],
        y: list[float], q: FloatArray | None, t: float, out: Views,
    ) -> None:
        g = self.amplitude(t)
        arm = self.arm + (s[j] if s else 0j)
        f = m.e * self.total * g
        rows, H = out.rows, out.H
        rows[0] -= f.real
        rows[1] -= f.imag
        rows[2] += g * arm.imag  # sum z x f = -Im <f, z>
        H[0, 2] += f.imag
        H[1, 2] -= f.real
        if s:
            out.sigma[j] -= g
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

    def shifted(self, s: list[complex], quadratic: FloatArray) -> "SpaceForce":
        return replace(self, arm=self.arm + s[0])

    def evaluate(
        self, m: Motion, j: int, k: int, s: list[complex], s1: list[complex], s2: list[complex],
        y: list[float], q: FloatArray | None, t: float, out: Views,
    ) -> None:
        f = self.amplitude(t) * self.force
        fb = m.ec * f
        arm = self.arm + (s[j] if s else 0j)
        rows = out.rows
        rows[0] -= self.total * f.real
        rows[1] -= self.total * f.imag
        torque = arm.conjugate() * fb
        rows[2] -= torque.imag
        out.H[2, 2] += torque.real
        if s:
            out.sigma[j] -= fb
            out.sigma_y[2, j] = 1j * fb
            out.tau[2, j] = 1j * fb


@dataclass(frozen=True, slots=True)
class Attachment:
    """Mean position of a weighted set of points; its border unknown is the force on it.

    point = sum w X with sum w = 1 (complex, m). With `turns` a second pair gives the mean
    rotation of the set (rad) and a third border unknown, the moment (N m).
    """

    point: complex
    turns: bool = False

    @property
    def pairs(self) -> int:
        return 2 if self.turns else 1

    @property
    def forces(self) -> int:
        return 3 if self.turns else 2

    def shifted(self, s: list[complex], quadratic: FloatArray) -> "Attachment":
        if self.turns and s[1].real != 0.0:
            raise ValueError("a centred basis cannot carry the mean rotation of a fixed joint")
        return replace(self, point=self.point + s[0])

    def evaluate(
        self, m: Motion, j: int, k: int, s: list[complex], s1: list[complex], s2: list[complex],
        y: list[float], q: FloatArray | None, t: float, out: Views,
    ) -> None:
        e, ec = m.e, m.ec
        z = self.point + (s[j] if s else 0j)
        f = complex(y[k], y[k + 1])
        fb = ec * f
        rz = e * z
        rows, H = out.rows, out.H
        rows[0] += f.real
        rows[1] += f.imag
        torque = z.conjugate() * fb
        rows[2] += torque.imag
        rows[k] = m.r.real + rz.real
        rows[k + 1] = m.r.imag + rz.imag
        H[0, k] = H[1, k + 1] = H[k, 0] = H[k + 1, 1] = 1.0
        H[2, 2] -= torque.real
        H[2, k] = H[k, 2] = -rz.imag
        H[2, k + 1] = H[k + 1, 2] = rz.real
        if s:
            out.sigma[j] += fb
            sy, tau = out.sigma_y, out.tau
            sy[k, j] = tau[k, j] = ec
            sy[k + 1, j] = tau[k + 1, j] = 1j * ec
            sy[2, j] = -1j * fb
            tau[2, j] = -1j * fb
        if self.turns:
            self._rotation(j + 1, k + 2, s, y, out)

    def _rotation(self, j: int, k: int, s: list[complex], y: list[float], out: Views) -> None:
        out.rows[2] += y[k]
        out.rows[k] = y[2] + (s[j].real if s else 0.0)
        out.H[2, k] = out.H[k, 2] = 1.0
        if s:
            out.sigma[j] += y[k]
            out.sigma_y[k, j] = out.tau[k, j] = 1.0


Item = Inertia | BodyForce | SpaceForce | Attachment
