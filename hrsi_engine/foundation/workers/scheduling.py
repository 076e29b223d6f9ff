"""Independent parts of a computation, run by threads of this machine, or by workers of a Dask scheduler.

A part is a function and one object with all its input (plus the results of other parts), so that it can be sent to
another process. It returns a dict of arrays, which can be stored on disk: a part whose result is stored is not run
again. Results do not depend on where and in which order the parts ran.

`open_calls` is for work whose answers do not fit into memory together: further calls are submitted as answers are
taken, in the order of the jobs; if a worker dies, its call is repeated by another one.
"""

import hashlib
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass
from functools import partial
from typing import Any, Protocol, TypeVar

import numpy as np

from ..progress import Progress, advance, silent
from .certificates import CONFIGURED, Certificates
from .cluster import OnWorker, open_client
from .threads import call_in_order, one_thread_calls, one_thread_filters, thread_count

PartResult = dict[str, np.ndarray]


@dataclass(frozen=True)
class WorkPart:
    """One part of the work: ``function(job, *results of needs)``.

    key : unique among the parts, and equal for equal work in a later run: results are stored under it
    function : does the work, possibly in another process; job : its complete input
    needs : keys of the parts whose results are its further arguments
    keep : whether the result is stored in a file; intermediate results are not; label : description for the progress
    cost : expected time of the part in comparison with the others of its round
    """

    key: str
    function: Callable[..., PartResult]
    job: Any
    needs: tuple[str, ...] = ()
    keep: bool = True
    label: str = ""
    cost: float = 1.0


class ResultStore(Protocol):
    """Stores the results of finished parts between runs; `hrsi_engine.io` has an implementation with files."""

    def load(self, key: str) -> PartResult | None:
        """Return the result stored under a key; None if there is none or it is incomplete."""

    def save(self, key: str, result: PartResult) -> None:
        """Store a result under a key."""


Graph = dict[str, tuple]
Done = Callable[[str, PartResult], None]
Scheduler = Callable[[Graph, Sequence[str], Done], None]


def run_parts(
    parts: Sequence[WorkPart],
    missing_keys: Sequence[str],
    scheduler: Scheduler,
    keeper: ResultStore | None = None,
    progress: Progress = silent,
) -> dict[str, PartResult]:
    """Return the results of the wanted parts; stored ones are loaded, the others are run with the parts that they need.

    Parts that were finished before a cancellation remain stored.

    missing_keys : keys of the results to return; scheduler : the function that runs the parts, see `open_scheduler`
    keeper : storage of finished results

    Raises `Cancelled` if ``progress`` returns False.
    """
    by_key = {part.key: part for part in parts}
    results: dict[str, PartResult] = {}
    for key in dict.fromkeys(missing_keys):
        stored = keeper.load(key) if keeper is not None and by_key[key].keep else None
        if stored is not None:
            results[key] = stored
    missing = [key for key in dict.fromkeys(missing_keys) if key not in results]
    total, left_cost = len(results) + len(missing), sum(by_key[key].cost for key in missing)
    all_costs = left_cost + sum(by_key[key].cost for key in results)

    def finish(key: str, result: PartResult) -> None:
        if keeper is not None and by_key[key].keep:
            keeper.save(key, result)
        results[key] = result
        nonlocal left_cost
        left_cost -= by_key[key].cost
        tell(key)

    def tell(key: str) -> None:
        label, fraction = by_key[key].label, 1.0 - left_cost / all_costs
        advance(progress, fraction, f"{label} ({len(results)} of {total} parts done)" if label else "")

    if missing:
        tell(missing[0])
        # Task graph in Dask's form: the missing parts, each after those that it needs
        graph = Graph()

        def add(key: str) -> None:
            part = by_key[key]
            for need in part.needs:
                if need not in graph:
                    add(need)
            graph[key] = (partial(part.function, part.job), *part.needs)  # partial: Dask does not search the job

        for key in missing:
            add(key)
        scheduler(graph, missing, finish)
    return {key: results[key] for key in missing_keys}


# ---- schedulers ------------------------------------------------------------------------------------------------------


def open_scheduler(address: str | None = None, threads: int = 0, certificates: Certificates = CONFIGURED) -> Scheduler:
    """Return the scheduler of parts: workers of the Dask scheduler at an address, else threads (0: as many as cores).

    ``certificates`` are for an address that begins with ``tls://`` or ``wss://``. Running raises `InputError` if the
    package ``distributed`` is missing, or no scheduler answers at the address.
    """
    if address:

        def run_by_dask(graph: Graph, wanted: Sequence[str], done: Done) -> None:
            with open_client(address, certificates) as client:
                from distributed import as_completed

                at_workers = {key: (OnWorker(call), *needs) for key, (call, *needs) in graph.items()}
                futures = client.get(at_workers, list(wanted), sync=False)
                for future in as_completed(futures, loop=client.loop):
                    done(str(future.key), future.result())
                    future.release()

        return run_by_dask
    count = thread_count(threads)

    def run_by_threads(graph: Graph, wanted: Sequence[str], done: Done) -> None:
        users = Counter(need for _, *needs in graph.values() for need in set(needs))
        requested, results = set(wanted), dict[str, PartResult]()  # results that other parts still need

        def call(key: str) -> PartResult:
            function, *needs = graph[key]
            result: PartResult = function(*(results[need] for need in needs))
            return result

        def take(key: str, result: PartResult) -> None:
            if key in requested:
                done(key, result)
            if users[key]:
                results[key] = result
            for need in set(graph[key][1:]):
                users[need] -= 1
                if not users[need]:
                    del results[need]

        with one_thread_calls(), one_thread_filters():
            call_in_order({key: needs for key, (_, *needs) in graph.items()}, call, count, take)

    return run_by_threads


# ---- keys ----------------------------------------------------------------------------------------------------------


def digest(*values: Any) -> str:
    """Return a short hash that is equal for equal values in any process, and different for different values.

    Values are numbers, text, arrays, dataclasses of these, and tuples, lists and dicts of them.
    """
    state = hashlib.sha256()
    _feed(state, values)
    return state.hexdigest()[:24]


def _feed(state: Any, value: Any) -> None:
    if isinstance(value, np.ndarray):
        state.update(f"array{value.shape}{value.dtype.str}".encode())
        state.update(np.ascontiguousarray(value).tobytes())
    elif is_dataclass(value) and not isinstance(value, type):
        state.update(type(value).__name__.encode())
        for field in fields(value):
            _feed(state, field.name)
            _feed(state, getattr(value, field.name))
    elif isinstance(value, Mapping):
        _feed(state, list(value.items()))
    elif isinstance(value, (tuple, list)):
        state.update(f"sequence{len(value)}".encode())
        for item in value:
            _feed(state, item)
    elif value is None or isinstance(value, (str, bytes, bool, int, float, np.generic)):
        state.update(f"{type(value).__name__}:{value!r};".encode())
    else:
        raise TypeError(f"{type(value).__name__} has no digest")


# ---- streams of calls ------------------------------------------------------------------------------------------------

Job = TypeVar("Job")
Answer = TypeVar("Answer")


class Calls:
    """Makes calls ``function(job)`` in parallel.

    submit : submits a function and its job; ahead : number of calls that are submitted before the first answer is taken
    elsewhere : whether the calls run in other processes, so that functions and jobs are pickled
    """

    def __init__(self, submit: Callable[[Callable[..., Any], Any], Any], ahead: int, elsewhere: bool) -> None:
        self._submit, self._ahead, self.elsewhere = submit, ahead, elsewhere

    def answers(self, function: Callable[[Job], Answer], jobs: Iterable[Job]) -> Iterator[Answer]:
        """Yield the answers in the order of the jobs, which are drawn from the iterable when they are submitted."""
        under_way: deque[Any] = deque()  # futures
        for job in jobs:
            if len(under_way) >= self._ahead:
                yield under_way.popleft().result()
            under_way.append(self._submit(function, job))
        while under_way:
            yield under_way.popleft().result()


@contextmanager
def open_calls(
    address: str | None = None, threads: int = 0, certificates: Certificates = CONFIGURED
) -> Iterator[Calls]:
    """Yield an executor of calls: workers of the Dask scheduler at an address, else threads; an error cancels the rest.

    threads : 0: those of the run (`thread_count`)

    Raises `InputError` and `SolveError` as `cluster.open_client`.
    """
    if address:
        with open_client(address, certificates) as client:
            # Answers are also in transit, and no worker should wait while the caller writes; more workers may join
            ahead = max(16, 8 * sum(client.nthreads().values()))
            yield Calls(lambda function, job: client.submit(OnWorker(function), job, pure=False), ahead, True)
        return
    threads = thread_count(threads)
    with ThreadPoolExecutor(threads) as pool:
        try:
            yield Calls(pool.submit, 2 * threads, False)
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
