"""Arrays of a result at the state of its last commit; the checksum of each chunk is verified when
read."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from sparsemor.core.arrays import IntArray
from sparsemor.core.results import zarr_files as zf
from sparsemor.core.results.files.temporary import TemporaryFolder

if TYPE_CHECKING:
    import xarray as xr

ALL = slice(None)


class ResultArrays(Protocol):
    """Arrays of one result by name, on disk or in memory, and its attributes."""

    @property
    def attributes(self) -> dict[str, Any]: ...
    @property
    def metadata(self) -> dict[str, dict[str, Any]]:
        """Array name -> shape, names of dimensions, and attributes."""
        ...

    @property
    def names(self) -> tuple[str, ...]: ...
    def __contains__(self, name: str) -> bool: ...
    def shape(self, name: str) -> tuple[int, ...]: ...
    def attributes_of(self, name: str) -> dict[str, Any]: ...
    def check(self) -> None: ...
    def read(self, name: str, rows: slice | IntArray = ALL) -> NDArray[Any]: ...
    def dataset(self) -> "xr.Dataset": ...


class StoredArrays:
    """Arrays of one result by name, at the state of the last commit before this object was created.

    folder: temporary folder of the result, which exists as long as this object.
    `attributes`: attributes of the Zarr group, as plain data. Raises Damaged, with the path of the
    file, when the metadata are damaged; `read` does so for a missing or damaged chunk.
    """

    def __init__(self, root: Path, folder: TemporaryFolder | None = None) -> None:
        self.root, self._folder = root, folder
        document = zf.read_group(root)
        self.attributes: dict[str, Any] = document["attributes"]
        self._arrays = zf.arrays_of(document)

    def __contains__(self, name: str) -> bool:
        return name in self._arrays

    @property
    def metadata(self) -> dict[str, dict[str, Any]]:
        """Array name -> Zarr metadata of the array."""
        return self._arrays

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self._arrays)

    def shape(self, name: str) -> tuple[int, ...]:
        return tuple(self._arrays[name]["shape"])

    def attributes_of(self, name: str) -> dict[str, Any]:
        return dict(self._arrays[name]["attributes"])

    def check(self) -> None:
        """Raises Damaged if the file of a committed chunk is missing or has the wrong size."""
        zf.check_chunks(self.root, self._arrays)

    def verify(self) -> None:
        """Reads every chunk and verifies its checksum. Raises Damaged if one is missing or
        damaged."""
        for name, metadata in self._arrays.items():
            for number in range(zf.chunk_count(metadata)):
                zf.read_chunk(self.root, name, metadata, number, 0)

    def read(self, name: str, rows: slice | IntArray = ALL) -> NDArray[Any]:
        """Copy of the entries `rows` along the first axis of an array, complete along all other
        axes."""
        metadata = self._arrays[name]
        first_axis, *inner = self.shape(name)
        wanted = np.arange(first_axis)[rows]
        values = np.empty((len(wanted), *inner), dtype=metadata["data_type"])
        if zf.chunk_count(metadata) == 0:
            return values
        per_chunk = zf.chunk_shape(metadata)[0]
        chunk_of = wanted // per_chunk
        for number in np.unique(chunk_of).tolist():
            first = number * per_chunk
            count = min(per_chunk, first_axis - first)
            chunk = zf.read_chunk(self.root, name, metadata, number, count)
            at = chunk_of == number
            values[at] = chunk[wanted[at] - first]
        return values

    def dataset(self) -> "xr.Dataset":
        """All arrays as a lazily loaded dataset with dimension names, units and the attributes of
        the group."""
        import xarray as xr
        from xarray.backends import BackendArray, BackendEntrypoint
        from xarray.core import indexing

        stored = self

        class Lazy(BackendArray):
            """Lazily loaded array: data are read when it is indexed."""

            def __init__(self, name: str) -> None:
                self.name, self.shape = name, stored.shape(name)
                self.dtype = np.dtype(stored._arrays[name]["data_type"])

            def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
                return indexing.explicit_indexing_adapter(
                    key, self.shape, indexing.IndexingSupport.OUTER, self._at)

            def _at(self, key: tuple[Any, ...]) -> NDArray[Any]:
                first, *inner = key
                values = stored.read(self.name, np.array([first]) if np.ndim(first) == 0
                                     and not isinstance(first, slice) else first)
                for axis, part in reversed(list(enumerate(inner, start=1))):
                    values = values[(ALL,) * axis + (part,)]
                return values if isinstance(first, slice) or np.ndim(first) else values[0]

        class Result(BackendEntrypoint):
            """xarray backend that opens these arrays."""

            def open_dataset(
                self, filename_or_obj: Any, *, drop_variables: Any = None
            ) -> xr.Dataset:
                variables = {
                    name: (tuple(m["dimension_names"]), indexing.LazilyIndexedArray(Lazy(name)),
                           dict(m["attributes"])) for name, m in stored._arrays.items()}
                return xr.Dataset(variables, attrs=dict(stored.attributes))

        return xr.open_dataset(str(self.root), engine=Result)
