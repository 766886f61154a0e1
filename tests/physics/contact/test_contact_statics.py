"""Contact at given positions: closed forms of the elastic foundation, and Newton's third law."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor.bodies.contact.built_contact import ContactPart
from sparsemor.core import MeshPlugin
from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.assembly import assemble
from sparsemor.core.protocols.mesh import Mesh
from sparsemor.core.protocols.prescribed_motion import FrameHistory
from sparsemor.core.testing.in_memory_run import scene_of

K, WIDTH = 1e9, 0.02


class Polygon(MeshPlugin):
    """A regular polygon inscribed in a circle about the origin; set `rim`."""

    radius: float
    """Of the circle, m."""
    corners: int
    """How many."""

    def build(self, base: Path) -> Mesh:
        angle = 2 * np.pi * (np.arange(self.corners) + 0.5) / self.corners
        rim = self.radius * np.stack([np.sin(angle), -np.cos(angle)], axis=1)
        n = self.corners
        cells = np.stack([np.arange(n), np.roll(np.arange(n), -1), np.full(n, n)], axis=1)
        return Mesh(np.vstack([rim, [[0.0, 0.0]]]), cells, {"rim": np.arange(n)})


def rectangle(lower: list[float], size: list[float], divisions: list[int]) -> dict[str, Any]:
    return {"use": "rectangle", "lower": lower, "size": size, "divisions": divisions}


def contact_of(mesh: Any, surface: str, swap: bool = False, **options: Any) -> ContactPart:
    """`mesh` above a plate whose top is y = 0 in 7 facets."""
    thing = {"use": "flexible", "mesh": mesh, "thickness": WIDTH, "fields": [],
             "material": {"rho": 1000},
             "sets": {"skirt": {"where": "y < 1e-9 or x > 0.1 - 1e-9"}},
             "pose": {"position": [0.0, 1.0]}}
    plate = {"use": "flexible", "mesh": rectangle([-0.2, -0.1], [0.4, 0.1], [7, 1]), "fields": [],
             "thickness": WIDTH, "material": {"rho": 1000}}
    between = [f"thing:{surface}", "plate:top"]
    model = assemble(scene_of({
        "bodies": {"thing": thing, "plate": plate}, "time": {"end": 1.0, "step": 0.1},
        "contacts": {"touch": {
            "use": "polygonal", "between": between[::-1] if swap else between,
            "normal": {"use": "elastic_foundation", "stiffness": K}, **options}}}))
    part = model.parts["touch"]
    assert isinstance(part, ContactPart)
    return part


def standing(*poses: tuple[float, float, float], rate: FloatArray | None = None) -> FrameHistory:
    p = np.array(poses)
    return FrameHistory(np.arange(float(len(p))), p, np.zeros_like(p) if rate is None else rate,
                        np.zeros_like(p))


def test_a_block_over_the_end_of_a_surface_presses_with_what_is_over_it() -> None:
    part = contact_of(rectangle([0.0, 0.0], [0.1, 0.1], [3, 1]), "bottom")
    found = part.history({"thing": standing((0.163, -1e-6, 0.0))})
    assert found["normal"] == pytest.approx([K * 1e-6 * 0.037 * WIDTH])
    assert found["length"] == pytest.approx([0.037])


@pytest.mark.parametrize("swap", [False, True])
def test_a_wedge_presses_with_the_square_of_its_depth(swap: bool) -> None:
    """The corner of a square turned by 45 degrees: F = K d^2 on the plate's foundation. On that of
    its own flanks depth, area and the share of the pressure along y lose sqrt(2) each."""
    part = contact_of(rectangle([0.0, 0.0], [0.1, 0.1], [5, 5]), "skirt", swap)
    d = np.array([1e-4, 3e-3, 7e-3])
    corner = 0.1 * np.exp(0.25j * np.pi * -1)  # of (0.1, 0), turned by -45 degrees
    motion = {"thing": standing(*((-corner.real, -corner.imag - di, -np.pi / 4) for di in d))}
    force = part.imported(motion)["plate"].force.sum(axis=1)
    if not swap:
        assert part.history(motion)["normal"] == pytest.approx(K * d**2 * WIDTH, rel=1e-12)
        assert part.history(motion)["length"] == pytest.approx(2 * d, rel=1e-12)
        assert part.history(motion)["pressure"] == pytest.approx(K * d, rel=1e-12)
        want = K * d**2 * WIDTH
    else:
        want = K * d**2 / 2**1.5 * WIDTH
    assert -force[:, 1] == pytest.approx(want, rel=1e-9)
    assert np.abs(force[:, 0]).max() < 1e-9 * want.max()


def circle_force(radius: float, depth: float) -> float:
    """Foundation under a rigid cylinder: K times the area of the cut-off segment."""
    half = np.sqrt(2 * radius * depth - depth**2)
    area = radius**2 * np.arcsin(half / radius) - half * (radius - depth)
    return float(K * WIDTH * area)


@pytest.mark.full
def test_polygons_approach_the_circle_with_the_square_of_their_facets() -> None:
    radius, depth = 0.05, 5e-4
    error, size = [], []
    for corners in (50, 100, 200, 400):
        part = contact_of(Polygon(radius=radius, corners=corners), "rim")
        # averaged over one facet's turn, so that it does not matter what is lowest
        turns = 2 * np.pi / corners * (np.arange(8) + 0.5) / 8
        found = part.history({"thing": standing(*((0.0, radius - depth, a) for a in turns))})
        error.append(abs(found["normal"].mean() / circle_force(radius, depth) - 1))
        size.append(1.0 / corners)
    order = np.diff(np.log(error)) / np.diff(np.log(size))
    assert error[-1] < 4e-3  # sagitta of a facet over the depth
    assert np.all(order > 1.9), order


