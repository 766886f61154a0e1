"""Distributions for tests: tiny ones made on the spot, and the third-party samples. A folder for
the results of runs that name none."""

import gc
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path

import hypothesis
import pytest
from threadpoolctl import threadpool_limits

ROOT = Path(__file__).parents[1]
THIRD_PARTY = Path(__file__).parent / "third_party"
Distribute = Callable[..., None]

TOY_PLUGINS = '''
"""Plugins without physics, to fill the slots of scenes in tests."""

from typing import Annotated, Any, ClassVar

from pydantic import Field

from sparsemor.bodies.terms.field_kinds import BODY_KINDS
from sparsemor.core import BodyPlugin, Integrator, LoadPlugin, Plugin, Reducer
from sparsemor.core.registry.plugin_option import Slot, slot_default


class Ball(BodyPlugin):
    """A body."""

    field_kinds: ClassVar[Any] = BODY_KINDS

    mass: float = Field(gt=0)
    """How heavy, kg."""

    def build(self, name, base):
        raise NotImplementedError


class Push(LoadPlugin):
    """A load."""

    force: float = 1.0
    """How strong, N."""

    def build(self, name, parts):
        raise NotImplementedError


class Still(Integrator):
    """An integrator."""

    rho: float = Field(default=0.8, ge=0, le=1)
    """Damping (-)."""

    order = property(lambda self: 1)

    def start(self, layout, state):
        return state

    def rules(self, h):
        raise NotImplementedError


class Prepares(Reducer):
    """Base of reducers."""

    def prepare(self, problem):
        raise NotImplementedError


class Direct(Prepares):
    """A reducer without options."""


class Grid(Plugin):
    """A sampler."""

    mix: float = Field(default=0.5, le=1)
    """How mixed (-)."""


class Dice(Plugin):
    """Another sampler."""

    sides: int = 6
    """How many."""


class Tuned(Prepares):
    """A reducer with slots."""

    sampler: Annotated[Any, Slot("toy_sampler")] = slot_default("grid")
    """Chooses rows."""
    spare: dict[str, Annotated[Any, Slot("toy_sampler")]] = {}
    """By block."""
    queue: list[Annotated[Any, Slot("toy_sampler")]] = []
    """In order."""
    either: float | Annotated[Any, Slot("toy_sampler")] = 1.0
    """A number or a sampler."""
    budgets: dict[str, int] = {}
    """Rows by block."""


class Second(Prepares):
    """A reducer that shares an option with the first."""

    budgets: dict[str, int] = {}
    """Rows by block."""
'''

TOY_NAMES = {
    "body": {"ball": "toy_plugins:Ball"},
    "load": {"push": "toy_plugins:Push"},
    "integrator": {"still": "toy_plugins:Still"},
    "reducer": {"direct": "toy_plugins:Direct", "tuned": "toy_plugins:Tuned",
                "second": "toy_plugins:Second"},
    "toy_sampler": {"grid": "toy_plugins:Grid", "dice": "toy_plugins:Dice"},
}


hypothesis.settings.register_profile(  # the same examples on every machine, however slow it is
    "sparsemor", derandomize=True, deadline=None, database=None,
    suppress_health_check=[hypothesis.HealthCheck.too_slow])


def pytest_configure(config: pytest.Config) -> None:
    hypothesis.settings.load_profile("sparsemor")
    # Hypothesis takes constants for its examples from the sources of all imported modules: seconds
    # in every process, and examples that depend on the tests that were collected.
    with suppress(ImportError):  # early versions take none
        from hypothesis.internal.conjecture import providers

        inside = vars(providers)
        if (empty := inside.get("_local_constants")) is not None:
            inside["_get_local_constants"] = lambda: empty
    # One thread of BLAS, for workers and programs that tests start, too: most matrices here are
    # small, and the threads of two workers on two cores wait for each other.
    os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1", MKL_NUM_THREADS="1")
    os.environ["COLUMNS"] = "100"  # of tables, whatever terminal the tests are started from
    # Compiled once for all: tests start dozens of programs that import the whole product.
    sys.dont_write_bytecode = False
    for name in ("FORCE_COLOR", "CLICOLOR_FORCE", "PYTHONWARNINGS", "PYTHONDONTWRITEBYTECODE"):
        os.environ.pop(name, None)
    threadpool_limits(limits=1, user_api="blas")
    gc.set_threshold(20_000, 20, 50)  # imported modules and collected tests are searched less often
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # started in the background by a shell
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True, scope="session")
def temporary(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What is written to the temporary directory goes where pytest removes it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tempfile, "tempdir", str(tmp_path_factory.mktemp("results")))
        yield


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory: an empty folder of this test, with a cache of its own beside it."""
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.setenv("SPARSEMOR_CACHE", str(tmp_path / "cache"))
    return folder


@pytest.fixture(scope="module")
def one_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """One cache for a file whose scenes train on the same few runs."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SPARSEMOR_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture
def distribute(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Distribute:
    """distribute(name, {kind: {plugin: target}}, module=text): install it for this test."""

    def install(
        name: str, plugins: Mapping[str, Mapping[str, str]], version: str = "1.0", **modules: str
    ) -> None:
        site = tmp_path / f"site-{name}"
        info = site / f"{name.replace('-', '_')}-{version}.dist-info"
        info.mkdir(parents=True)
        metadata = f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n"
        (info / "METADATA").write_text(metadata)
        (info / "entry_points.txt").write_text("\n".join(
            f"[sparsemor.{kind}]\n" + "\n".join(f"{k} = {v}" for k, v in named.items())
            for kind, named in plugins.items()))
        for module, text in modules.items():
            (site / f"{module}.py").write_text(text)
            monkeypatch.delitem(sys.modules, module, raising=False)
        monkeypatch.syspath_prepend(site)

    return install


@pytest.fixture
def toys(distribute: Distribute, monkeypatch: pytest.MonkeyPatch) -> None:
    """The toy plugins, installed."""
    distribute("toys", TOY_NAMES, toy_plugins=TOY_PLUGINS)
    # forgets, after the test, the module that the test will import
    monkeypatch.setitem(sys.modules, "toy_plugins", None)
    monkeypatch.delitem(sys.modules, "toy_plugins")


@pytest.fixture(scope="session")
def third_party(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for PYTHONPATH where the sample distributions are installed by pip."""
    target = tmp_path_factory.mktemp("third_party")
    sources = [str(THIRD_PARTY / name) for name in (
        "sparsemor-sample", "sparsemor-beam", "sparsemor-radau", "sparsemor-broken")]
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check",
         "--no-index", "--no-deps", "--no-build-isolation", "--target", str(target), *sources],
        check=True,
    )
    return target
