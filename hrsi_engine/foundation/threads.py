"""The number of threads that work may use."""

from __future__ import annotations

import os


def thread_count(asked: int) -> int:
    """Return the number of threads; 0 stands for all cores."""
    return asked or os.cpu_count() or 1
