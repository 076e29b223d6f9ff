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

extensions = ["myst_parser", "algorithm_pages", "mathml"]
myst_enable_extensions = ["dollarmath", "amsmath"]
myst_heading_anchors = 3
html_math_renderer = "mathml"
exclude_patterns = ["site"]

html_theme = "furo"
html_title = "HRSI"
html_logo = "../plugin/icons/hrsi.svg"
html_show_sphinx = False
html_copy_source = False
