"""Site of these pages: `sphinx-build -W docs site`. It needs the extra `docs`, and no network."""

import re
from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx

HERE = Path(__file__).parent
project = "sparsemor"
author = project_copyright = "sparsemor developers"
release = version = version_of("sparsemor")
language = "en"

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx_gallery.gen_gallery"]
exclude_patterns = [
    "decisions", "developers", "gallery_src", "notebooks", "examples", "site",
    "sg_execution_times.rst", "gallery_out/index.rst", "*_out/*.ipynb", "*_out/*.py"]
suppress_warnings = ["toc.multiple_toc_parents"]  # of the pattern validation/*
html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_title = f"sparsemor {release}"
html_show_sourcelink = False
highlight_language = "text"
pygments_style, pygments_dark_style = "tango", "monokai"
html_math_renderer = "mathml"

myst_enable_extensions = ["dollarmath", "attrs_block"]
myst_heading_anchors = 6

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True

sphinx_gallery_conf = {
    "examples_dirs": ["gallery_src", "notebooks"],
    "gallery_dirs": ["gallery_out", "notebooks_out"],  # tests run the notebooks, the site does not
    "download_all_examples": False,
    "show_memory": False, "write_computation_times": False, "show_signature": False,
    "remove_config_comments": True, "image_scrapers": ("matplotlib",),
}

_FENCE = re.compile(r"(^ *```.*?^ *```[ \t]*$)", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"(?<!!)\[([^\[\]]*)\]\(([^()\s]+)\)")
GALLERIES = {"gallery_src": "gallery_out", "notebooks": "notebooks_out"}
IN_REPOSITORY_ONLY = ("decisions", "developers", "examples")


def _for_the_site(app: Sphinx, docname: str, source: list[str]) -> None:
    """Links to files that are no pages of the site become their paths in the repository;
    commands are shown as on a screen."""
    folder = Path(app.srcdir, docname).parent

    def shown(link: re.Match[str]) -> str:
        text, target = link.groups()
        path = (folder / target.partition("#")[0]).resolve()
        if "://" in target or target.startswith("#") or not path.exists():
            return link[0]
        if path.suffix == ".py" and path.parent.name in GALLERIES:
            return f"[{text}](/{GALLERIES[path.parent.name]}/{path.stem}.rst)"
        inside = path.is_relative_to(HERE) and path.relative_to(HERE).parts[0]
        if path.is_file() and inside and inside not in IN_REPOSITORY_ONLY:
            return link[0]
        place = f"`{path.relative_to(HERE.parent)}`"
        return place if place in text else f"{text} ({place})"

    if app.env.doc2path(docname).suffix == ".md":
        parts = _FENCE.split(source[0])
        parts[::2] = [_LINK.sub(shown, part) for part in parts[::2]]
        parts[1::2] = [_session(part) if part.startswith("```console") else part
                       for part in parts[1::2]]
        source[0] = "".join(parts)


def _session(block: str) -> str:
    """A block of commands as a reader's screen shows it: without the marks for the tests."""
    return re.sub(r"(?m)^# -> ", "", block.replace("\n$ ! ", "\n$ "))


def _mathml(translator: Any, node: nodes.math | nodes.math_block) -> None:
    """Equations as the browser's own MathML: no script, and nothing to fetch."""
    block = isinstance(node, nodes.math_block)
    translator.body.append(tex2mathml(node.astext(), as_block=block))
    raise nodes.SkipNode


_MARKS = re.compile(r"(`[^`]*`)")


def _plain_docstrings(
    app: Sphinx, what: str, name: str, thing: object, options: object, lines: list[str]
) -> None:
    """Docstrings are plain text: indented blocks are code, `names` too, and no other mark counts.
    """
    made: list[str] = []
    for paragraph in "\n".join(lines).split("\n\n"):
        if all(line.startswith("  ") for line in paragraph.splitlines()):
            made += ["::", "", *("    " + line for line in paragraph.splitlines()), ""]
            continue
        parts = _MARKS.split(" ".join(line.strip() for line in paragraph.splitlines()))
        parts[::2] = [re.sub(r"([*|_\\:<])", r"\\\1", part) for part in parts[::2]]
        parts[1::2] = [f"`{part}` " if part.strip("`").strip() == "" else f"\\ `{part}`\\ "
                       for part in parts[1::2]]
        made += ["".join(parts), ""]
    lines[:] = made


def setup(app: Sphinx) -> None:
    app.connect("autodoc-process-docstring", _plain_docstrings)
    app.add_html_math_renderer("mathml", (_mathml, None), (_mathml, None))
    app.connect("source-read", _for_the_site)
