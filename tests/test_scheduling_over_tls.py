"""Workers of a cluster over TLS, as Dask is configured: the same results; without its certificates, none."""

import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.foundation.workers.scheduling import WorkPart, open_scheduler, run_parts

dask = pytest.importorskip("dask")
distributed = pytest.importorskip("distributed")
pytest.importorskip("cryptography")  # makes the certificates of the test

PARTS = [WorkPart(f"square-{k}", np.square, np.array([float(k)])) for k in range(5)]


#: A scheduler that takes TLS alone, and two workers, until its standard input ends.
SERVER = """
import pathlib, sys
import distributed
security = distributed.Security.temporary()
for name, text in (("ca", security.tls_ca_file), ("cert", security.tls_client_cert), ("key", security.tls_client_key)):
    pathlib.Path(sys.argv[1], name + ".pem").write_text(text)
cluster = distributed.LocalCluster(
    n_workers=2, threads_per_worker=1, processes=False, protocol="tls://", dashboard_address=None, security=security,
)
print(cluster.scheduler_address, flush=True)
sys.stdin.read()
"""


class Served(NamedTuple):
    """Where the scheduler is, and the folder of its clients' certificates."""

    address: str
    folder: Path


def configuration(folder: Path) -> dict[str, str]:
    """Return Dask's configuration of a client with certificates in files, as `docs/how-to/many-machines.md` says."""
    return {
        "distributed.comm.tls.ca-file": str(folder / "ca.pem"),
        "distributed.comm.tls.client.cert": str(folder / "cert.pem"),
        "distributed.comm.tls.client.key": str(folder / "key.pem"),
    }


def certificates_of_others(folder: Path) -> dict[str, str]:
    """Return the configuration of a client whose certificates belong to another cluster."""
    security = distributed.Security.temporary()
    texts = {"ca": security.tls_ca_file, "cert": security.tls_client_cert, "key": security.tls_client_key}
    for name, text in texts.items():
        (folder / f"{name}.pem").write_text(text)
    return configuration(folder)


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A process of its own: a cluster that turned clients away may wait for them without end when it is closed."""
    folder = tmp_path_factory.mktemp("certificates")
    command = [sys.executable, "-c", SERVER, str(folder)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield Served(process.stdout.readline().strip(), folder)
        finally:
            process.kill()


def squares(address: str) -> list[float]:
    found = run_parts(PARTS, [part.key for part in PARTS], open_scheduler(address))
    return [float(found[part.key][0]) for part in PARTS]


def test_parts_are_run_over_tls(cluster: Served):
    assert cluster.address.startswith("tls://")
    with dask.config.set(configuration(cluster.folder)):
        assert squares(cluster.address) == [0.0, 1.0, 4.0, 9.0, 16.0]


@pytest.mark.parametrize("client", ["no certificates", "certificates of others", "no encryption"])
def test_a_client_without_the_certificates_is_not_let_in(
    cluster: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, client: str
):
    """One line that names the scheduler; nothing was run."""
    monkeypatch.setattr("hrsi.hrsi_engine.foundation.workers.cluster.CONNECT_S", 3.0)
    monkeypatch.setattr("hrsi.hrsi_engine.foundation.workers.cluster.GIVE_UP_S", 10.0)
    others = certificates_of_others(tmp_path)
    address = cluster.address
    if client == "no encryption":
        address = address.replace("tls://", "tcp://")
    with dask.config.set(others if client == "certificates of others" else {}), pytest.raises(InputError) as error:
        squares(address)
    assert address in str(error.value) and "\n" not in str(error.value)


def test_a_client_that_waits_without_end_is_given_up(monkeypatch: pytest.MonkeyPatch):
    """Dask's own timeout does not always hold, where a connection is closed at the wrong moment."""
    monkeypatch.setattr("hrsi.hrsi_engine.foundation.workers.cluster.GIVE_UP_S", 0.2)
    monkeypatch.setattr(distributed, "Client", lambda *_given, **_named: threading.Event().wait(60.0))
    with pytest.raises(InputError, match="tcp://nowhere:1: no Dask scheduler answers there"):
        squares("tcp://nowhere:1")
