"""A basis that does not fit a block: the default one there, what is left of a dictionary, or a
refusal."""

from functools import lru_cache
from pathlib import Path
from typing import Any

import pytest

from sparsemor import load
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.fitting_bases import fitted_bases
from sparsemor.core.model.model import Model

TINY = Path(__file__).parents[2] / "scenes" / "tiny.yaml"
HEAT, MOTION = "bar.thermal", "bar.elastic"


@lru_cache
def model() -> Model:
    return assemble(load(TINY))


def fitted(**options: Any) -> tuple[dict[str, str], tuple[str, ...]]:
    """Class of the basis of each block, and the notes."""
    scene = load(TINY, {"reducer": {"use": "galerkin", **options}})
    found = fitted_bases(model(), scene.reducer)
    assert all(n.kind == "basis_by_field" for n in found.notes)
    return ({n: type(b).__name__ for n, b in found.bases.items()},
            tuple(n.text for n in found.notes))


def test_a_mechanical_basis_leaves_heat_at_the_default() -> None:
    bases, (note,) = fitted(basis="craig_bampton")
    assert bases == {HEAT: "Pod", MOTION: "CraigBampton"}
    assert note.startswith(f"reducer.basis does not fit {HEAT}, which takes the default basis pod")
    assert "no joint acts on the unknowns" in note


def test_a_basis_that_is_named_for_a_block_stays() -> None:
    assert fitted(bases={"*": "craig_bampton"}) == (
        {HEAT: "CraigBampton", MOTION: "CraigBampton"}, ())
    assert fitted(basis="craig_bampton", bases={HEAT: "modal"}) == (
        {HEAT: "Modal", MOTION: "CraigBampton"}, ())


@pytest.mark.parametrize("basis", ["attachment", "impulse"])
def test_a_basis_that_fits_no_block_stays_and_is_refused_when_built(basis: str) -> None:
    bases, notes = fitted(basis=basis)
    assert len(set(bases.values())) == 1 and "Pod" not in bases.values() and not notes


def test_a_dictionary_does_without_the_bases_that_do_not_fit() -> None:
    bases, notes = fitted(basis={"use": "dictionary", "bases": ["attachment", "modal"]})
    assert set(bases.values()) == {"Overcomplete"}
    assert len(notes) == 2 and all("does without one of its bases" in n for n in notes)
    whole, none = fitted(basis={"use": "dictionary", "bases": ["static", "modal"]})
    assert set(whole.values()) == {"Overcomplete"} and not none
