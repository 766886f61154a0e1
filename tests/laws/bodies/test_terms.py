"""Every term of every body, joint and load of an assembled scene keeps the laws of a term."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from small_scenes import everything, everything_assembled, tiny
from sparsemor.bodies.frames.frame import PlanarFrame
from sparsemor.bodies.terms.weak_term import WeakTerm
from sparsemor.core import Term
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.equations import AssembledTerm, system_jacobian
from sparsemor.core.model.frame_equations import FrameEquations
from sparsemor.core.model.linear_equations import LinearEquations
from sparsemor.core.model.model import Model
from sparsemor.core.testing import check_term
from term_scales import scales

LONG = ("weight", "plate", "wall", "weld", "hinge", "bolt", "hang", "shake", "wind", "brush",
        "press")
PARTS = [pytest.param(name, marks=[pytest.mark.full] * (name in LONG)) for name in (
    *everything().bodies, *everything().joints, *everything().loads)]


@pytest.fixture(scope="module")
def model() -> Model:
    return everything_assembled()


def equations_of(term: Term) -> object:
    return term.equations if isinstance(term, AssembledTerm) else term


@pytest.mark.parametrize("part", PARTS)
def test_every_term_of(model: Model, part: str) -> None:
    terms = model.by_part[part]
    held_temperature = part in ("cooled", "held")  # eliminated: in the terms of their bodies
    assert bool(terms) is not held_temperature
    for i, term in enumerate(terms):
        for scale in scales(model, term):
            check_term(term, np.random.default_rng(i), base=model.x0[term.columns], scale=scale,
                       trials=3, same_rates=isinstance(equations_of(term), FrameEquations))


def test_the_scene_has_terms_of_every_kind(model: Model) -> None:
    found = [equations_of(t) for t in model.terms]
    assert {type(e) for e in found} == {FrameEquations, LinearEquations, WeakTerm}
    items = {type(i).__name__ for e in found if isinstance(e, FrameEquations)
             and isinstance(e.frame, PlanarFrame) for i in e.frame.items}
    assert items == {"Inertia", "BodyForce", "SpaceForce", "MeanPoint", "Rotation"}
    given = [f for t in model.terms if isinstance(t, WeakTerm) for f in t.fields.values()]
    assert any(0 < len(at) < len(f.column_of) for f in given for at, _, _ in f.prescribed)


def test_every_term_has_one_owner_in_the_fast_step(model: Model) -> None:
    assert model.separated.other == ()


@pytest.mark.parametrize("form", ["csr", "csc", "coo", "dense"])
def test_a_jacobian_of_any_format_is_assembled(form: str) -> None:
    """Terms of other packages may return any of scipy's formats, or an array."""
    model = assemble(tiny())
    x, v, a = model.x0, model.v0, 0.0 * model.x0
    c = np.full(len(x), 3.0)
    expected = system_jacobian(model.layout, model.terms, x, v, a, 0.0, c, c).toarray()

    def of(term: Term) -> Any:
        def jacobian(*given: Any) -> Any:
            J = term.jacobian(*given)
            return J.toarray() if form == "dense" else J.asformat(form)
        return SimpleNamespace(columns=term.columns, rows=term.rows, jacobian=jacobian)

    found = system_jacobian(model.layout, list(map(of, model.terms)), x, v, a, 0.0, c, c)
    np.testing.assert_array_equal(found.toarray(), expected)
