"""docs/mistakes.md: each mistake is answered as the page says, and no other scene is accused."""

import re
import sys
from pathlib import Path

import pytest

from sparsemor import load
from sparsemor.core.protocols.poses import in_degrees
from sparsemor.core.registry.registry import Registry
from sparsemor.plugins.checks.units import unlikely_units

DOCS = Path(__file__).parents[2] / "docs"
sys.path.insert(0, str(DOCS))
from make_mistakes import MISTAKES, Mistake, answer, message  # noqa: E402

sys.path.remove(str(DOCS))
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def on_the_page(mistake: Mistake) -> str:
    (path,) = DOCS.rglob("mistakes.md")
    section = path.read_text(encoding="utf-8").split(f"## {mistake.title}\n")[1]
    return section.split("```text\n")[1].split("\n```")[0]


def test_there_are_twenty() -> None:
    assert len(MISTAKES) == 20 == len({m.title for m in MISTAKES})


@pytest.mark.full
@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda m: m.title)
def test_mistake(mistake: Mistake, here: Path) -> None:
    code, text = message(mistake, here)
    said, shown = answer(mistake, text), on_the_page(mistake)
    assert code == mistake.code
    assert NUMBER.sub("0", said) == NUMBER.sub("0", shown)
    assert [float(n) for n in NUMBER.findall(said)] == pytest.approx(
        [float(n) for n in NUMBER.findall(shown)], rel=0.05, abs=1e-9)


@pytest.mark.full
def test_no_scene_of_this_repository_is_accused_of_units() -> None:
    registry = Registry()
    names = [registry.spelling(p) for p in registry.names("scene")
             if p.distribution == "sparsemor"]
    files = [*(DOCS / "examples").glob("*.yaml"), *DOCS.parent.glob("tests/scenes/*.yaml")]
    for scene in [*map(load, names), *map(load, files)]:
        assert not list(unlikely_units(scene.dump()["bodies"], {})), scene.name


def test_numbers_in_other_units() -> None:
    def found(**body: object) -> list[str]:
        return [n.text for n in unlikely_units({"a": body}, {"a": 0.4})]

    steel = {"E": 2.1e11, "rho": 7850}
    assert not found(material=steel, thickness=0.01, pose={"angle": 1.5})
    assert not found(material={"E": 5e6, "rho": 1100}, thickness=1.0)  # rubber, forces per metre
    assert not found(material={"E": 1e9, "rho": 40})  # a foam with skins
    assert "2.1e+11" in found(material={"E": 210, "rho": 7850})[0]
    assert "2.1e+11" in found(materials={"core": {"E": 2.1e5, "rho": 7850}})[0]
    assert "2700" in found(material={"E": 7e10, "rho": 2.7})[0]
    assert "0.005" in found(material=steel, thickness=5)[0]
    assert "0.785398" in found(pose={"angle": 45})[0]
    assert not in_degrees(7.5 * 3.141592653589793) and not in_degrees(6.0)
