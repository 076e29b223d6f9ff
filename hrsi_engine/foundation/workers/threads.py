"""The number of threads that work may use, and those of the libraries below while parts of it run side by side."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar
from functools import lru_cache
from importlib import import_module
from importlib.util import find_spec
from threading import Lock
from typing import Any

from ..pixel_filters import should_use_opencv

_of_run = ContextVar("_of_run", default=0)


def thread_count(asked: int = 0) -> int:
    """Return the number of threads; 0 stands for those that the run may use (`limit_threads`), else all cores."""
    return asked or _of_run.get() or os.cpu_count() or 1


@contextmanager
def limit_threads(count: int) -> Iterator[None]:
    """Let a run use ``count`` threads at most, those of BLAS among them where threadpoolctl is there; 0: all cores."""
    before = _of_run.set(count)
    try:
        with ExitStack() as limits:
            if count:
                _limit_blas(limits, count)
            yield
    finally:
        _of_run.reset(before)


class _OneThreadLimit:
    """How many runs want a library to use the thread that calls it alone; the last one gives its threads back.

    ``limit`` limits the library until the stack that it gets is closed, and tells whether there is anything to limit.
    """

    def __init__(self, limit: Callable[[ExitStack], bool]) -> None:
        self._limit, self._lock, self._runs, self._limits = limit, Lock(), 0, ExitStack()
        self.held = False

    @contextmanager
    def hold(self) -> Iterator[None]:
        with self._lock:
            if not self._runs:
                self.held = self._limit(self._limits)
            self._runs += 1
        try:
            yield
        finally:
            with self._lock:
                self._runs -= 1
                if not self._runs:
                    self.held = False
                    self._limits.close()


def _limit_blas(limits: ExitStack, count: int = 1) -> bool:
    if find_spec("threadpoolctl") is None:
        return False
    limits.enter_context(_find_libraries(len(sys.modules)).limit(limits=count, user_api="blas"))
    return True


@lru_cache(maxsize=1)
def _find_libraries(modules: int) -> Any:
    """Return threadpoolctl's controller of the libraries that are loaded; looked for anew after further ``modules``.

    Going through all libraries of QGIS takes 4 ms, which a run that begins at each click shall not wait for.
    """
    return import_module("threadpoolctl").ThreadpoolController()


def _limit_opencv(limits: ExitStack) -> bool:
    if not should_use_opencv():
        return False
    opencv = import_module("cv2")
    limits.callback(opencv.setNumThreads, opencv.getNumThreads())
    opencv.setNumThreads(1)
    return True


#: Context in which calls of BLAS make no threads of their own, where threadpoolctl is there. The number is that of the
#: process, and several runs may share one, as tasks of QGIS do. Products of small matrices from two threads at once
#: otherwise spend a tenth of the processor's time on waiting for one another, and more on more cores.
_calls = _OneThreadLimit(_limit_blas)
one_thread_calls = _calls.hold
#: The same of OpenCV's filters and features, whose threads yield the processor to one another without end.
one_thread_filters = _OneThreadLimit(_limit_opencv).hold


def are_one_thread_calls() -> bool:
    """Return whether calls of BLAS make no threads of their own at present, because of `one_thread_calls`."""
    return _calls.held
