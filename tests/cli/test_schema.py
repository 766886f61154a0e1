"""The JSON schema accepts what the loader accepts, third-party plugins included."""

from typing import Any

import jsonschema
import pytest

from sparsemor.core.scene.scene import load
from sparsemor.plugins.commands.json_schema import scene_schema

pytestmark = pytest.mark.full

TREE: dict[str, Any] = {
    "format": 1, "bodies": {"a": {"use": "ball", "mass": 1.5}},
    "time": {"end": 1.0, "step": 0.1}, "integrator": "still",
    "reducer": {"use": "tuned", "sampler": {"mix": 0.3}, "queue": ["dice"]},
    "probes": {"p": {"body": "a", "at": [0, 1]}},
}


@pytest.fixture
def validator(toys, distribute) -> jsonschema.Draft202012Validator:
    distribute("bad-pkg", {"toy_sampler": {"bad": "mod_bad:Bad"}}, mod_bad="import nothing_there")
    schema = scene_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def test_it_accepts_scenes_as_written_and_as_dumped(validator):
    from sparsemor.core.scene.scene import Scene

    validator.validate(TREE)
    validator.validate(Scene.model_validate(TREE).dump())


@pytest.mark.parametrize("change", [
    {"format": 2},
    {"seed": -1},
    {"bodies": {}},
    {"bodies": {"a": "ball"}},
    {"bodies": {"a": {"use": "ball", "mass": 0}}},
    {"bodies": {"a": {"use": "bal", "mass": 1}}},
    {"integrator": "stil"},
    {"integrator": {"use": "still", "rho": 2}},
    {"integrator": {"use": "still", "damping": 0.5}},
    {"reducer": {"use": "tuned", "sampler": {"use": "dice", "mix": 0.3}}},
    {"reducer": {"use": "tuned", "queue": ["bad"]}},
    {"colour": "red"},
])
def test_it_refuses_what_the_loader_refuses(validator, change):
    assert not validator.is_valid(TREE | change)


def test_a_plugin_that_fails_to_import_is_left_out(validator):
    names = [c["const"] for c in validator.schema["$defs"]["slot.toy_sampler"]["anyOf"]
             if "const" in c]
    assert names == ["dice", "grid"]


def test_every_reference_leads_somewhere(validator):
    def references(node: Any) -> list[str]:
        if isinstance(node, dict):
            own = [node["$ref"]] if isinstance(node.get("$ref"), str) else []
            return own + [r for v in node.values() for r in references(v)]
        return [r for v in node for r in references(v)] if isinstance(node, list) else []

    targets = {r.removeprefix("#/$defs/") for r in references(validator.schema)}
    assert targets and targets <= set(validator.schema["$defs"])


@pytest.mark.parametrize("name", ["double_pendulum", "double_pendulum_published"])
def test_it_accepts_the_packaged_scenes(name):
    scene = load(name)
    validator = jsonschema.Draft202012Validator(scene_schema())
    validator.validate(scene.source.tree)
    validator.validate(scene.dump())
