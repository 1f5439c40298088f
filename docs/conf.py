# SPDX-License-Identifier: Apache-2.0
"""How Sphinx reads these pages: `make docs`, or rosdoc2."""

import xml.etree.ElementTree as ElementTree
from pathlib import Path

HERE = Path(__file__).resolve().parent
MANIFEST = ElementTree.parse(HERE.parent / "package.xml")

project = "inductrack_ros"
author = copyright = "the inductrack_ros maintainers"
release = version = MANIFEST.findtext("version")
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.viewcode"]
html_theme = "furo"
html_title = f"{project} {release}"
exclude_patterns = ["_build"]
autosummary_generate = True
autodoc_default_options = {"members": True, "show-inheritance": True, "ignore-module-all": True}
autodoc_member_order = "bysource"
add_module_names = False
myst_heading_anchors = 3
