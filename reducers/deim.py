"""Discrete empirical interpolation of the forces (DEIM): the paper's comparison.

Chaturantabut and Sorensen 2010, doi 10.1137/090766498; choice of points by pivoted QR: Drmac and
Gugercin 2016, doi 10.1137/15M1019271.
"""

from sparsemor.reducers.forces import choose_points, force_modes, interpolation
from sparsemor.reducers.interpolating import Interpolating
from sparsemor.reducers.projected import Maps, Reducible
from sparsemor.reducers.test_map import TestMap


class Deim(Interpolating):
    """Mass, damping and stiffness are projected as in `galerkin`. All else in a block's rows, the
    force, is evaluated at the points and replaced by the modes that agree with it there:
    atoms^T U (P^T U)^+ P^T."""

    def maps(self, block: Reducible) -> Maps:
        """atoms^T (k, n) for the operators, atoms^T U (P^T U)^+ (k, m) of the points for forces."""
        modes, atoms = force_modes(block, self.basis_of_force(block)), block.dictionary.atoms
        f = modes.atoms.shape[1]
        points = choose_points(block, modes, self.wanted(block, f), self.sampler, self.required)
        back, facts = interpolation(block.name, modes.atoms, points)
        left = (atoms.T @ modes.atoms) @ back
        return Maps(
            TestMap(left=atoms.T), TestMap(rows=points, left=left), points,
            {"force_modes": f, **facts}, self.notes(block, points))
