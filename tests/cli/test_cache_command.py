"""`sparsemor cache`: sizes, and a limit that removes what was not used for the longest time."""

import os
from pathlib import Path

import numpy as np
import pytest

from sparsemor.core.cli import app
from sparsemor.core.simulation.cache import Cache
from sparsemor.plugins.commands.cache import bytes_of, in_words


def command(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str]:
    with pytest.raises(SystemExit) as ended:
        app(["cache", *words])
    printed = capsys.readouterr()
    return int(str(ended.value.code)), printed.out + printed.err


def test_the_limit_keeps_what_was_used_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("SPARSEMOR_CACHE", str(tmp_path))
    store = Cache()
    for age, key in enumerate("abc"):
        store.get_or_make("basis", key, lambda: {"x": np.zeros(1000)})
        os.utime(store.place("basis", key) / "manifest.json", (age, age))
    store.get_or_make("basis", "a", dict)  # a use
    assert "basis" in command(capsys)[1]
    code, text = command(capsys, "--limit", "20kB")
    assert code == 0 and "removed" in text
    assert [e.key for e in store.entries()] == ["a", "c"]
    assert command(capsys, "--clear")[0] == 0 and not store.entries()
    code, text = command(capsys, "--limit", "lots")
    assert code == 2 and "--limit: give a size such as 2GB" in text


def test_sizes_in_words() -> None:
    assert [bytes_of(t) for t in ("0", "2GB", "1.5 MB", "7")] == [0, 2 * 10**9, 1_500_000, 7]
    assert [in_words(n) for n in (0, 12, 2_500_000)] == ["0 B", "12 B", "2.5 MB"]
