"""Settings of glibc's allocator: one heap for all threads, and return of free memory to the system."""

import ctypes
from contextlib import suppress

MOST_HEAPS = -8  # M_ARENA_MAX of glibc's malloc.h


def share_one_heap() -> None:
    """Let all threads of the process allocate from one heap, if the C library is glibc.

    By default each thread has its own heap, and memory freed in one is not available to the others. The setting is
    valid for the complete process and its later threads; therefore only HRSI's own programs call it, at their start.
    """
    with suppress(AttributeError, OSError, TypeError):  # no glibc; on Windows CDLL(None) raises
        ctypes.CDLL(None).mallopt(MOST_HEAPS, 1)


def return_free_memory() -> None:
    """Return the free memory of the heap to the system (glibc only); takes a few milliseconds per gigabyte.

    Otherwise glibc keeps free memory below blocks in use, in gaps too small for the larger arrays of the next step.
    """
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)
