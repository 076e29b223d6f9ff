"""What an adjustment is turned into: residuals, statistics, figures of the report, tables, layers; each rule once."""

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .figures import block_report as block_report
from .figures import control_and_check as control_and_check
from .layers import block_layers as block_layers
from .residuals import Residuals as Residuals
from .verdict import Evidence as Evidence
from .verdict import Verdict as Verdict
from .verdict import find_reasons as find_reasons
