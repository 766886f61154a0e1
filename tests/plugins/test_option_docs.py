"""Docstrings of options, as they are shown by `sparsemor plugins`, the schema and the reference."""

from typing import Any

from pydantic import Field

from sparsemor.core import Plugin


class Rows(Plugin):
    """A class at the top of a module."""

    count: int = 3
    """How many,
    of each block."""
    plain: float = 1.0
    given: int = Field(default=1, description="Written as an argument.")
    """Written below."""
    list_: int = Field(default=0, alias="list")
    """Its key is a word of Python."""

    class Inner(Plugin):
        count: int = 4
        """Of the inner class."""


class MoreRows(Rows):
    """Repeats one option, adds one."""

    plain: float = 2.0
    """Now with a text."""
    extra: str = ""
    """Of its own."""


class Silent(Rows):
    """Repeats an option without a text."""

    count: int = 5


def shown(cls: type[Plugin]) -> dict[str, Any]:
    properties = cls.model_json_schema()["properties"]
    return {name: option.get("description") for name, option in properties.items()}


def test_an_option_is_described_by_the_text_below_it() -> None:
    assert shown(Rows) == {"count": "How many,\nof each block.", "plain": None,
                           "given": "Written as an argument.",
                           "list": "Its key is a word of Python."}


def test_options_of_a_base_keep_their_texts_unless_written_again() -> None:
    assert shown(MoreRows) == {
        **shown(Rows), "plain": "Now with a text.", "extra": "Of its own."}
    assert shown(Silent) == {**shown(Rows), "count": None}


def test_classes_of_the_same_name_are_not_confused() -> None:
    class Rows(Plugin):
        """A class in a function."""

        count: int = 1
        """Of the class in the function."""

    assert shown(Rows) == {"count": "Of the class in the function."}
    assert shown(globals()["Rows"].Inner) == {"count": "Of the inner class."}


def test_a_class_without_source_has_none() -> None:
    names: dict[str, Any] = {"Plugin": Plugin, "__name__": "no_module"}
    exec("class Made(Plugin):\n    count: int = 1\n    'No file holds this.'\n", names)
    assert shown(names["Made"]) == {"count": None}
