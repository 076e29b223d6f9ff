"""Settings of glibc's allocator: one heap for all threads, and return of free memory to the system."""

import ctypes
from contextlib import suppress

MOST_HEAPS, TRIM_THRESHOLD, MMAP_THRESHOLD = -8, -1, -3  # M_ARENA_MAX, … of glibc's malloc.h
#: Free memory above which the heap returns memory to the system, and size from which an array is no part of the heap.
#: By default arrays of some megabytes get new pages of zeros each time: a fifth of the time of an orthoimage.
TRIMMED_BYTES, MAPPED_BYTES = 1 << 28, 1 << 25


def share_one_heap() -> None:
    """Let all threads of the process allocate from one heap that keeps what is freed, if the C library is glibc.

    By default each thread has its own heap, and memory freed in one is not available to the others. The setting is
    valid for the complete process and its later threads; therefore only HRSI's own programs call it, at their start.
    """
    with suppress(AttributeError, OSError, TypeError):  # no glibc; on Windows CDLL(None) raises
        library = ctypes.CDLL(None)
        library.mallopt(MOST_HEAPS, 1)
        library.mallopt(TRIM_THRESHOLD, TRIMMED_BYTES)
        library.mallopt(MMAP_THRESHOLD, MAPPED_BYTES)


def return_free_memory() -> None:
    """Return the free memory of the heap to the system (glibc only); takes a few milliseconds per gigabyte.

    Otherwise glibc keeps free memory below blocks in use, in gaps too small for the larger arrays of the next step.
    """
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)
