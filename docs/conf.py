"""The documentation site (Sphinx): ``make docs`` builds it into build/docs, warnings are errors."""

from __future__ import annotations

import sys
from pathlib import Path

from hrsi.hrsi_engine.foundation.version import VERSION

sys.path.insert(0, str(Path(__file__).parent / "site"))

project = "HRSI"
author = "The HRSI developers"
copyright = author
version = release = VERSION

extensions = [
    "myst_parser", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.napoleon", "algorithm_pages", "mathml",
]  # fmt: skip
autodoc_typehints = "none"  # the docstrings say them, with shapes and units
autosummary_generate = False
napoleon_google_docstring = False
default_role = "code"  # single backticks in docstrings
smartquotes = False  # --option stays --option
myst_enable_extensions = ["dollarmath", "amsmath"]
myst_heading_anchors = 3
html_math_renderer = "mathml"
exclude_patterns = ["site"]

html_theme = "furo"
html_title = "HRSI"
html_logo = "../plugin/icons/hrsi.svg"
html_show_sphinx = False
html_copy_source = False
