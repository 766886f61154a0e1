"""Result on disk: its header, and its arrays as they are when it is opened.

    header.json        attributes; type, shape and dimensions of each array; a checksum
    fixed.npz          arrays that do not depend on time
    steps-000000.npz   arrays over time, of the first `steps_per_chunk` steps; and so on

Steps exist as soon as the file of steps that holds them has its name: the last one is replaced by
a longer one, as a whole. The header is written at the start and at the end of a run; its
`steps_stored` is the number of steps that there must be at least.
"""

import json
import re
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from sparsemor.core.arrays import IntArray
from sparsemor.core.errors import Damaged, InputError
from sparsemor.core.registry.installed import require
from sparsemor.core.results.atomic_files import replace_file
from sparsemor.core.results.files.temporary_folders import TemporaryFolder
from sparsemor.core.results.json_data import checksum_of, to_json
from sparsemor.core.results.npz_archive import ArchiveError, is_archive, read_array

if TYPE_CHECKING:
    import xarray as xr

HEADER, FIXED = "header.json", "fixed.npz"
FORMAT = 3
"""Version of the stored format. Versions 1 and 2 were Zarr groups."""
TIME = "time"
ALL = slice(None)
_STEPS = re.compile(r"steps-(\d{6,})\.npz")
_TYPES = ("float64", "int64", "bool")


# ------------------------------------------------------------------ files


def steps_file(store: Path, number: int) -> Path:
    """File of steps with this number."""
    return store / f"steps-{number:06d}.npz"


def steps_files(store: Path) -> dict[int, Path]:
    """Number -> file of steps, in their order."""
    found = ((match, p) for p in store.iterdir() if (match := _STEPS.fullmatch(p.name)))
    return dict(sorted((int(match[1]), path) for match, path in found))


def array_entry(
    shape: Sequence[int], dtype: str, dimensions: Sequence[str], attributes: Mapping[str, Any]
) -> dict[str, Any]:
    """Entry of an array in the header; `dtype` is float64, int64 or bool. The first entry of the
    shape of an array over time has no meaning."""
    return {"dtype": dtype, "shape": [int(n) for n in shape], "dimensions": list(dimensions),
            "attributes": dict(attributes)}


def as_stored(values: NDArray[Any]) -> NDArray[Any]:
    """Values in the type in which they are stored."""
    kind = values.dtype.kind
    return np.asarray(values, "bool" if kind == "b" else "int64" if kind in "iu" else "float64")


def over_time(entry: Mapping[str, Any]) -> bool:
    return bool(entry["dimensions"][0] == TIME)


def read_header(store: Path) -> dict[str, Any]:
    """Header of a result: `attributes` and `arrays`. Raises Damaged, and InputError for another
    version of the format."""
    file = store / HEADER
    try:
        document: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        form, kept = document["attributes"]["format"], document.pop("checksum")
        same = kept == checksum_of(document)
        whole = all(e["dtype"] in _TYPES and len(e["shape"]) == len(e["dimensions"]) > 0
                    and "attributes" in e for e in document["arrays"].values()) and (
            document["attributes"]["steps_per_chunk"] > 0)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as fault:
        raise Damaged(
            f"{file} is damaged, or no result's header ({type(fault).__name__}: {fault}): "
            "restore the file, or remove the result and repeat the run") from None
    if not (same and whole):
        raise Damaged(f"{file} is damaged or was edited: its checksum is not that of its "
                      "content. Restore the file, or remove the result and repeat the run")
    if form != FORMAT:
        raise InputError(f"{file} has format {form!r}; this version reads format {FORMAT}: "
                         "open it with the version that wrote it")
    return document


def write_header(store: Path, document: Mapping[str, Any]) -> None:
    replace_file(store / HEADER, to_json({**document, "checksum": checksum_of(document)}))


def refuse_older(place: Path) -> None:
    """Raises InputError if a result of an earlier version of the format is in a folder, or is the
    folder."""
    for store in (place / "result.zarr", place):
        if (store / "zarr.json").is_file():
            raise InputError(
                f"{store} is a result of an earlier format (Zarr) of sparsemor "
                f"{_version(store / 'zarr.json')}, which this version does not read: open it with "
                "that version, or repeat the run")


def _version(file: Path) -> str:
    try:
        return str(json.loads(file.read_text(encoding="utf-8"))
                   ["attributes"]["versions"]["sparsemor"])
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return "(unknown version)"


# ------------------------------------------------------------------ arrays


class ResultArrays(Protocol):
    """Arrays of one result by name, on disk or in memory, and its attributes. check: raises Damaged
    where something is missing; read: copy of the entries `rows` along the first axis."""

    @property
    def attributes(self) -> dict[str, Any]: ...
    @property
    def arrays(self) -> dict[str, dict[str, Any]]:
        """Array name -> entry of the header (`array_entry`)."""
        ...

    def __contains__(self, name: str) -> bool: ...
    def shape(self, name: str) -> tuple[int, ...]: ...
    def check(self) -> None: ...
    def read(self, name: str, rows: slice | IntArray = ALL) -> NDArray[Any]: ...


class StoredArrays:
    """Arrays of one result by name, with the files of steps that are there when this object is
    created.

    folder: temporary folder of the result, which exists as long as this object; least: number of
    steps that there must be, if it is more than the header says. Raises Damaged, with the path of
    the file, when the header is damaged; `read` does so for another file.
    """

    def __init__(
        self, root: Path, folder: TemporaryFolder | None = None, least: int = 0
    ) -> None:
        self.root, self._folder = root, folder
        document = read_header(root)
        self.attributes: dict[str, Any] = document["attributes"]
        self.arrays: dict[str, dict[str, Any]] = document["arrays"]
        self.per_file = int(self.attributes["steps_per_chunk"])
        self.least = max(least, int(self.attributes["steps_stored"]))
        self._files = steps_files(root)

    def __contains__(self, name: str) -> bool:
        return name in self.arrays

    @cached_property
    def steps(self) -> int:
        """Number of stored steps, at least `least`, the number that the header or the caller
        requires. Their files hold `per_file` steps each, the last one fewer if need be; _files:
        number -> file. Raises Damaged where one is missing."""
        last = max([*self._files, (self.least - 1) // self.per_file])
        if last < 0:
            return 0
        for number in range(last + 1):
            if number not in self._files:
                raise Damaged(self._lost(steps_file(self.root, number), "is missing"))
        found = last * self.per_file + len(self._array(self._files[last], TIME))
        if found < self.least:
            raise Damaged(self._lost(self._files[last], "is damaged: it ends too early"))
        return found

    def shape(self, name: str) -> tuple[int, ...]:
        first, *inner = self.arrays[name]["shape"]
        return (self.steps if over_time(self.arrays[name]) else first, *inner)

    def check(self, whole: bool = False) -> None:
        """Raises Damaged if a file is missing or has no whole end. whole: also if the checksum of a
        file is not that of its bytes."""
        _ = self.steps
        for file in (self.root / FIXED, *self._files.values()):
            if not is_archive(file, self.attributes["run"], checked=whole):
                raise Damaged(self._lost(file, "is damaged: it is not as it was written"
                                         if file.is_file() else "is missing"))

    def read(self, name: str, rows: slice | IntArray = ALL) -> NDArray[Any]:
        """Copy of the entries `rows` along the first axis of an array, complete along all other
        axes."""
        entry = self.arrays[name]
        if not over_time(entry):
            return self._rows(self.root / FIXED, name, entry["shape"][0])[rows].copy()
        wanted = np.arange(self.steps)[rows]
        values = np.empty((len(wanted), *entry["shape"][1:]), dtype=entry["dtype"])
        file_of = wanted // self.per_file
        for number in np.unique(file_of).tolist():
            first = number * self.per_file
            part = self._rows(
                self._files[number], name, min(self.per_file, self.steps - first))
            at = file_of == number
            values[at] = part[wanted[at] - first]
        return values

    def _rows(self, file: Path, name: str, count: int) -> NDArray[Any]:
        """First rows of an array in a file, which may have become longer."""
        values = self._array(file, name)
        if len(values) < count:
            raise Damaged(self._lost(file, f"is damaged: {len(values)} of {count} rows of {name}"))
        return values[:count]

    def _array(self, file: Path, name: str) -> NDArray[Any]:
        """Values of an array from a file. Raises Damaged where they are missing or do not fit the
        header."""
        entry = self.arrays[name]
        try:
            values = read_array(file, name)
        except FileNotFoundError:
            raise Damaged(self._lost(file, "is missing")) from None
        except ArchiveError as error:
            raise Damaged(self._lost(file, f"is damaged: {name}: {error}")) from None
        if values.dtype != np.dtype(entry["dtype"]) or values.ndim != len(entry["shape"]) or (
                [*values.shape[1:]] != entry["shape"][1:]):
            raise Damaged(self._lost(file, f"is damaged: {name} is another array"))
        return values

    def _lost(self, file: Path, fault: str) -> str:
        what = "the arrays that do not depend on time"
        if match := _STEPS.fullmatch(file.name):
            first = int(match[1]) * self.per_file
            end = first + self.per_file
            what = f"steps {first} to {(min(end, self.least) if self.least > first else end) - 1}"
        return (f"{file} {fault}; {what} are lost: restore the file, or remove the result and "
                "repeat the run")


def dataset(stored: ResultArrays) -> "xr.Dataset":
    """All arrays as a lazily loaded dataset with dimension names, units and the attributes of the
    result; those with parts as JSON. Coordinates: the time, and names of components of probes,
    joint forces and rigid coordinates. Raises InputError without the extra `xarray`."""
    require("xarray", "xarray", "to_xarray")
    import xarray as xr
    from xarray.backends import BackendArray, BackendEntrypoint
    from xarray.core import indexing

    class Lazy(BackendArray):
        """Lazily loaded array of the result `stored`: data are read when it is indexed."""

        def __init__(self, name: str) -> None:
            self.name, self.shape = name, stored.shape(name)
            self.dtype = np.dtype(stored.arrays[name]["dtype"])

        def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
            return indexing.explicit_indexing_adapter(
                key, self.shape, indexing.IndexingSupport.OUTER, self._at)

        def _at(self, key: tuple[Any, ...]) -> NDArray[Any]:
            first, *inner = key
            values = stored.read(self.name, np.array([first]) if np.ndim(first) == 0
                                 and not isinstance(first, slice) else first)
            # the last axis first: a single number removes its axis
            for axis, part in reversed(list(enumerate(inner, start=1))):
                values = values[(ALL,) * axis + (part,)]
            return values if isinstance(first, slice) or np.ndim(first) else values[0]

    class Result(BackendEntrypoint):
        """xarray backend that opens these arrays."""

        def open_dataset(self, filename_or_obj: Any, *, drop_variables: Any = None) -> xr.Dataset:
            return xr.Dataset({
                name: (tuple(e["dimensions"]), indexing.LazilyIndexedArray(Lazy(name)),
                       _plain(e["attributes"])) for name, e in stored.arrays.items()},
                coords=_component_names(stored), attrs=_plain(stored.attributes))

    return xr.open_dataset("result", engine=Result)


def _plain(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Attributes as text and numbers, which every format of files holds."""
    return {name: value if isinstance(value, str | int | float) else json.dumps(value)
            for name, value in attributes.items()}


def _component_names(stored: ResultArrays) -> dict[str, Any]:
    """Dimension -> names along it."""
    found = dict[str, Any]()
    for e in stored.arrays.values():
        names = e["attributes"].get("components")
        if names:
            found[e["dimensions"][-1]] = (e["dimensions"][-1], list(names))
    return found
