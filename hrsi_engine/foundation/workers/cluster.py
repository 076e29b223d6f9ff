"""Connection to a Dask scheduler; failures of its workers become errors with one line."""

import logging
import os
import socket
import threading
from asyncio import CancelledError as AsyncCancelledError
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from ..errors import InputError, SolveError
from .certificates import Certificates

CONNECT_S = 10  # time limit of Dask for the answer of the scheduler
GIVE_UP_S = 30  # time after which the attempt to connect is abandoned


@contextmanager
def open_client(address: str, certificates: Certificates) -> Iterator[Any]:
    """Yield a client of the Dask scheduler at an address; calls that are still pending at the end are cancelled.

    ``certificates`` are for an address that begins with ``tls://`` or ``wss://``. Raises `InputError` if the package
    ``distributed`` is missing or no scheduler answers at the address, `SolveError` if the connection was lost or the
    workers died repeatedly.
    """
    try:
        from distributed import KilledWorker
    except ImportError:
        raise InputError(
            "a `scheduler` needs the Python package distributed: install it here and on the workers "
            "(pip install 'hrsi[distributed]'), or leave `scheduler` out"
        ) from None
    client = _connect(address, certificates)
    # Dask would log tracebacks of the errors that are reported in one line here
    loggers = {logger: logger.level for logger in map(logging.getLogger, ("distributed", "distributed.client"))}
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield client
    except (CancelledError, AsyncCancelledError, KilledWorker, OSError) as error:
        if client.status == "running" and not isinstance(error, KilledWorker):
            raise
        reason = "its workers died again and again" if isinstance(error, KilledWorker) else "it is gone"
        raise SolveError(
            f"`scheduler` {address} was lost ({reason}): finished parts are kept; run the same command again, with "
            "this scheduler, another one or none"
        ) from None
    finally:
        client.close(timeout=2)
        for logger, level in loggers.items():
            logger.setLevel(level)


@dataclass(frozen=True, eq=False)
class OnWorker:
    """A callable that adds the name of its worker to the message of an `InputError`."""

    call: Callable[..., Any]

    def __call__(self, *arguments: Any) -> Any:
        try:
            return self.call(*arguments)
        except InputError as error:
            from distributed import get_worker

            worker = get_worker()
            raise InputError(
                f"{error} (on the Dask worker {worker.name} at {worker.address}, host {socket.gethostname()}: workers "
                "need the same files under the same paths, and the same versions of HRSI and GDAL)"
            ) from None


def _connect(address: str, certificates: Certificates) -> Any:
    """Return a client of the scheduler at an address; raise `InputError` if it cannot be reached."""
    from distributed import Client, Security

    for argument, file in (
        ("scheduler_ca", certificates.authority),
        ("scheduler_certificate", certificates.own),
        ("scheduler_key", certificates.key),
    ):
        if file is not None and not os.path.isfile(file):
            raise InputError(f"`{argument}` {file}: no such file: name a file in PEM format")
    encrypted = address.startswith(("tls://", "wss://"))
    advice = "start one with 'dask scheduler', or leave the option out"
    try:
        security = None
        if encrypted:
            advice = (
                "check `scheduler_ca`, `scheduler_certificate` and `scheduler_key`, or distributed.comm.tls in Dask's "
                "configuration"
            )
            address_text = {
                "tls_ca_file": certificates.authority,
                "tls_client_cert": certificates.own,
                "tls_client_key": certificates.key or certificates.own,
            }
            named_files = {name: file for name, file in address_text.items() if file is not None}
            security = Security(require_encryption=True, **named_files)
        # If a scheduler closes the connection during the handshake (it does not trust the certificate), the client of
        # Dask waits for ever and ignores its own timeout; therefore it is created in a thread that can be abandoned
        answer: Future[Any] = Future()

        def run() -> None:
            try:
                answer.set_result(Client(address, timeout=CONNECT_S, set_as_default=False, security=security))
            except BaseException as error:  # raised below, in the thread that waits
                answer.set_exception(error)

        threading.Thread(target=run, daemon=True).start()
        wait([answer], GIVE_UP_S)
        if not answer.done():
            raise TimeoutError(f"no answer in {GIVE_UP_S:g} s")
        return answer.result()
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"`scheduler` {address}: no Dask scheduler answers there ({reason}): {advice}") from None
