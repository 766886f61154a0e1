"""Slots: what they take, what they say, and how they are written down."""

from typing import Annotated, Any, Protocol

import pytest
from pydantic import ValidationError

from sparsemor.core.protocols.plugin import Plugin
from sparsemor.core.registry.plugin_option import Slot, slot_default
from sparsemor.core.registry.registry import Registry
from sparsemor.core.registry.validation_errors import faults_of


class Rolls(Protocol):
    def roll(self) -> int: ...


class Holder(Plugin):
    reducer: Annotated[Any, Slot("reducer")] = slot_default("tuned")
    roller: Annotated[Rolls, Slot("toy_sampler")] | None = None


class Roller(Plugin):
    def roll(self) -> int:
        return 4


def faults(tree: dict[str, Any]) -> dict[str, str]:
    with pytest.raises(ValidationError) as caught:
        Holder.model_validate(tree)
    return {f.key: f.message for f in faults_of(caught.value, tree)}


pytestmark = pytest.mark.usefixtures("toys")


@pytest.mark.parametrize("given", ["tuned", {"use": "tuned"}, {"use": "tuned", "sampler": "grid"}])
def test_name_and_mapping_mean_the_same(given):
    assert Holder.model_validate({"reducer": given}) == Holder()


def test_an_instance_is_kept():
    dice = Registry().get("toy_sampler", "dice")(sides=3)
    tuned = Registry().get("reducer", "tuned")(sampler=dice)
    assert Holder(reducer=tuned).reducer.sampler is dice


def test_round_trip_through_plain_data():
    tree = {"reducer": {"use": "tuned", "sampler": {"use": "dice", "sides": 3},
                        "spare": {"a.b": "grid"}, "queue": ["dice", {"use": "grid", "mix": 0.1}],
                        "either": {"use": "dice"}}}
    made = Holder.model_validate(tree)
    dumped = made.model_dump(mode="json")
    assert dumped["reducer"]["sampler"] == {"use": "dice", "sides": 3}
    assert dumped["reducer"]["queue"] == [{"use": "dice", "sides": 6}, {"use": "grid", "mix": 0.1}]
    assert Holder.model_validate(dumped) == made


def test_faults_keep_the_whole_path_and_come_together():
    found = faults({"reducer": {
        "use": "tuned", "sampler": {"use": "grid", "mix": 2}, "smpler": 1,
        "spare": {"a.b": "grd"}, "queue": ["dice", {"use": "dice", "sids": 1}]}})
    assert set(found) == {"reducer.sampler.mix", "reducer.smpler", "reducer.spare.a.b",
                          "reducer.queue.1.sids"}
    assert found["reducer.sampler.mix"] == "Input should be less than or equal to 1 (got 2)"
    assert "did you mean sampler?" in found["reducer.smpler"]
    assert "did you mean grid?" in found["reducer.spare.a.b"]
    assert "allowed: sides" in found["reducer.queue.1.sids"]


def test_a_union_shows_the_branch_that_was_meant():
    found = faults({"reducer": {"use": "tuned", "either": {"use": "grid", "mix": 3}}})
    assert set(found) == {"reducer.either.mix"}
    found = faults({"reducer": {"use": "tuned", "either": "gird"}})
    assert set(found) == {"reducer.either"}
    assert "number" in found["reducer.either"] and "grid" in found["reducer.either"]


def test_options_alone_belong_to_the_default_plugin():
    made = Holder.model_validate({"reducer": {"use": "tuned", "sampler": {"mix": 0.25}}})
    assert made.reducer.sampler.mix == 0.25
    assert faults({"reducer": {"use": "tuned", "queue": [{"mix": 0.2}]}}) == {
        "reducer.queue.0.use": "name the toy_sampler with `use: name`"}


@pytest.mark.parametrize("given", [3, None, [1], True])
def test_what_is_no_plugin_is_refused_in_words(given):
    assert "give the name of a reducer plugin" in faults({"reducer": given})["reducer"]


def test_an_instance_must_have_the_protocol():
    dice = Registry().get("toy_sampler", "dice")()
    with pytest.raises(ValidationError, match="an instance that has roll"):
        Holder(roller=dice)
    assert Holder(roller=Roller()).roller == Roller()


def test_what_is_not_registered_cannot_be_written_down():
    with pytest.raises(Exception, match="Roller is not registered as a toy_sampler"):
        Holder(roller=Roller()).model_dump()


def test_the_registry_of_the_context_is_asked():
    nothing = Registry(entry_points=[])
    with pytest.raises(ValidationError, match="no kind of plugin called 'reducer'"):
        Holder.model_validate({}, context={"registry": nothing})
