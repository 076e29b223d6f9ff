"""Basis of all other packages: errors, progress, threads and workers, compiled loops, robust scale."""

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .errors import Cancelled as Cancelled
from .errors import HrsiError as HrsiError
from .errors import InputError as InputError
from .errors import MissingPackageError as MissingPackageError
from .errors import OutputError as OutputError
from .errors import SolveError as SolveError
from .progress import Progress as Progress
from .reasons import Level as Level
from .reasons import Reason as Reason
from .version import VERSION as VERSION
