"""The number of threads that an algorithm may use."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any


def requested_threads(options: Mapping[str, Any]) -> int:
    """Return the number of threads of the options; 0 stands for all cores."""
    return int(options["threads"]) or os.cpu_count() or 1
