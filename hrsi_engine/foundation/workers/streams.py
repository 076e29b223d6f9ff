"""Calls without end, made a few at a time by threads or by the workers of a Dask scheduler, answered in their order.

For work whose answers are too many to be held together: the next calls are handed out as answers are taken. Nothing
depends on who made which call when; a call whose worker dies is made again by another one.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, Protocol, TypeVar

from .certificates import CONFIGURED, Certificates
from .cluster import OnWorker, open_client

Job = TypeVar("Job")
Answer = TypeVar("Answer")
AHEAD = 2  # calls handed out for each thread
AHEAD_ELSEWHERE = 8  # … of a worker: its answers are under way, too, and it must not wait while this side writes
LEAST_ELSEWHERE = 16  # calls handed out, whatever the number of workers at present


class Waiting(Protocol):
    """An answer that will be there."""

    def result(self) -> Any:
        """Wait for it, and return it."""


class Calls:
    """Makes calls ``function(job)`` side by side.

    submit : hands a function and its job out; ahead : calls that are handed out before the first answer is taken
    elsewhere : whether they are made in other processes: then function and jobs travel
    """

    def __init__(self, submit: Callable[[Callable[..., Any], Any], Waiting], ahead: int, elsewhere: bool) -> None:
        self._submit, self._ahead, self.elsewhere = submit, ahead, elsewhere

    def answers(self, function: Callable[[Job], Answer], jobs: Iterable[Job]) -> Iterator[Answer]:
        """Yield the answers of all jobs, in the order of the jobs, which are drawn as they are handed out."""
        under_way: deque[Waiting] = deque()
        for job in jobs:
            if len(under_way) >= self._ahead:
                yield under_way.popleft().result()
            under_way.append(self._submit(function, job))
        while under_way:
            yield under_way.popleft().result()


@contextmanager
def open_calls(
    address: str | None = None, threads: int = 1, certificates: Certificates = CONFIGURED
) -> Iterator[Calls]:
    """Give what makes calls: workers of the Dask scheduler at an address, else threads; given up, it makes no more.

    Raises `InputError` and `SolveError` as `cluster.open_client`.
    """
    if address:
        with open_client(address, certificates) as client:
            ahead = max(LEAST_ELSEWHERE, AHEAD_ELSEWHERE * sum(client.nthreads().values()))
            yield Calls(lambda function, job: client.submit(OnWorker(function), job, pure=False), ahead, True)
        return
    with ThreadPoolExecutor(threads) as pool:
        try:
            yield Calls(pool.submit, AHEAD * threads, False)
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
