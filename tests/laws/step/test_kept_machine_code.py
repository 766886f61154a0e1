"""Machine code that is kept: nobody but its user can have written it, and no damage is loaded."""

import ast
import os
import pickle
import stat
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sparsemor
from sparsemor.core.simulation.cache import Cache
from sparsemor.reducers.step.compiled.machine_code import MachineCode

KEY, DATA = "a function", b"\x90" * 1000
ours = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="files have no owners here")


@pytest.fixture(autouse=True)
def caches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache that may be shared, and the user's own."""
    monkeypatch.setenv("SPARSEMOR_CACHE", str(tmp_path / "shared"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "own"))
    return tmp_path


def written() -> tuple[MachineCode, Path]:
    kept = MachineCode("code")
    kept.write(KEY, DATA)
    assert kept.folder is not None
    file, = kept.folder.iterdir()
    return kept, file


def test_code_is_found_again_by_its_key_alone() -> None:
    assert not MachineCode("code")
    written()
    kept = MachineCode("code")
    assert kept and kept.read(KEY) == DATA and kept.read("another") is None
    assert not MachineCode("other")


@ours
def test_code_of_the_own_cache_serves_an_empty_shared_one(
    caches: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else runs that look for kept code would find it, and compile it again nevertheless."""
    _, file = written()
    own = caches / "own" / "sparsemor" / "machine_code" / "code"
    own.parent.mkdir(parents=True)
    file.parent.rename(own)
    monkeypatch.setenv("SPARSEMOR_CACHE", str(caches / "empty"))
    assert MachineCode("code", make=False)
    kept = MachineCode("code")
    assert kept and kept.folder == own and kept.read(KEY) == DATA


def test_code_under_the_name_of_another_is_a_miss() -> None:
    """Its digest is of the key too: a file that is moved is not the code of another function."""
    kept, file = written()
    kept.write("another", b"ret")
    other, = {*file.parent.iterdir()} - {file}
    file.replace(other)
    assert kept.read("another") is None


@pytest.mark.parametrize("seed", range(40))
def test_damaged_code_is_a_miss(seed: int) -> None:
    kept, file = written()
    rng, data = np.random.default_rng(seed), bytearray(file.read_bytes())
    at = int(rng.integers(len(data)))
    if seed % 4 == 0:
        del data[at:]
    elif seed % 4 == 1:
        data += rng.bytes(at + 1)
    else:
        data[at] ^= 1 << int(rng.integers(8))
    file.write_bytes(data)
    assert kept.read(KEY) is None
    kept.write(KEY, DATA)
    assert kept.read(KEY) == DATA


@ours
@pytest.mark.parametrize("bits", [stat.S_IWGRP, stat.S_IWOTH])
def test_what_others_can_write_is_a_miss(bits: int) -> None:
    kept, file = written()
    file.chmod(0o600 | bits)
    assert kept.read(KEY) is None


@ours
def test_what_belongs_to_others_is_a_miss(monkeypatch: pytest.MonkeyPatch) -> None:
    kept, _ = written()
    other = os.geteuid() + 1
    monkeypatch.setattr("os.geteuid", lambda: other)
    assert kept.read(KEY) is None
    assert not MachineCode("code")


@ours
def test_a_link_is_a_miss(tmp_path: Path) -> None:
    kept, file = written()
    file.replace(tmp_path / "elsewhere")
    file.symlink_to(tmp_path / "elsewhere")
    assert kept.read(KEY) is None


@ours
@pytest.mark.parametrize("mode", [0o777, 0o770, 0o1777])
def test_in_a_folder_that_others_can_write_code_is_kept_in_the_own_cache(
    caches: Path, mode: int
) -> None:
    shared = caches / "shared" / "machine_code" / "code"
    shared.mkdir(parents=True)
    shared.chmod(mode)
    kept, file = written()
    assert kept.folder == caches / "own" / "sparsemor" / "machine_code" / "code"
    assert kept.read(KEY) == DATA and not list(shared.iterdir())
    assert stat.S_IMODE(file.stat().st_mode) == 0o600


@ours
def test_without_a_private_place_nothing_is_kept(caches: Path) -> None:
    for place in ("shared/machine_code/code", "own/sparsemor/machine_code/code"):
        (caches / place).mkdir(parents=True)
        (caches / place).chmod(0o777)
    kept = MachineCode("code")
    kept.write(KEY, DATA)
    assert kept.folder is None and not kept and kept.read(KEY) is None


def test_a_look_makes_no_folder(caches: Path) -> None:
    assert not MachineCode("code", make=False)
    assert not list(caches.rglob("code"))


def test_removal_takes_what_is_ours(caches: Path) -> None:
    _, file = written()
    (file.parent / "kernel.advance-1.py311.nbi").write_bytes(b"1234")  # of an earlier version
    (file.parent / "thesis.tex").write_bytes(b"mine")
    assert Cache(caches / "shared").clear() == len(DATA) + 32 + 4
    assert [f.name for f in file.parent.iterdir()] == ["thesis.tex"]


COMPILED = """
import sys
import numba
import sparsemor
from sparsemor.reducers.step.compiled.machine_code import MachineCode
from sparsemor.reducers.step.compiled.compile import with_kept_code

def twice(x):
    return 2.0 * x

kept = MachineCode("kernel")
function = with_kept_code(numba.njit(twice), kept)
before = bool(kept)
assert function(3.0) == 6.0
print(before)
"""


@pytest.mark.full
def test_compiled_functions_are_kept_in_our_files_alone(caches: Path) -> None:
    """A second process loads the machine code; pickles of numba that somebody has put there are
    not looked at, and damaged files are compiled again."""
    pytest.importorskip("numba")

    def run() -> str:
        done = subprocess.run([sys.executable, "-c", COMPILED], capture_output=True, text=True,
                              check=False)
        assert (done.returncode, done.stderr) == (0, "")
        return done.stdout.split()[0]

    assert run() == "False"
    folder = caches / "shared" / "machine_code" / "kernel"
    file, = folder.iterdir()
    for name in ("kernel.twice-6.py311.nbi", f"{'0' * 32}.code"):
        (folder / name).write_bytes(pickle.dumps(Evil()))
    before = file.stat().st_mtime_ns
    assert run() == "True" and file.stat().st_mtime_ns == before
    file.write_bytes(file.read_bytes()[:-1] + b"!")
    assert run() == "True" and file.stat().st_mtime_ns != before
    assert not (caches / "owned").exists()


class Evil:
    def __reduce__(self) -> Any:
        return Path.touch, (Path(os.environ["SPARSEMOR_CACHE"]).parent / "owned",)


@pytest.mark.full
def test_no_other_module_reads_code_from_data() -> None:
    """Entries of the cache, results and models are arrays and plain data; only machine code that
    passed its checks is unpickled."""
    root, found = Path(sparsemor.__file__).parent, set[str]()
    for path in (p for folder in ("core", "bodies", "reducers", "plugins", "integrators")
                 for p in (root / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [getattr(node, "module", None) or "", *(a.name for a in node.names)] if (
                isinstance(node, ast.Import | ast.ImportFrom)) else []
            allows = isinstance(node, ast.keyword) and node.arg == "allow_pickle" and not (
                isinstance(node.value, ast.Constant) and node.value.value is False)
            if allows or {n.split(".")[0] for n in names} & {
                    "pickle", "marshal", "shelve", "dill", "joblib"}:
                found.add(path.relative_to(root).as_posix())
    assert found == {"reducers/step/compiled/compile.py"}
