"""Materials: the default by its constants, others by their names, and what is refused."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor import simulate
from sparsemor.bodies import Isotropic
from sparsemor.bodies.carbon_steel import CarbonSteel
from sparsemor.bodies.temperature_curve import TemperatureCurve
from sparsemor.core import (
    FloatArray,
    InputError,
    Material,
    MaterialProperties,
    TemperatureProperty,
)
from sparsemor.core.model.assembly import assemble
from sparsemor.core.testing import check_material
from sparsemor.core.testing.in_memory_run import scene_of

STEEL = {"rho": 7850.0, "E": 2e11, "nu": 0.3, "alpha": 1.2e-5, "k": 44.5, "c": 475.0}


class Dry(Material):
    """A material without thermal constants, and others of a test."""

    rho: float = 1000.0
    E: float | None = 1e7
    nu: float | None = 0.3
    alpha: float = 0.0
    k: float | None = None
    c: float | None = None

    def properties(self) -> MaterialProperties:
        return MaterialProperties(self.rho, self.E, self.nu, self.alpha, self.k, self.c)


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


CURVE = {"temperatures": [293.15, 600.0], "values": [50.0, 30.0]}


@pytest.mark.parametrize("changes,message", [
    ({"k": {"temperatures": [300, 400], "values": [1, -1]}},
     "k: must be positive at all temperatures"),
    ({"E": {"polynomial": [1.0, -0.1, 1e-3], "range": [0, 100]}}, "smallest value is -1.5"),
    ({"k": {"temperatures": [300, 300], "values": [1, 1]}}, "temperatures: 300 K after 300 K"),
    ({"c": {"temperatures": [300, 400, 500], "values": [1, 1]}}, "values: 2 values for 3"),
    ({"c": {"polynomial": [400, 0.1]}}, "range: is missing"),
    ({"c": {"polynomial": [400, 0.1], "range": [300, 300]}}, "range: give .low, high"),
    ({"k": {"polynomial": [1], "range": [1, 2], "values": [1, 2]}}, "k: give a table .* not both"),
    ({"k": {"temperatures": [1, 2], "values": [1, 2], "origin": 2.0}}, "belong to a polynomial"),
    ({"k": {"tabel": 1}}, "k.tabel: no such option"),
    ({"alpha": {}}, "alpha: give a table"),
    ({"k": "steel"}, "k: Input should be a valid number"),
])
def test_curves_that_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=f"bodies.bar.material.*{message}"):
        scene({**STEEL, **changes})


def two(**changes: Any) -> Any:
    bar = {"use": "flexible", "thickness": 0.01, "fields": ["elastic", "thermal"],
           "mesh": {"use": "rectangle", "size": [0.2, 0.1], "divisions": [2, 2]},
           "sets": {"half": {"where": "x < 0.11"}, "low": {"where": "y < 0.06"}},
           "reference": {"clamp": "left"}, "material": STEEL, **changes}
    return assemble(scene_of({"bodies": {"bar": bar}, "time": {"end": 1.0, "step": 0.1}}))


@pytest.mark.parametrize("materials,message", [
    ({"nowhere": STEEL}, "materials.nowhere: the mesh has no set 'nowhere'"),
    ({"left": STEEL}, "materials.left: no cell of the mesh has all its points in this set"),
    ({"half": STEEL, "low": STEEL}, "materials.low: 2 cells are in the set 'half' as well"),
    ({"half": {"rho": 1.0, "E": 1.0}}, "materials.half.nu: missing: the elastic field needs it"),
    ({"half": {**STEEL, "rho": -1}}, "materials.half.rho: Input should be greater than 0"),
])
def test_materials_by_set_that_are_refused(materials: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        two(materials=materials)


def test_equal_materials_by_set_are_one_material() -> None:
    one, several = two().separated, two(materials={"half": STEEL}).separated
    a, b = one.moving[0].operators, several.moving[0].operators
    assert a is not None and b is not None
    for x, y in ((a.stiffness, b.stiffness), (a.mass, b.mass), (a.coupling, b.coupling),
                 (one.heat[0].capacity, several.heat[0].capacity),
                 (one.heat[0].conductivity, several.heat[0].conductivity)):
        assert abs(x - y).max() <= 1e-13 * abs(x).max()
    assert not one.heat[0].local and not a.local


def test_curves_are_equal_by_their_options_also_once_evaluated() -> None:
    """A scene read twice (run and training) has equal materials, whose tables keep arrays."""
    one, same = (TemperatureCurve(temperatures=(300.0, 400.0), values=(1.0, 2.0)) for _ in "ab")
    other = TemperatureCurve(temperatures=(300.0, 400.0), values=(1.0, 3.0))
    for curve in (one, same, other):
        curve.integral(np.array([350.0]))
    assert one == same and hash(one) == hash(same) and one != other
    assert Isotropic(k=one, c=one, rho=1.0) == Isotropic(k=same, c=same, rho=1.0)


def test_a_property_without_an_integral_of_its_own_has_one() -> None:
    curve = TemperatureCurve(polynomial=(400.0, 2.0, 0.01), origin=273.15, range=(250.0, 400.0))

    class Law(TemperatureProperty):
        """Somebody else's property with the least that one must have."""
        limits, degree = curve.limits, curve.degree

        def at(self, T: FloatArray) -> tuple[FloatArray, FloatArray]:
            return curve.at(T)

    T = np.array([[200.0, 250.0, 300.0], [350.0, 400.0, 450.0]])  # also beyond its limits
    np.testing.assert_allclose(Law().integral(T), curve.integral(T), rtol=1e-13)


@pytest.mark.full
def test_a_run_outside_the_range_of_a_property_has_a_warning(tmp_path: Path) -> None:
    bar = {"use": "flexible", "thickness": 0.01, "fields": ["thermal"], "frame": "fixed",
           "mesh": {"use": "rectangle", "size": [0.2, 0.1], "divisions": [2, 1]},
           "material": {**STEEL, "k": CURVE}}
    found = {}
    for start in (400.0, 650.0):
        run = simulate(scene_of({"bodies": {"bar": {**bar, "initial_temperature": start}},
                                 "time": {"end": 1.0, "step": 0.5}}), out=tmp_path / str(start))
        found[start] = [n for n in run.summary["notes"] if "is defined from" in n]
    assert found[400.0] == []
    (text,) = found[650.0]
    assert text == ("bodies.bar.material.k is defined from 293.15 to 600 K, and temperatures of "
                    "bar reach 650 K: it is constant outside")


def test_carbon_steel_has_the_values_of_the_standard() -> None:
    """EN 1993-1-2:2005: 3.2.2 and 3.4.1, at temperatures in degrees Celsius."""
    steel = CarbonSteel()
    own = steel.properties()
    check_material(steel)
    for celsius, E, elongation, k, c in (
            (20.0, 2.1e11, 0.0, 53.334, 439.8), (400.0, 1.47e11, 5.1984e-3, 40.68, 605.88),
            (600.0, 6.51e10, 8.3984e-3, 34.02, 760.2), (735.0, 2.436e10, 1.07392e-2, 29.5245, 5e3),
            (860.0, 1.6065e10, 1.1e-2, 27.3, 683.1)):
        T = np.array([celsius + 273.15])
        found = [float(p.at(T)[0][0]) for p in (own.E, own.alpha, own.k, own.c)]
        found[1] *= celsius - 20.0
        np.testing.assert_allclose(found, [E, elongation, k, c], rtol=2e-3, atol=1e-12)
    assert scene({"use": "carbon_steel"}).bodies["bar"].material == steel
