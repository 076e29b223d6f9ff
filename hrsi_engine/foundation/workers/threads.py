"""Number of threads of a run, calls in several threads, and limits on the threads of BLAS and OpenCV meanwhile."""

import os
import sys
from collections.abc import Callable, Collection, Hashable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar
from functools import lru_cache
from graphlib import TopologicalSorter
from heapq import heappop, heappush
from importlib import import_module
from importlib.util import find_spec
from threading import Lock
from typing import Any, TypeVar

TaskKey = TypeVar("TaskKey", bound=Hashable)
_of_run = ContextVar("_of_run", default=0)


def thread_count(requested: int = 0) -> int:
    """Return the number of threads: ``requested``; if it is 0 the limit of the run (`limit_threads`), or all cores."""
    return requested or _of_run.get() or os.cpu_count() or 1


@contextmanager
def limit_threads(count: int) -> Iterator[None]:
    """Limit the threads in this context, including those of BLAS if threadpoolctl is installed; 0: all cores."""
    previous = _of_run.set(count)
    try:
        with ExitStack() as limits:
            if count:
                _limit_blas(limits, count)
            yield
    finally:
        _of_run.reset(previous)


class _OneThreadLimit:
    """Limits a library to the calling thread while at least one run requests it; the last run removes the limit.

    ``limit`` sets the limit, registers its removal in the given stack, and returns whether there is such a library.
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
    """Return threadpoolctl's controller of the loaded libraries; a new search is made when ``modules`` has changed.

    The search through all libraries of QGIS takes 4 ms, too long for a run that starts at each click.
    """
    return import_module("threadpoolctl").ThreadpoolController()


def _limit_opencv(limits: ExitStack) -> bool:
    try:
        opencv = import_module("cv2")
    except ImportError:
        return False
    limits.callback(opencv.setNumThreads, opencv.getNumThreads())
    opencv.setNumThreads(1)
    return True


#: Context in which BLAS uses no threads of its own, if threadpoolctl is installed. The limit is valid for the process,
#: and several runs can be in one process, as tasks of QGIS are. Without the limit, products of small matrices from two
#: threads spend a tenth of the processor time on waiting for each other, and more on more cores.
_calls = _OneThreadLimit(_limit_blas)
one_thread_calls = _calls.hold
#: The same for the filters and features of OpenCV, whose threads otherwise mostly wait for each other.
one_thread_filters = _OneThreadLimit(_limit_opencv).hold


def are_one_thread_calls() -> bool:
    """Return whether BLAS is limited to the calling thread at present, by `one_thread_calls`."""
    return _calls.held


def call_in_order(
    needs: Mapping[TaskKey, Collection[TaskKey]],
    call: Callable[[TaskKey], Any],
    threads: int,
    take: Callable[[TaskKey, Any], None] = lambda key, result: None,
) -> None:
    """Call ``call(key)`` in threads for each key, after the keys that it needs, and ``take(key, result)`` in this one.

    needs : for each key the keys that it needs. Of the keys that are ready the first in this mapping is called next,
        so that few intermediate results are in memory
    """
    place = {key: number for number, key in enumerate(needs)}
    sorter = TopologicalSorter(needs)
    sorter.prepare()
    ready, running = list[tuple[int, TaskKey]](), dict[Future[Any], TaskKey]()
    with ThreadPoolExecutor(threads) as pool:
        while sorter.is_active():
            for key in sorter.get_ready():
                heappush(ready, (place[key], key))
            while ready and len(running) < threads:
                _, key = heappop(ready)
                running[pool.submit(call, key)] = key
            for completed in wait(running, return_when=FIRST_COMPLETED).done:
                key = running.pop(completed)
                take(key, completed.result())
                sorter.done(key)
