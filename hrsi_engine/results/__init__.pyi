"""Results of an adjustment: residuals, statistics, figures of the report, tables, layers; each rule in one place."""

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .residuals import Residuals as Residuals
from .verdict import Evidence as Evidence
from .verdict import Verdict as Verdict
