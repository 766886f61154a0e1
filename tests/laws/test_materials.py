"""Materials: the default by its constants, others by their names, and what is refused."""

from typing import Any

import pytest

from sparsemor.bodies import Isotropic
from sparsemor.core import InputError, Plugin
from sparsemor.core.model.assembly import assemble
from sparsemor.core.testing import check_material
from sparsemor.core.testing.in_memory_run import scene_of

STEEL = {"rho": 7850.0, "E": 2e11, "nu": 0.3, "alpha": 1.2e-5, "k": 44.5, "c": 475.0}


class Dry(Plugin):
    """A material without thermal constants, and others of a test."""

    rho: float = 1000.0
    E: float | None = 1e7
    nu: float | None = 0.3
    alpha: float = 0.0
    k: float | None = None
    c: float | None = None


def scene(material: Any) -> Any:
    bar = {"use": "flexible", "thickness": 0.01, "fields": ["elastic", "thermal"],
           "mesh": {"use": "rectangle", "size": [0.2, 0.1], "divisions": [2, 1]},
           "reference": {"clamp": "left"}, "material": material}
    return scene_of({"bodies": {"bar": bar}, "time": {"end": 1.0, "step": 0.1}})


def test_a_mapping_without_use_is_isotropic() -> None:
    for material in (STEEL, {"use": "isotropic", **STEEL}, Isotropic(**STEEL)):
        assert scene(material).bodies["bar"].material == Isotropic(**STEEL)
    dumped = scene(STEEL).model_dump()["bodies"]["bar"]["material"]
    assert dumped == {"use": "isotropic", **STEEL}


def test_a_body_whose_material_lacks_what_its_field_needs_is_refused() -> None:
    for material, names in ((Dry(), "ck"), ({"rho": 1.0, "E": 1.0}, ("c", "k", "nu"))):
        with pytest.raises(InputError) as caught:
            assemble(scene(material))
        assert sorted(f.key for f in caught.value.faults) == [
            f"bodies.bar.material.{n}" for n in names]
    assert "the thermal field needs it" in str(caught.value)


@pytest.mark.parametrize("material,message", [
    ({"use": "isotropc"}, "no material plugin is called 'isotropc': did you mean isotropic"),
    ({**STEEL, "nu": 0.5}, "material.nu: Input should be less than 0.5"),
    ({"E": 1e9}, "material.rho: is missing"),
    (7850.0, "give the name of a material plugin"),
])
def test_bad_input_is_located(material: Any, message: str) -> None:
    with pytest.raises(InputError, match=f"bodies.bar.material.*{message.split(': ')[-1]}"):
        scene(material)


@pytest.mark.parametrize("change,message", [
    ({"rho": -1.0}, "rho is not positive"), ({"nu": 0.6}, "nu = 0.6"),
    ({"E": None}, "nu without E"), ({"c": 0.0}, "c is not positive"),
])
def test_laws_that_a_material_breaks(change: dict[str, Any], message: str) -> None:
    check_material(Dry())
    with pytest.raises(AssertionError, match=message):
        check_material(Dry(**change))
