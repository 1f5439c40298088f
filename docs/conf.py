# SPDX-License-Identifier: Apache-2.0
"""How Sphinx reads these pages: `make docs`, or rosdoc2."""

import shutil
import xml.etree.ElementTree as ElementTree
from pathlib import Path

HERE = Path(__file__).resolve().parent
MANIFEST = HERE.parent / "package.xml"

project = "inductrack_ros"
author = copyright = "the inductrack_ros maintainers"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.viewcode"]
html_theme = "furo"
exclude_patterns = ["_build"]
autosummary_generate = True
autodoc_default_options = {"members": True, "show-inheritance": True, "ignore-module-all": True}
autodoc_member_order = "bysource"
add_module_names = False
myst_heading_anchors = 3

if MANIFEST.exists():
    release = version = ElementTree.parse(MANIFEST).findtext("version")
    html_title = f"{project} {release}"
else:
    # rosdoc2, which knows the version itself, reads a copy of this folder with pages of its own among ours, and keeps
    # what stood beside the folder in one of them.
    for name in ("CHANGELOG.rst", "CONTRIBUTING.md"):
        shutil.copy(HERE / "standard_docs" / "original" / name, HERE.parent)
    exclude_patterns += ["standard_docs", "standards.rst", "__readme_include.rst", "modules.rst", f"{project}*.rst"]
    suppress_warnings = ["myst.xref_missing"]  # links to source files, which are not copied
