"""Discrete empirical interpolation of the forces (DEIM), a reference method for comparison.

Chaturantabut and Sorensen 2010, doi 10.1137/090766498; choice of points by pivoted QR: Drmac and
Gugercin 2016, doi 10.1137/15M1019271.
"""

from sparsemor.reducers import (
    Interpolating,
    Maps,
    Reducible,
    TestMap,
    choose_points,
    force_modes,
    interpolation,
)


class Deim(Interpolating):
    """POD-DEIM: constant operators projected, all other forces interpolated at DEIM points
    (Chaturantabut & Sorensen 2010).

    Mass, damping and stiffness are projected as in `galerkin`. The remaining force f of a block
    is evaluated at the points P only: atoms^T U (P^T U)^+ P^T f with force modes U."""

    def maps(self, block: Reducible) -> Maps:
        """Test maps atoms^T (k, n) of the operators and atoms^T U (P^T U)^+ (k, m) of the forces at
        m points, with force modes U (n, f)."""
        modes, atoms = force_modes(block, self.basis_of_force(block)), block.dictionary.atoms
        f = modes.atoms.shape[1]
        points = choose_points(block, modes, self.wanted(block, f), self.sampler, self.required)
        reconstruction, facts = interpolation(block.name, modes.atoms, points)
        left = (atoms.T @ modes.atoms) @ reconstruction
        # norm: that in which the residual of the operators is least, as by Galerkin projection
        return Maps(
            test=TestMap(left=atoms.T), force=TestMap(rows=points, left=left), rows=points,
            facts={"norm": "D^-1", "force_modes": f, **facts},
            notes=self.notes(block, points, modes.atoms, reconstruction))
