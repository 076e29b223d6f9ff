"""Workers of a cluster over TLS, as Dask is configured: the same results; without its certificates, none."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.foundation.scheduling import WorkPart, open_scheduler, run_parts

dask = pytest.importorskip("dask")
distributed = pytest.importorskip("distributed")
pytest.importorskip("cryptography")  # makes the certificates of the test

PARTS = [WorkPart(f"square-{k}", np.square, np.array([float(k)])) for k in range(5)]


def configured(folder: Path, security: Any) -> dict[str, str]:
    """Return Dask's configuration of a client with certificates in files, as `docs/how-to/many-machines.md` says."""
    folder.mkdir()
    texts = {"ca": security.tls_ca_file, "cert": security.tls_client_cert, "key": security.tls_client_key}
    for name, text in texts.items():
        (folder / f"{name}.pem").write_text(text)
    return {
        "distributed.comm.tls.ca-file": str(folder / "ca.pem"),
        "distributed.comm.tls.client.cert": str(folder / "cert.pem"),
        "distributed.comm.tls.client.key": str(folder / "key.pem"),
    }


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """A scheduler that takes TLS alone, and two workers."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=False, protocol="tls://", dashboard_address=None,
        security=distributed.Security.temporary(),
    ) as found:  # fmt: skip
        yield found


def squares(address: str) -> list[float]:
    found = run_parts(PARTS, [part.key for part in PARTS], open_scheduler(address))
    return [float(found[part.key][0]) for part in PARTS]


def test_parts_are_run_over_tls(cluster: Any, tmp_path: Path):
    assert cluster.scheduler_address.startswith("tls://")
    with dask.config.set(configured(tmp_path / "own", cluster.security)):
        assert squares(cluster.scheduler_address) == [0.0, 1.0, 4.0, 9.0, 16.0]


@pytest.mark.parametrize("client", ["no certificates", "certificates of others", "no encryption"])
def test_a_client_without_the_certificates_is_not_let_in(
    cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, client: str
):
    """One line that names the scheduler; nothing was run."""
    monkeypatch.setattr("hrsi.hrsi_engine.foundation.cluster.CONNECT_S", 3.0)
    monkeypatch.setattr("hrsi.hrsi_engine.foundation.cluster.GIVE_UP_S", 10.0)
    others = configured(tmp_path / "others", distributed.Security.temporary())
    address = cluster.scheduler_address
    if client == "no encryption":
        address = address.replace("tls://", "tcp://")
    with dask.config.set(others if client == "certificates of others" else {}), pytest.raises(InputError) as error:
        squares(address)
    assert address in str(error.value) and "\n" not in str(error.value)


def test_a_client_that_waits_without_end_is_given_up(monkeypatch: pytest.MonkeyPatch):
    """Dask's own timeout does not always hold, where a connection is closed at the wrong moment."""
    monkeypatch.setattr("hrsi.hrsi_engine.foundation.cluster.GIVE_UP_S", 0.2)
    monkeypatch.setattr(distributed, "Client", lambda *_given, **_named: threading.Event().wait(60.0))
    with pytest.raises(InputError, match="tcp://nowhere:1: no Dask scheduler answers there"):
        squares("tcp://nowhere:1")
