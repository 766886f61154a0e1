"""Names of plugins: who offers them, and what is said when they cannot be had."""

import pickle
import sys

import pytest

from sparsemor.core.errors import InputError
from sparsemor.core.registry.registry import Registry

GOOD = "from sparsemor.core import Plugin\nclass Good(Plugin):\n    size: int = 1\n"


def test_listing_names_imports_nothing(distribute):
    distribute("pkg-a", {"toy": {"one": "mod_a:Good"}}, version="2.1", mod_a=GOOD)
    (one,) = Registry().names("toy")
    assert (one.name, one.distribution, one.version) == ("one", "pkg-a", "2.1")
    assert "toy" in Registry().kinds()
    assert "mod_a" not in sys.modules


def test_get_imports_only_the_one_asked_for(distribute):
    distribute("pkg-a", {"toy": {"one": "mod_a:Good"}}, mod_a=GOOD)
    distribute("pkg-b", {"toy": {"two": "mod_b:Good"}}, mod_b=GOOD)
    cls = Registry().get("toy", "one")
    assert cls().model_dump() == {"size": 1}
    assert "mod_b" not in sys.modules
    assert Registry().name_of("toy", cls) == "one"


def test_duplicates_name_both_distributions_and_import_neither(distribute):
    distribute("pkg-a", {"toy": {"one": "mod_c:Good"}}, version="1.0", mod_c=GOOD)
    distribute("pkg-b", {"toy": {"one": "mod_d:Good"}}, version="2.0", mod_d=GOOD)
    with pytest.raises(InputError, match=r"pkg-. \d\.0 and by pkg-. \d\.0") as caught:
        Registry().get("toy", "one")
    assert "pkg-a 1.0" in str(caught.value) and "pkg-b 2.0" in str(caught.value)
    assert not {"mod_c", "mod_d"} & set(sys.modules)


@pytest.mark.parametrize("text, cause", [
    ("import not_there_at_all", "ModuleNotFoundError: No module named 'not_there_at_all'"),
    ("assert False, 'no luck'", "AssertionError: no luck"),
    ("raise SystemExit(3)", "SystemExit: 3"),
    ("class Other: ...", "AttributeError"),
])
def test_a_plugin_that_fails_to_import_is_named_and_harms_no_other(distribute, text, cause):
    distribute("bad-pkg", {"toy": {"bad": "mod_bad:Bad"}}, mod_bad=text)
    distribute("pkg-a", {"toy": {"one": "mod_e:Good"}}, mod_e=GOOD)
    registry = Registry()
    with pytest.raises(InputError) as caught:
        registry.get("toy", "bad")
    for part in ("'bad'", "bad-pkg 1.0", cause):
        assert part in str(caught.value)
    assert registry.name_of("toy", registry.get("toy", "one")) == "one"


def test_an_unknown_name_suggests_the_nearest(distribute):
    distribute("pkg-a", {"toy": {"random": "mod_a:Good", "lhs": "mod_a:Good"}}, mod_a=GOOD)
    with pytest.raises(InputError, match="did you mean random.*installed: lhs, random"):
        Registry().get("toy", "randm")
    with pytest.raises(InputError, match="no kind of plugin called 'toi': did you mean toy"):
        Registry().get("toi", "random")


def test_a_class_that_is_no_plugin_is_refused(distribute):
    distribute("pkg-a", {"toy": {"odd": "mod_f:Odd"}}, mod_f="class Odd: ...")
    with pytest.raises(InputError, match="pkg-a 1.0 is no sparsemor.core.protocols.plugin.Plugin"):
        Registry().get("toy", "odd")


def test_a_registry_sees_what_is_installed_when_it_is_first_used(distribute):
    before = Registry()
    assert before.names("toy") == ()
    distribute("pkg-a", {"toy": {"one": "mod_a:Good"}}, mod_a=GOOD)
    assert before.names("toy") == ()
    assert [p.name for p in Registry().names("toy")] == ["one"]


def test_a_registry_can_be_sent_to_another_process(distribute):
    distribute("pkg-a", {"toy": {"one": "mod_a:Good"}}, mod_a=GOOD)
    registry = Registry()
    names = registry.names("toy")
    assert pickle.loads(pickle.dumps(registry)).names("toy") == names


def test_first_party_plugins_are_listed_like_others():
    samplers = {p.name: p.distribution for p in Registry().names("sampler")}
    assert samplers["lhs"] == samplers["random"] == "sparsemor"
