"""One heap for all threads of a process, and what is free in it back to the system."""

import ctypes
from contextlib import suppress

MOST_HEAPS = -8  # M_ARENA_MAX of glibc's malloc.h


def share_one_heap() -> None:
    """Let threads take memory from the heap that is there, where the C library is glibc.

    It gives each thread a heap of its own otherwise, and what one has freed is not there for the others. This holds for
    all that is in the process and for threads that begin later: it is for a process of ours, at its start.
    """
    with suppress(AttributeError, OSError, TypeError):  # other libraries; on Windows there is none of no name
        ctypes.CDLL(None).mallopt(MOST_HEAPS, 1)


def return_free_memory() -> None:
    """Return the free memory of the heap to the system (glibc only); takes some milliseconds a gigabyte.

    It keeps what lies below anything in use otherwise, which the larger arrays of the next part do not fit into.
    """
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)
