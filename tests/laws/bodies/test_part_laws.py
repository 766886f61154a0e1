"""The laws of bodies, joints, loads and contacts hold for ours and fail for broken ones."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from scipy.sparse import csr_array

from small_scenes import SCENES, everything
from sparsemor.bodies import MULTIPLIER, RIGID, DenseTerm
from sparsemor.core import (
    Block,
    Body,
    BodyPlugin,
    ConnectorPlugin,
    Contact,
    ContactPlugin,
    Effect,
    Equations,
    FloatArray,
    InputError,
    Joint,
    JointPlugin,
    Load,
    LoadPlugin,
    Part,
)
from sparsemor.core.scene.scene import load
from sparsemor.core.testing import check_body, check_contact, check_joint, check_load

POINT = {"use": "rigid", "mass": 1.0, "inertia": 0.1, "points": {"edge": [0.1, 0.0]}}
PAIR = {"one": POINT, "two": {**POINT, "pose": {"position": [0.15, 0.0]}}}


@dataclass(frozen=True, eq=False)
class Lump(Body):
    """A body with a mass matrix (3, 3) of a test."""

    name: str
    M: FloatArray
    owner: str = ""
    pose: FloatArray = field(default_factory=lambda: np.zeros(3))

    def blocks(self) -> Sequence[Block]:
        return [Block(self.owner or self.name, RIGID, 3)]

    def contribute(self, equations: Equations) -> None:
        equations.matrix(f"{self.name}.rigid", f"{self.name}.rigid", M=csr_array(self.M))

    def initial(self) -> Mapping[str, tuple[FloatArray, FloatArray]]:
        return {f"{self.name}.rigid": (np.zeros(3), np.zeros(3))}


class Spatial(Lump):
    """A planar body with points in space."""

    def point_of(self, which: str, key: str) -> FloatArray:
        return np.zeros(3)


class OwnBody(BodyPlugin):
    """A body of a test."""

    made: Callable[[str], Any]

    def build(self, name: str, base: Path) -> Any:
        return self.made(name)


class OwnPart(ConnectorPlugin):
    """A joint, load or contact of a test."""

    made: Callable[[str, Mapping[str, Part]], Any]

    def build(self, name: str, parts: Mapping[str, Part]) -> Any:
        if not parts:
            raise InputError("no bodies")
        return self.made(name, parts)


class OwnJoint(OwnPart, JointPlugin):
    """A joint of a test."""


class OwnLoad(OwnPart, LoadPlugin):
    """A load of a test."""


class OwnContact(OwnPart, ContactPlugin):
    """A contact of a test."""


class Careless(OwnJoint, OwnLoad):
    """A part that looks its bodies up without a question."""

    def build(self, name: str, parts: Mapping[str, Part]) -> Any:
        return self.made(name, {"one": parts["one"]})


class Warm(OwnLoad):
    """A load that says it acts on temperatures."""

    acts_on: ClassVar[Effect] = "temperature"


@dataclass(frozen=True, eq=False)
class Rows(Joint):
    """A joint between poses: G x = G x0, reaction R multipliers."""

    name: str
    G: FloatArray
    R: FloatArray
    start: FloatArray

    def blocks(self) -> Sequence[Block]:
        return [Block(self.name, MULTIPLIER, len(self.G))]

    def contribute(self, equations: Equations) -> None:
        own = f"{self.name}.multiplier"
        x = np.concatenate([equations.numbers("one.rigid"), equations.numbers("two.rigid")])
        lam = equations.numbers(own)
        at = np.concatenate([x, lam])
        n, m = len(x), len(lam)
        K = np.zeros((n + m, n + m))
        K[n:, :n], K[:n, n:] = self.G, self.R
        offset = np.concatenate([np.zeros(n), self.start])

        def law(x: FloatArray, v: FloatArray, t: float) -> tuple[FloatArray, ...]:
            return K @ x - offset, K, 0.0 * K

        equations.local(["one.rigid", "two.rigid", own], DenseTerm(at, at, law), together=True)
        equations.constraint(own, [lambda t: 0.0] * m)


@dataclass(frozen=True, eq=False)
class Term(Joint, Contact, Load):
    """A part that adds one term."""

    name: str
    write: Callable[[Equations], None]
    own: tuple[Block, ...] = ()

    def blocks(self) -> Sequence[Block]:
        return self.own

    def contribute(self, equations: Equations) -> None:
        self.write(equations)


def rows(G: Any, R: Any = None, off: float = 0.0) -> OwnJoint:
    G = np.array(G, dtype=float)
    R = G.T if R is None else np.array(R, dtype=float)
    return OwnJoint(made=lambda name, parts: Rows(
        name, G, R, G @ np.array([0, 0, 0, 0.15, 0, 0.0]) + off))


TOGETHER = [[1, 0, 0, -1, 0, 0]]


def pushed(first: float, second: float, kind: type[OwnPart] = OwnLoad) -> OwnPart:
    """Forces along x on the two bodies."""
    def made(name: str, parts: Mapping[str, Part]) -> Term:
        def write(equations: Equations) -> None:
            at = np.concatenate([equations.numbers(f"{b}.rigid")[:1] for b in ("one", "two")])
            f, K = -np.array([first, second]), np.zeros((2, 2))
            term = DenseTerm(at, at, lambda x, v, t: (f, K, K))
            equations.local(["one.rigid", "two.rigid"], term)
        return Term(name, write)
    return kind(made=made)


def tied() -> OwnContact:
    """A spring of 1 N/m between the origins of the two bodies."""
    K = np.kron([[1.0, -1.0], [-1.0, 1.0]], np.eye(2))

    def made(name: str, parts: Mapping[str, Part]) -> Term:
        def write(equations: Equations) -> None:
            at = np.concatenate([equations.numbers(f"{b}.rigid")[:2] for b in ("one", "two")])
            term = DenseTerm(at, at, lambda x, v, t: (K @ x, K, 0.0 * K))
            equations.local(["one.rigid", "two.rigid"], term)
        return Term(name, write)
    return OwnContact(made=made)


def lump(M: Any, owner: str = "") -> OwnBody:
    return OwnBody(made=lambda name: Lump(name, np.array(M, dtype=float), owner))


CARELESS = Careless(made=lambda name, parts: Term(name, lambda equations: None))
BROKEN: dict[str, tuple[Callable[[], None], str]] = {
    "a mass that is not symmetric": (
        lambda: check_body(lump([[1, 0.2, 0], [0, 1, 0], [0, 0, 1]])), "mass matrix is not symm"),
    "a negative mass": (lambda: check_body(lump(np.diag([1, 1, -1]))), "the eigenvalue -1"),
    "a mass of zero": (lambda: check_body(lump(np.diag([1, 1, 0]))), "a run of 3 steps failed"),
    "a block of another owner": (
        lambda: check_body(lump(np.eye(3), "other")), "is owned by 'other'"),
    "another name": (lambda: check_body(OwnBody(
        made=lambda name: Lump("mine", np.eye(3)))), "calls itself 'mine'"),
    "a point of another dimension": (lambda: check_body(OwnBody(
        made=lambda name: Spatial(name, np.eye(3))), points=["tip"]), "has the shape (3,)"),
    "reactions that do work": (
        lambda: check_joint(rows(TOGETHER, [[1], [0], [0], [1], [0], [0]]), PAIR), "do work"),
    "no reactions": (lambda: check_joint(rows(TOGETHER, np.zeros((6, 1))), PAIR), "do work"),
    "redundant rows": (
        lambda: check_joint(rows([TOGETHER[0], TOGETHER[0]]), PAIR), "depend on each other"),
    "a row of nothing": (lambda: check_joint(rows(
        [TOGETHER[0], [0] * 6]), PAIR), "does not depend on any motion"),
    "a start that breaks it": (
        lambda: check_joint(rows(TOGETHER, off=0.01), PAIR), "has an error of 0.01 at the start"),
    "a joint of nothing": (
        lambda: check_joint(OwnJoint(made=CARELESS.made), PAIR), "and changes no body"),
    "a careless joint": (lambda: check_joint(CARELESS, PAIR), "expected an InputError"),
    "a load of nothing": (
        lambda: check_load(OwnLoad(made=CARELESS.made), PAIR), "acts on none of the bodies"),
    "a load with unknowns": (
        lambda: check_load(OwnLoad(made=lambda name, parts: Term(
            name, lambda equations: None, (Block(name, MULTIPLIER, 1),))), PAIR),
        "has no unknowns of its own"),
    "a load on the wrong field": (
        lambda: check_load(Warm(made=pushed(1.0, 1.0).made), PAIR), "acts on motion too"),
    "a careless load": (lambda: check_load(CARELESS, PAIR), "expected an InputError"),
    "no reaction": (lambda: check_contact(
        pushed(1.0, 0.0, OwnContact), PAIR), "action and reaction differ by 1"),
    "forces that turn": (lambda: check_contact(
        pushed(1.0, -1.0, OwnContact), PAIR), "action and reaction"),
    "a contact that never is": (
        lambda: check_contact(pushed(0.0, 0.0, OwnContact), PAIR), "do not touch in 20 states"),
}


@pytest.mark.full
@pytest.mark.parametrize("attempt, message", BROKEN.values(), ids=list(BROKEN))
def test_a_broken_part_breaks_a_law(attempt: Callable[[], None], message: str) -> None:
    with pytest.raises(AssertionError) as caught:
        attempt()
    assert message in str(caught.value)


@pytest.mark.full
def test_parts_of_tests_keep_the_laws() -> None:
    check_body(lump(np.eye(3)))
    check_joint(rows(TOGETHER), PAIR)
    check_load(pushed(1.0, 0.0), PAIR)
    check_contact(tied(), PAIR)


@pytest.mark.full
@pytest.mark.parametrize("space", [False, True], ids=["plane", "space"])
def test_ours_keep_the_laws(space: bool) -> None:
    scene = load(SCENES / "everything_in_space.yaml") if space else everything()
    for plugin in one_of_each(scene.bodies):
        check_body(plugin)
    for joint in one_of_each(scene.joints):
        check_joint(joint, named_by(joint, scene.bodies))
    for force in one_of_each(scene.loads):
        check_load(force, named_by(force, scene.bodies))


def named_by(plugin: Any, bodies: Mapping[str, Any]) -> dict[str, Any]:
    """The bodies that a joint or load names; the first one for loads on all."""
    text = str(plugin.model_dump())
    found = {name: body for name, body in bodies.items() if re.search(rf"\b{name}\b", text)}
    return found or dict([next(iter(bodies.items()))])


def one_of_each(parts: Mapping[str, Any]) -> list[Any]:
    """The first plugin of each class."""
    return list({type(p): p for p in reversed(parts.values())}.values())
