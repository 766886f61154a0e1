"""The table of verdicts in reproduce.md is that of the stored runs, and each verdict follows
from the stored numbers by the rule that the paper file has now."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

from doc_pages import page_named
from packaged_paper import packaged_paper
from sparsemor.plugins.liang2026.paper import GRADES

DOCS = Path(__file__).parents[2] / "docs"


def maker() -> ModuleType:
    spec = importlib.util.spec_from_file_location("maker", DOCS / "make_reproduction.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.full
def test_the_table_is_that_of_the_stored_verdicts() -> None:
    made = maker()
    text = page_named("reproduce.md").read_text(encoding="utf-8")
    assert made.MARK.search(text)[0] == (
        f"<!-- verdicts -->\n{made.table(packaged_paper())}<!-- end -->")


@pytest.mark.parametrize("kind", ["quick", "whole"])
def test_stored_verdicts_follow_from_stored_numbers(kind: str) -> None:
    made, items = maker(), {i.id: i for i in packaged_paper().items}
    found = made.stored(kind)
    for name, (verdict, values) in found.items():
        assert values.keys() == {n for v in items[name].values for n in (v, f"paper_{v}")}, name
        assert items[name].grade(values) == verdict, name
    if kind == "quick":
        assert found.keys() == items.keys()
        assert sum(verdict in GRADES[:2] for verdict, _ in found.values()) >= 29
