"""Inertia of a body, rigid or flexible (equations.md, section 1; notation: motion.py).

With z = X + u and the second moments of mass_moments.py, the torque of the inertia forces about the
frame origin is

    sum z x M acc = (sum m z) x A^T R'' + J alpha + w x J w + K1 w + 2nd moments of (z, u''),

where J follows from the moments (z, z) and K1 from (z, u'). For a rigid body the moments are
constant.
"""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from sparsemor.bodies.frames import plane_items as plane
from sparsemor.bodies.frames import rotation as rot
from sparsemor.bodies.frames import space_items as spatial
from sparsemor.bodies.frames.frame_items import AXES, Item
from sparsemor.bodies.frames.mass_moments import MassProperties, Moments
from sparsemor.bodies.frames.motion import Motion, Moved, Pushed, Sums
from sparsemor.bodies.frames.space_items import space_inertia
from sparsemor.core import FloatArray

FIRST = 3
"""Number of first-moment functionals in space; those of the second moments follow them."""


@dataclass(frozen=True, slots=True, eq=False)
class Inertia(Item):
    """Inertia of a body: mass (kg), moment (d,) = sum m X (kg m), second (g,) = X.M_g X (kg m^2).

    Functionals of the displacements: m e_i (d), then M_g X (g).
    """

    mass: float
    moment: FloatArray
    second: FloatArray
    moments: Moments
    tensor: FloatArray = field(init=False)
    """(r, r) moments of inertia of the reference shape about the frame origin, kg m^2."""
    others = 0
    pushes = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "tensor", self.moments.tensor.dot(self.second))

    @classmethod
    def from_moments(cls, body: MassProperties, moments: Moments) -> Self:
        return cls(body.mass, body.moment, moments.numbers(body.second), moments)

    @property
    def directions(self) -> int:
        return len(self.moment) + self.moments.count

    def names(self, source: str) -> tuple[str, ...]:
        return (*(f"inertia {a}" for a in AXES[: len(self.moment)]), *self.moments.names)

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "Inertia":
        d = len(self.moment)
        return replace(self, moment=self.moment + s[:d],
                       second=self.second + self.moments.symmetric * s[d:]
                       + quadratic[: self.moments.count])

    def in_plane(self) -> plane.PlanePart:
        return plane.PlanePart(
            plane.inertia, (self.mass, *self.moment.tolist(), float(self.second[0])))

    def in_space(self) -> tuple[spatial.SpacePart, ...]:
        return (spatial.SpacePart(
            space_inertia, (self.mass, *self.moment.tolist(), *self.second.tolist())),)

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        """Adds inertia forces m R'' + A swing, swing = (w~ w~ + al~) z + 2 w~ z1 + z2, and torques
        J al + w x J w + K1 w + z x A^T R'' + those of u'', with first moments z, z1, z2 = sum m (X
        + u, u', u'') and inertia J of the deformed shape, and their derivatives by rigid
        coordinates.

        m: w, al with derivatives dw, dal (3, n) by the attitude, acc = R'', _b: in body axes. out:
        torque in body axes and torque_y = d torque / dy, H = d rows / dy. j: first functional.
        """
        m.acc_b = m.A.T.dot(m.acc)
        m.dacc_b = m.turn.of_space(m.acc)
        wx, alx = rot.skew(m.w), rot.skew(m.al)
        spin = wx.dot(wx) + alx
        z, J, swing, by_rate, torque = self._shape(m, j, spin, wx)
        Jw, zx = J.dot(m.w), rot.skew(z)
        out.rows[:3] += self.mass * m.acc + m.A.dot(swing)
        out.torque += torque + zx.dot(m.acc_b) + J.dot(m.al) + wx.dot(Jw)
        # derivatives by w of the swing, and of the torque, w x J w + K1 w
        swing_w, gyro = -(rot.skew(wx.dot(z)) + wx.dot(zx)), wx.dot(J) - rot.skew(Jw)
        if by_rate is not None:
            z1, K1 = by_rate
            swing_w -= 2.0 * rot.skew(z1)
            gyro += K1
        out.diagonal[:3] += m.c2 * self.mass
        out.H[:3, m.at] += m.turn.of_body(swing) + m.A.dot(swing_w.dot(m.dw) - zx.dot(m.dal))
        out.torque_y[:, :3] += m.c2 * zx.dot(m.A.T)
        out.torque_y[:, 3:] += zx.dot(m.dacc_b) + gyro.dot(m.dw) + J.dot(m.dal)
        if m.elastic:
            self._on_displacements(m, j, spin, wx, out)

    def _shape(
        self, m: Motion, j: int, spin: FloatArray, wx: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, tuple[FloatArray, FloatArray] | None,
               FloatArray | float]:
        """Inertia data of the current shape, in body axes: sum m z; J; swing, sum m acc without
        R''; sum m u' and K1 (None for a rigid body); and the torque K1 w plus that of u''. spin =
        w~ w~ + al~, wx = w~. N, N1, N2 (g,): second moments of z with z, u', u'', of which `tensor`
        makes moments of inertia and `axial` sum z x m u''."""
        if not m.elastic:
            return self.moment, self.tensor, spin.dot(self.moment), None, 0.0
        first = slice(j, j + FIRST)
        z, z1, z2 = self.moment + m.s[first], m.s1[first], m.s2[first]
        N, N1, N2 = self._moments(m, j)
        tensor, axial = self.moments.tensor, self.moments.axial
        K1 = 2.0 * tensor.dot(N1)  # as J of (z, z), with the factor of 2 w x u'
        swing = spin.dot(z) + 2.0 * wx.dot(z1) + z2
        return z, tensor.dot(N), swing, (z1, K1), K1.dot(m.w) + axial.dot(N2)

    def _moments(self, m: Motion, j: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(g,) each: second moments z.M_g z, z.M_g u', z.M_g u''."""
        g, signs = self.moments.count, self.moments.signs
        at, forms = slice(j + FIRST, j + FIRST + g), m.forms.reshape(3, -1)[:, :g]
        return (self.second + self.moments.symmetric * m.s[at] + forms[0],
                signs * m.s1[at] + forms[1], signs * m.s2[at] + forms[2])

    def push(self, m: Moved, j: int, out: Pushed) -> None:
        """Inertia loads on the displacements, without derivatives: A^T R'' on the first moments,
        w~ w~ + al~ = sum_g factor_g B_g on M_g X and M_g u, and 2 w~ on M_g u'."""
        k, at = self.moments, j + FIRST
        factors = k.factors(m.w, m.al)
        out.sigma[..., j:at] = m.in_body(m.acc)
        out.sigma[..., at : at + k.count] = factors
        twice = 2.0 * m.w.dot(k.turn.T)  # 2 w~ as a sum of the B_g
        out.coefficients[..., : k.count] = factors
        half = out.coefficients.shape[-1] // 2  # kappa, then mu
        out.coefficients[..., half : half + k.count] = twice

    def _on_displacements(
        self, m: Motion, j: int, spin: FloatArray, wx: FloatArray, out: Sums
    ) -> None:
        """Adds the factors of the functionals m e_i (`first`) and M_g X (`second`) in the elastic
        rows (`push`), and derivatives: sigma_y of these factors by y, tau of rows and torque_s of
        the torque in body axes by the functionals, for u' = c1 u, u'' = c2 u. by_shape, by_rate (3,
        g): torque per unit of z.M_g z and of z.M_g u', k.axial: of z.M_g u''. k: `Moments`, whose
        matrices M_g have in w~ w~ + al~ factors with the derivatives k.slopes by w, k.turn by al;
        M_g^T = k.signs M_g, and z.M_g z changes by k.symmetric (M_g z).dz."""
        c1, c2, k = m.c1, m.c2, self.moments
        first, second = slice(j, j + FIRST), slice(j + FIRST, j + FIRST + k.count)
        self.push(m, j, out)
        out.sigma_y[:3, first], out.sigma_y[m.at, first] = c2 * m.A, m.dacc_b.T
        out.sigma_y[m.at, second] = (k.slopes(m.w).dot(m.dw) + k.turn.dot(m.dal)).T
        out.tau[:3, first] = m.A.dot(spin + (2.0 * c1) * wx + c2 * np.eye(3))
        out.torque_s[:, first] = -rot.skew(m.acc_b)
        by_shape, by_rate = self._levers(m.w, m.al, wx)
        out.torque_s[:, second] = (
            k.symmetric * by_shape + k.signs * (c1 * by_rate + c2 * k.axial))

    def _levers(
        self, w: FloatArray, al: FloatArray, wx: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """(3, g) each: torque per unit of z.M_g z and of z.M_g u'."""
        Jw = self.moments.levers.dot(w)
        return self.moments.levers.dot(al) + wx.dot(Jw), 2.0 * Jw

    def exact(self, m: Motion, out: Sums) -> None:
        """Derivatives that are quadratic in u, which only the exact Jacobian contains."""
        wx, lever, k = rot.skew(m.w), m.turn.lever(), self.moments
        out.kappa_y[m.at, : k.count] = (k.slopes(m.w).dot(m.dw) + k.turn.dot(m.dal)).T
        out.mu_y[m.at, : k.count] = 2.0 * k.turn.dot(m.dw).T
        by_shape, by_rate = self._levers(m.w, m.al, wx)
        for i, torque in enumerate((by_shape, by_rate, k.axial)):
            out.quad[m.at, i, : k.count] = lever.dot(torque)
