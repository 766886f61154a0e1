"""What time alone decides, at all times at once: as it is time by time."""

import numpy as np
import pytest

from sparsemor.bodies.frames.applied_forces import BodyForce, Reaction, SpaceForce
from sparsemor.bodies.frames.constraints import UnitLength
from sparsemor.bodies.frames.frame import SpatialFrame
from sparsemor.bodies.frames.inertia import Inertia
from sparsemor.bodies.frames.mass_moments import moments_of
from sparsemor.bodies.frames.mean_displacement_and_rotation import MeanPoint
from sparsemor.core.protocols.body_frame import FrameWork
from sparsemor.core.protocols.load_tables import Table
from sparsemor.core.protocols.prescribed_motion import FrameHistory
from sparsemor.core.protocols.separable import amplitudes_along, evaluate_amplitudes
from sparsemor.reducers.step.time_tables import TabulatedLoads, total_load, total_load_along

TIMES = np.array([0.0, 0.01, 0.02, 0.03, 0.05])
BETWEEN = np.array([-0.01, 0.004, 0.02, 0.035, 0.06])


def frame(size: int, rng: np.random.Generator) -> SpatialFrame:
    """All that pushes on displacements, among items that do not."""
    moments = moments_of(size)
    loose = (UnitLength(),) if size == 7 else ()
    reactions = Table(TIMES, rng.standard_normal((len(TIMES), 6)))
    return SpatialFrame((
        Inertia(2.0, rng.standard_normal(3), rng.standard_normal(moments.count), moments), *loose,
        SpaceForce(1.0, rng.standard_normal(3), rng.standard_normal(3), lambda t: 1.0 + t),
        MeanPoint(rng.standard_normal(3)), Reaction(reactions, True),
        BodyForce(rng.standard_normal(3), rng.standard_normal(3), np.cos),
        Reaction(reactions, False),
    ), True, size)


def pushing(f: SpatialFrame) -> list[int]:
    """The first direction of each item that pushes."""
    first = np.cumsum([0, *(i.directions for i in f.items)]).tolist()
    return [j for i, j in zip(f.items, first, strict=False) if i.pushes]


@pytest.mark.parametrize("size", [4, 7])
@pytest.mark.parametrize("times", [TIMES, BETWEEN])
def test_a_frame_drives_at_all_times_as_at_each(size, times) -> None:
    for seed in range(2):
        rng = np.random.default_rng(seed)
        f = frame(size, rng)
        y, v, a = rng.standard_normal((3, len(times), f.border))
        if size == 7:
            y[:, 3:7] /= np.linalg.norm(y[:, 3:7], axis=1)[:, None]
        got = f.drive_along(y, v, a, times)
        for i, t in enumerate(times.tolist()):
            work = FrameWork(f.p, f.border, f.generators)
            f.drive(y[i], v[i], a[i], t, work)
            want = np.concatenate([work.coefficients[:-1], work.sigma[-1]])
            assert np.abs(got[i] - want).max() <= 4e-15 * np.abs(want).max()
            assert all(work.sigma[-1, at : at + 3].any() for at in pushing(f))


def test_tables_and_motions_at_many_times() -> None:
    rng = np.random.default_rng(0)
    table = Table(TIMES, rng.standard_normal((len(TIMES), 3)))
    parts = table, TabulatedLoads(table, rng.standard_normal((3, 3)))
    pose, rate, acceleration = rng.standard_normal((3, len(TIMES), 7))
    history = FrameHistory(TIMES, pose, rate, acceleration)
    assert table.along(TIMES.copy()) is table.values
    assert history.along(TIMES.copy())[0] is pose
    for times in (TIMES, BETWEEN):
        many, motion = total_load_along(parts, times), history.along(times)
        for i, t in enumerate(times.tolist()):
            assert np.allclose(many[i], total_load(parts, t), rtol=1e-14, atol=1e-14)
            for one, there in zip(motion, history.at(t), strict=True):
                assert np.array_equal(one[i], there)


def test_amplitudes_are_functions_of_one_time() -> None:
    """Also such as cannot take arrays, and none."""
    given = (lambda t: 1.0 if t > 0.02 else 0.0, lambda t: float(f"{t:.2f}"))
    many = amplitudes_along(given, TIMES)
    assert np.array_equal(many, [evaluate_amplitudes(given, t) for t in TIMES.tolist()])
    assert amplitudes_along((), TIMES).shape == (len(TIMES), 0)
