"""Fixed-interface modes and constraint modes (Craig and Bampton 1968, doi 10.2514/3.4741)."""

import numpy as np
from pydantic import Field

from sparsemor.core import Basis, BlockData, Dictionary
from sparsemor.core.linalg.coherence import oriented_unit_columns
from sparsemor.plugins.bases.eigenmodes import lowest_modes
from sparsemor.plugins.bases.modal import joint_columns, load_names, mode_info, no_interface
from sparsemor.plugins.bases.orthogonalise import independent
from sparsemor.plugins.bases.static_response import StaticSolver


class CraigBampton(Basis):
    """Craig-Bampton basis: fixed-interface modes and static constraint modes of the joints' points.

    A joint constrains the mean displacement s = P^T u of a set of points, such as a rim, not each
    of them. The constraint modes of that interface minimise u.K u for s = 1 of one of its
    components, so they are K^-1 P (P^T K^-1 P)^-1: the span of the responses K^-1 P to the joint
    forces, which are the atoms here. The fixed-interface modes satisfy s = 0 and are K-orthogonal
    to them: with all modes the dictionary spans all displacements, with none it is static
    condensation to s. No training run is needed.
    """

    count: int = Field(default=20, ge=0)
    """Number of fixed-interface modes, the lowest ones."""

    @property
    def needs_snapshots(self) -> bool:
        return False

    def unfit(self, data: BlockData) -> str:
        """Reason why a block cannot have these modes (no joint acts on it); "" if it can."""
        return "" if len(data.joints) else no_interface(data, "craig_bampton")

    def build(self, data: BlockData) -> Dictionary:
        """Dictionary with atoms (n, k). Raises InputError for a block on which no joint acts."""
        modes = lowest_modes(data, self.count, joint_columns(data, "craig_bampton"))
        names = [f"fixed mode {i}" for i in range(len(modes.values))]
        pulled = oriented_unit_columns(StaticSolver.of(data)(data.loads[:, data.joints]))
        own, _ = independent(pulled, 1e-10)
        names += [f"constraint {load_names(data)[data.joints[i]]}" for i in own]
        atoms = np.concatenate([modes.shapes, pulled[:, own]], axis=1)
        return Dictionary(oriented_unit_columns(atoms), np.zeros(data.size), tuple(names), {
            "modes": len(modes.values), "constraint_modes": len(own), **mode_info(data, modes)})
