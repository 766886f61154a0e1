"""Pages of docs/, by name: which folder they stand in is the site's business."""

from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"
UNPUBLISHED = ("decisions", "developers", "gallery_out", "notebooks_out")
"""Folders that are no part of the site."""


def page_named(name: str) -> Path:
    """The one page of that name."""
    (page,) = DOCS.rglob(name)
    return page
