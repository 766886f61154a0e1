"""Text files `.mtx`: Matrix Market, and what `*MATRIX GENERATE` of Abaqus writes.

Abaqus writes `<job>_MASS<step>.mtx` and `<job>_STIF<step>.mtx`: with FORMAT=MATRIX INPUT (default)
or LABELS an entry has row node, its direction, column node, its direction and value; with
FORMAT=COORDINATE row, column and value, rows in the order of node numbers (Abaqus Analysis User's
Guide, Generating matrices).
"""

from pathlib import Path

from scipy.io import mmread

from sparsemor.bodies.matrices.formats.content import (
    FileMatrix,
    entries,
    labelled,
    plain,
    remark,
    table,
    whole,
)


def read(path: Path, name: str) -> FileMatrix:
    text = path.read_text("latin-1")
    if text[:14].lower() == "%%matrixmarket":
        return plain(mmread(path, spmatrix=False))
    first = next((line for line in text.splitlines() if not remark(line)), "")
    if len(first.replace(",", " ").split()) < 5:
        return entries(table(text, 3))
    values = table(text, 5)
    at = whole(values[:, :4], "a node or direction,")
    return labelled(at[:, :2], at[:, 2:], values[:, 4])
