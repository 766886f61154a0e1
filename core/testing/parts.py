"""Law kit of the parts of an assembled scene: bodies, joints, contacts and loads."""

from collections.abc import Mapping, Sequence

import numpy as np

from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.model import Model
from sparsemor.core.protocols import Part, Term
from sparsemor.core.scene.scene import Scene
from sparsemor.core.testing.random_inputs import law
from sparsemor.core.testing.term import check_term


def check_parts(scene: Scene, seed: int = 0, trials: int = 2) -> None:
    """Laws of every part (body, joint, contact, load) of a scene: its blocks are in the layout
    (order of all unknowns), its terms satisfy the laws of a term (`check_term`) and use rows and
    columns of the layout, and a second assembly gives the same model."""
    model, again = assemble(scene), assemble(scene)
    law([b.name for b in model.layout] == [b.name for b in again.layout]
        and np.array_equal(model.x0, again.x0) and np.array_equal(model.v0, again.v0),
        "two assemblies of one scene differ")
    finite = np.isfinite(model.x0).all() and np.isfinite(model.v0).all()
    law(bool(finite), "the start is not finite")
    for number, (name, part) in enumerate(model.parts.items()):
        _blocks(name, part, model)
        for term in terms_of(model, name):
            _term(name, term, model, np.random.default_rng([seed, number]), trials)
    _required(model.required, model)


def terms_of(model: Model, name: str) -> Sequence[Term]:
    """Terms that the body, joint, contact or load `name` adds to the equations."""
    return model.by_part[name]


def _blocks(name: str, part: Part, model: Model) -> None:
    law(part.name == name, f"{name} calls itself {part.name}")
    for block in part.blocks():
        if block.size:
            law(block.name in model.layout, f"{name}: block {block.name} is not in the layout")
            at = model.layout[block.name]
            law(at.stop - at.start == block.size, f"{name}: {block.name} has another size there")


def _term(name: str, term: Term, model: Model, rng: np.random.Generator, trials: int) -> None:
    layout, n = model.layout, model.layout.size
    inside = all(0 <= i.min(initial=0) and i.max(initial=0) < n for i in (term.rows, term.columns))
    law(inside, f"{name}: rows or columns outside the layout")
    first = layout.first
    warm = bool(np.all((term.columns >= first.start) & (term.columns < first.stop)))
    one_order = bool(np.all(term.columns < layout.second.stop)) or warm
    try:
        check_term(term, rng, base=model.x0[term.columns], scale=1.0 if warm else 1e-3,
                   trials=trials, same_rates=one_order)
    except AssertionError as error:
        raise AssertionError(f"{name}: {type(term).__name__}: {error}") from error


def _required(required: Mapping[str, object], model: Model) -> None:
    for name, rows in required.items():
        at, own = model.layout[name], np.asarray(rows)
        law(bool(np.all(np.diff(own) > 0)), f"the required rows of {name} are not sorted")
        law(own.size == 0 or (own[0] >= 0 and own[-1] < at.stop - at.start),
            f"a required row of {name} is outside the block")
