"""Fields of a disk about its axis, as closed forms have them."""

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols.mesh import Mesh


def radial_and_hoop(mesh: Mesh, sigma: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Distance of each cell's centroid from the axis (z), sigma_r and sigma_theta there."""
    centroid = mesh.points[mesh.cells].mean(axis=1)[:, :2]
    r = np.linalg.norm(centroid, axis=1)
    along = centroid / r[:, None]
    radial = np.einsum("ei,eij,ej->e", along, sigma[:, :2, :2], along)
    return r, radial, sigma[:, 0, 0] + sigma[:, 1, 1] - radial


def rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
