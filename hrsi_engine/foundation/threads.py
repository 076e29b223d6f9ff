"""The number of threads that work may use, and those of the libraries below while parts of it run side by side."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from importlib import import_module
from importlib.util import find_spec
from threading import Lock


def thread_count(asked: int) -> int:
    """Return the number of threads; 0 stands for all cores."""
    return asked or os.cpu_count() or 1


class _OneThreadCalls:
    """How many runs want linear algebra to use the thread that calls it alone; the last one gives its threads back."""

    def __init__(self) -> None:
        self._lock, self._runs, self._limits = Lock(), 0, ExitStack()
        self.held = False

    @contextmanager
    def wanted(self) -> Iterator[None]:
        with self._lock:
            if not self._runs and find_spec("threadpoolctl") is not None:
                self._limits.enter_context(import_module("threadpoolctl").threadpool_limits(1, user_api="blas"))
                self.held = True
            self._runs += 1
        try:
            yield
        finally:
            with self._lock:
                self._runs -= 1
                if not self._runs:
                    self.held = False
                    self._limits.close()


#: Context in which calls of BLAS make no threads of their own, where threadpoolctl is there. The number is that of the
#: process, and several runs may share one, as tasks of QGIS do. Products of small matrices from two threads at once
#: otherwise spend a tenth of the processor's time on waiting for one another, and more on more cores.
_calls = _OneThreadCalls()
one_thread_calls = _calls.wanted


def are_one_thread_calls() -> bool:
    """Return whether calls of BLAS make no threads of their own at present, because of `one_thread_calls`."""
    return _calls.held
