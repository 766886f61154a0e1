"""The pad on the brake disk at given positions (scenes.md, section 3)."""

import numpy as np
import pytest

from sparsemor.bodies.contact.built_contact import ContactPart
from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.assembly import assemble
from sparsemor.core.protocols.prescribed_motion import FrameHistory
from sparsemor.core.testing.in_memory_run import scene_of

MU, PRESSURE, STIFFNESS, SPIN = 0.7, 5.078e6, 3.1e11, 66.667
ANGLES = np.linspace(0.0, 2.0, 3)


def brake() -> ContactPart:
    """Both bodies turn by an angle, if at all."""
    hot = {"use": "flexible", "fields": ["thermal"], "frame": "spinning"}
    part = assemble(scene_of({
        "bodies": {
            "pad": hot | {"mesh": "pad",
                          "material": {"rho": 2000, "k": 8.7, "c": 935}},
            "disk": hot | {"mesh": "disk", "material": {"rho": 7850, "k": 44.5, "c": 475}}},
        "contacts": {"lining": {
            "use": "polygonal", "between": ["pad:bottom", "disk:top"], "heat": {},
            "normal": {"use": "elastic_foundation", "stiffness": STIFFNESS},
            "friction": {"use": "coulomb", "coefficient": MU, "critical_velocity": 0.05}}},
        "time": {"end": 1.0, "step": 0.1}})).parts["lining"]
    assert isinstance(part, ContactPart)
    return part


def motion() -> dict[str, FrameHistory]:
    """The disk at some angles under a pad that presses."""
    still = np.zeros((3, 4))
    pad, disk, rate = still.copy(), still.copy(), still.copy()
    pad[:, 2], disk[:, 3], rate[:, 3] = -PRESSURE / STIFFNESS, ANGLES, SPIN
    return {"pad": FrameHistory(ANGLES, pad, still, still),
            "disk": FrameHistory(ANGLES, disk, rate, still)}


@pytest.mark.full
def test_the_pad_brakes_with_the_mean_radius_of_the_contact() -> None:
    """1440.0 N m on the smooth outline; here the polygon's."""
    part = brake()
    area, mean = mean_radius(part.first.X[part.first.facets])
    torque = MU * PRESSURE * area * mean
    assert torque == pytest.approx(1440.0, rel=0.01)
    found, loads = part.history(motion()), part.imported(motion())
    assert found["area"] == pytest.approx(np.full(3, area), rel=1e-12)
    assert found["normal"] == pytest.approx(np.full(3, PRESSURE * area), rel=1e-9)
    assert found["power"] == pytest.approx(np.full(3, torque * SPIN), rel=1e-7)
    disk = loads["disk"]
    got = np.cross(part.second.body.X[disk.nodes], disk.force).sum(axis=1)[:, 2]
    assert got == pytest.approx(np.full(3, -torque), rel=1e-6)
    effusivity = np.sqrt([2000 * 8.7 * 935, 7850 * 44.5 * 475])
    for name, share in zip(("pad", "disk"), effusivity / effusivity.sum(), strict=True):
        heat = loads[name].heat.sum(axis=1)
        assert heat == pytest.approx(share * found["power"], rel=1e-12)


def mean_radius(corners: FloatArray) -> tuple[float, float]:
    """Area (m2) of plane triangles (F, 3, 3), and the mean distance (m) from the z axis on it, by
    the middles of 4^5 parts of each."""
    for _ in range(5):
        m = 0.5 * (corners + np.roll(corners, -1, axis=1))
        a = corners
        corners = np.concatenate([
            np.stack([a[:, 0], m[:, 0], m[:, 2]], 1), np.stack([m[:, 0], a[:, 1], m[:, 1]], 1),
            np.stack([m[:, 2], m[:, 1], a[:, 2]], 1), m])
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0],
                                         corners[:, 2] - corners[:, 0]), axis=1)
    radius = np.hypot(*corners.mean(axis=1)[:, :2].T)
    return float(area.sum()), float(area @ radius / area.sum())
