"""What every other room stands on: errors, progress, threads and workers, compiled loops, robust scale."""

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .errors import Cancelled as Cancelled
from .errors import HrsiError as HrsiError
from .errors import InputError as InputError
from .errors import OutputError as OutputError
from .errors import SolveError as SolveError
from .progress import Progress as Progress
from .progress import advance as advance
from .progress import silent as silent
from .progress import stage as stage
from .reasons import Level as Level
from .reasons import Reason as Reason
from .robust_scale import robust_sigma as robust_sigma
from .version import VERSION as VERSION
