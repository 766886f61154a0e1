"""Build hook: maps the top-level folders to one import package, `sparsemor`.

A wheel gets `root.py` of this folder as `sparsemor/__init__.py` and `main.py` as its `__main__.py`.
An editable install gets a git-ignored tree of directory links under `.editable/`, so interpreters,
type checkers and editors all see plain files, new modules included.
"""

import os
import shutil
from pathlib import Path

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

FOLDERS = ("core", "plugins", "bodies", "integrators", "reducers")


class LinkTree(BuildHookInterface):
    """Build hook of hatch: adds the files of a wheel that lie elsewhere in the repository, or makes
    the tree of links of an editable install."""

    def initialize(self, version, build_data):
        """Called before a build. version: "standard" or "editable"; build_data: settings of the
        build, of which `force_include` maps files to their place in a wheel."""
        if version != "editable":
            build_data["force_include"]["core/_distribution/root.py"] = "sparsemor/__init__.py"
            build_data["force_include"]["core/_distribution/main.py"] = "sparsemor/__main__.py"
            build_data["force_include"]["core/py.typed"] = "sparsemor/py.typed"
            return
        root = Path(self.root)
        package = root / ".editable" / "sparsemor"
        package.mkdir(parents=True, exist_ok=True)
        for entry in package.iterdir():  # removes links, never what they point to
            if entry.name == "__pycache__":  # of __init__.py
                shutil.rmtree(entry)
            else:
                entry.rmdir() if entry.is_dir() and not entry.is_symlink() else entry.unlink()
        if os.name == "nt":  # junctions need no administrator rights
            from _winapi import CreateJunction

            for name in FOLDERS:
                CreateJunction(str(root / name), str(package / name))
            shutil.copyfile(root / "core" / "_distribution" / "root.py", package / "__init__.py")
            shutil.copyfile(root / "core" / "_distribution" / "main.py", package / "__main__.py")
        else:
            for name in FOLDERS:
                (package / name).symlink_to(Path("../..", name), target_is_directory=True)
            (package / "__init__.py").symlink_to("../../core/_distribution/root.py")
            (package / "__main__.py").symlink_to("../../core/_distribution/main.py")
        (package / "py.typed").touch()
