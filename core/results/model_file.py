"""First line of the file of a reduced model, which distinguishes it from a scene file."""

from pathlib import Path

MAGIC = b"sparsemor reduced model 6\n"
"""Name and version of the format."""


def is_model_file(path: Path) -> bool:
    """True for the file of a reduced model, of any version of the format."""
    try:
        with path.open("rb") as file:
            return file.read(len(MAGIC))[: len(MAGIC) - 2] == MAGIC[:-2]
    except OSError:
        return False
