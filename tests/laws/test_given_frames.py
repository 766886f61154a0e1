"""Bodies whose frames are given: their elastic blocks are linear and cost what they read."""

from typing import Any

import numpy as np
import pytest

from sparsemor.bodies.mesh.block import Block
from sparsemor.bodies.mesh.rectangle import Rectangle
from sparsemor.core.assemble import assemble
from sparsemor.core.model import Model
from sparsemor.core.scene import Scene
from sparsemor.core.separable import FrameWork
from sparsemor.core.stage import Followed, FrameHistory, Stage
from sparsemor.core.testing.run import March, march, scene_of
from sparsemor.reducers.driven_block import CompressedDriven
from sparsemor.reducers.stepper import Stepper
from sparsemor.reducers.test_map import Forms

STEPS, H = 8, 1e-3
STEEL = {"nu": 0.3, "rho": 1100, "alpha": 1e-4, "k": 20, "c": 500}


def bar(E: float, divisions: tuple[int, int, int] = (3, 1, 1), **reducer: Any) -> Scene:
    """A clamped bar with damping, that turns about z and carries its weight."""
    return scene_of({
        "bodies": {"bar": {
            "use": "flexible", "fields": ["elastic", "thermal"], "reference": {"clamp": "left"},
            "mesh": Block(size=(0.3, 0.1, 0.06), divisions=divisions), "frame": "spinning",
            "material": {**STEEL, "E": E}, "damping": {"mass": 2.0, "stiffness": 1e-5},
            "initial_temperature": "293.15 + 50*x"}},
        "loads": {"weight": {"use": "gravity", "g": [1.0, 2.0, -9.0]}},
        "time": {"end": STEPS * H, "step": H}, "reducer": {"use": "full", **reducer}})


def plane_bar(E: float, **reducer: Any) -> Scene:
    return scene_of({
        "bodies": {"bar": {
            "use": "flexible", "fields": ["elastic"], "reference": {"clamp": "left"},
            "mesh": Rectangle(size=(0.3, 0.1), divisions=(4, 2)), "thickness": 0.02,
            "material": {**STEEL, "E": E}}},
        "loads": {"weight": {"use": "gravity", "g": [1.0, -9.0]}},
        "time": {"end": STEPS * H, "step": H}, "reducer": {"use": "full", **reducer}})


def turning(scene: Scene, spin: float, size: int) -> Model:
    """The model whose bar turns with `spin`, rad/s, and ever faster. size: of its pose."""
    t = H * np.arange(STEPS + 1)
    pose, rate, acceleration = (np.zeros((len(t), size)) for _ in range(3))
    pose[:, -1], rate[:, -1] = spin * t + 50.0 * t**2, spin + 100.0 * t
    acceleration[:, -1] = 100.0
    history = {"bar": FrameHistory(t, pose, rate, acceleration)}
    return assemble(scene, Followed(Stage(t, history, frozenset(history), {}, {}, {})))


def differ(one: March, other: March) -> float:
    """Largest difference of displacements relative to the largest."""
    x, y = one.block("bar.elastic"), other.block("bar.elastic")
    assert np.abs(y).max() > 0
    return float(np.abs(x - y).max() / np.abs(y).max())


@pytest.mark.parametrize("make, size", [(bar, 4), (plane_bar, 3)])
@pytest.mark.parametrize("E, spin", [(5e12, 60.0), (5e5, 60.0), (5e4, 400.0)])
def test_what_turns_with_the_frame_is_solved_for_however_much_it_is(make, size, E, spin) -> None:
    """From a contraction of 1e-4 to one that has to be accelerated, against the textbook Newton."""
    fast = march(make(E), model=turning(make(E), spin, size))
    scene = make(E, method="newton")
    assert differ(fast, march(scene, model=turning(scene, spin, size))) < 1e-9
    most = max(fast.iterations)
    assert most <= 4 if E == 5e12 else most > 4, fast.iterations


@pytest.mark.parametrize("make, size", [(bar, 4), (plane_bar, 3)])
def test_atoms_that_hold_the_motion_repeat_it(make, size) -> None:
    """In full order's solution, stiffness, damping, Coriolis and heat under the atoms are right."""
    scene = make(5e6)
    full = march(scene, model=turning(scene, 60.0, size))
    names = [b.name for b in full.model.layout]
    snapshots = {n: full.block(n).T.copy() for n in names}
    reduced = make(5e6, use="galerkin", basis={"use": "pod", "rank_rtol": 1e-11})
    got = march(reduced, model=turning(reduced, 60.0, size), snapshots=snapshots)
    atoms = got.solver.dictionaries["bar.elastic"].atoms
    x, y = got.block("bar.elastic") @ atoms.T, full.block("bar.elastic")
    assert atoms.shape[1] < atoms.shape[0]
    assert np.abs(x - y)[1:].max() < 1e-8 * np.abs(y).max()


@pytest.mark.parametrize("make, size", [(bar, 4), (plane_bar, 3)])
@pytest.mark.parametrize("polish", [False, True])
def test_atoms_are_chosen_without_the_forms_that_only_rigid_equations_need(
    make, size, polish, monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As published, from a full basis; of 7018 atoms the forms took minutes and most of a step."""
    scene = make(5e6)
    full = march(scene, model=turning(scene, 60.0, size))
    names = [b.name for b in full.model.layout]
    snapshots = {n: full.block(n).T.copy() for n in names}
    budgets = {n: {"rows": len(S), "atoms": 9} for n, S in snapshots.items()}
    chosen = make(5e6, use="sparse", basis={"use": "pod", "complete": True}, polish=polish,
                  sampler={"use": "lhs", "required": False}, budgets=budgets)

    def unwanted(_: object) -> None:
        raise AssertionError("nothing rigid is solved for")

    monkeypatch.setattr(Forms, "matrices", property(unwanted))
    got = march(chosen, model=turning(chosen, 60.0, size), snapshots=snapshots)
    assert got.solver.dictionaries["bar.elastic"].atoms.shape[1] == len(snapshots["bar.elastic"])
    x, y = got.block("bar.elastic"), full.block("bar.elastic")
    x = x @ got.solver.dictionaries["bar.elastic"].atoms.T
    assert np.abs(x - y)[1:].max() < 1e-6 * np.abs(y).max()


def test_a_body_at_rest_is_one_product_and_one_that_turns_a_few() -> None:
    for use in ({"use": "full"}, {"use": "galerkin", "basis": {"use": "modal", "count": 5}}):
        scene = bar(5e8, **use)
        assert set(march(scene, model=turning(scene, 0.0, 4)).iterations) <= {2, 3, 4}
        tree = scene.using({"bodies.bar.frame": "fixed"})
        assert set(march(tree).iterations) == {1}


def test_what_a_step_reads_does_not_grow_with_the_mesh_nor_by_rows_for_the_rigid_ones() -> None:
    read = []
    for divisions in ((3, 1, 1), (8, 3, 2)):
        scene = bar(5e8, divisions, use="galerkin", basis={"use": "modal", "count": 5})
        solver = march(scene, model=turning(scene, 60.0, 4)).solver
        assert isinstance(solver, Stepper)
        block = solver.elastic["bar.elastic"]
        assert isinstance(block, CompressedDriven)
        assert block.coupling.shape[0] == 5 and block.G.shape == (3, 5, 5)
        read.append([a.shape for a in (
            block.coupling, block.inertia, block.damping, block.E, block.base, block.G)])
    assert read[0] == read[1]


@pytest.mark.parametrize("make, size", [(bar, 4), (plane_bar, 3)])
def test_a_frame_gives_the_same_with_and_without_derivatives(make, size) -> None:
    (body,) = turning(make(5e8), 60.0, size).separated.moving
    f, guide = body.frame, body.guide
    assert guide is not None and f.border == size
    one, other = (FrameWork(f.p, f.border, f.generators) for _ in range(2))
    rng, g, known = np.random.default_rng(0), f.generators, guide.at(3 * H)
    s, forms = rng.standard_normal((3, f.p)), rng.standard_normal(3 * g)
    f.evaluate(*known, 1e3, 1e6, *s, forms[:g], forms[g:], 3 * H, one)
    f.drive(*known, 1e3, 1e6, 3 * H, other)
    assert one.sigma[-1].any() and one.coefficients[:-1].any()
    assert np.array_equal(one.sigma[-1], other.sigma[-1])
    assert np.array_equal(one.coefficients, other.coefficients)
