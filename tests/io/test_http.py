"""A server that takes connections and says nothing: it is waited for as long as GDAL's options say, not longer."""

import os
import pickle
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator

import pytest
from osgeo import gdal
from rpc_samples import sample_rpc, write_image

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.opening.datasets import HTTP_PATIENCE, set_http_patience
from hrsi.hrsi_engine.io.point_files import read_points
from hrsi.hrsi_engine.io.rasters.dems import open_dem
from hrsi.hrsi_engine.io.rasters.images import GdalRaster, open_image

WAIT_S = 1  # what the tests set instead of the default


class Server:
    """Answers the requests with the given bytes each, then takes further ones and says nothing."""

    def __init__(self, answers: list[bytes]) -> None:
        self._socket = socket.create_server(("127.0.0.1", 0))
        self._answers, self._open = answers, list[socket.socket]()
        self.address = f"/vsicurl/http://127.0.0.1:{self._socket.getsockname()[1]}"
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        while True:
            try:
                connection, _ = self._socket.accept()
            except OSError:
                return
            self._open.append(connection)
            threading.Thread(target=self._answer, args=(connection,), daemon=True).start()

    def _answer(self, connection: socket.socket) -> None:
        while connection.recv(4096) and self._answers:
            connection.sendall(self._answers.pop(0))

    def close(self) -> None:
        for one in (self._socket, *self._open):
            one.close()


@pytest.fixture
def silent() -> Iterator[Server]:
    server = Server([])
    yield server
    server.close()


@pytest.fixture
def patience(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    before = gdal.GetConfigOption("GDAL_HTTP_LOW_SPEED_TIME")
    gdal.SetConfigOption("GDAL_HTTP_LOW_SPEED_TIME", str(WAIT_S))
    yield
    gdal.SetConfigOption("GDAL_HTTP_LOW_SPEED_TIME", before)


def test_options_are_set_unless_the_user_did(monkeypatch: pytest.MonkeyPatch) -> None:
    before = {name: gdal.GetConfigOption(name) for name in HTTP_PATIENCE}
    assert None not in before.values()
    monkeypatch.setenv("GDAL_HTTP_CONNECTTIMEOUT", "77")
    for name in HTTP_PATIENCE:
        gdal.SetConfigOption(name, None)
    gdal.SetConfigOption("GDAL_HTTP_LOW_SPEED_TIME", "88")
    set_http_patience()
    assert gdal.GetConfigOption("GDAL_HTTP_CONNECTTIMEOUT") == "77"
    assert gdal.GetConfigOption("GDAL_HTTP_LOW_SPEED_TIME") == "88"
    assert gdal.GetConfigOption("GDAL_HTTP_LOW_SPEED_LIMIT") == HTTP_PATIENCE["GDAL_HTTP_LOW_SPEED_LIMIT"]
    for name, value in before.items():
        gdal.SetConfigOption(name, value)


@pytest.mark.parametrize(
    ("name", "opened"), [("a.tif", open_image), ("dem.tif", open_dem), ("points.gpkg", read_points)]
)
def test_readers_name_the_address(silent: Server, patience: None, name: str, opened) -> None:
    address, started = f"{silent.address}/{name}", time.monotonic()
    with pytest.raises(InputError, match="whether its server answers") as caught:
        opened(address)
    assert address in str(caught.value)
    assert time.monotonic() - started < 30 * WAIT_S  # some requests, each with its own patience; a loaded machine


def test_a_server_that_stops_in_the_middle(tmp_path, patience: None) -> None:
    """It says how large the image is and sends its head, then no pixels: reading them names the address."""
    write_image(tmp_path / "a.tif", sample_rpc(), ("TILED=YES",), size=(2000, 1500))
    content = (tmp_path / "a.tif").read_bytes()
    size, head = len(content), content[:16384]
    server = Server([
        f"HTTP/1.1 200 OK\r\nContent-Length: {size}\r\nAccept-Ranges: bytes\r\n\r\n".encode(),
        f"HTTP/1.1 206 Partial Content\r\nContent-Range: bytes 0-16383/{size}\r\nContent-Length: 16384\r\n\r\n".encode()
        + head,
    ])  # fmt: skip
    address = f"{server.address}/a.tif"
    gdal.SetConfigOption("GDAL_DISABLE_READDIR_ON_OPEN", "EMPTY_DIR")
    try:
        raster = GdalRaster(address)
        started = time.monotonic()
        with pytest.raises(InputError, match="pixels at sample 1500, line 1000 cannot be read") as caught:
            raster.read(1500, 1000, 100, 100)
        assert address in str(caught.value) and time.monotonic() - started < 30 * WAIT_S
    finally:
        gdal.SetConfigOption("GDAL_DISABLE_READDIR_ON_OPEN", None)
        server.close()


def test_the_command_line(silent: Server) -> None:
    """With the environment's patience; the exit code is that of wrong input, and one line names the address."""
    words = [sys.executable, "-m", "hrsi.processing_algorithms.command_line.cli", "rpc-info", f"{silent.address}/a.tif"]
    done = subprocess.run(
        words, capture_output=True, text=True, check=False, timeout=120,
        env=os.environ | {"GDAL_HTTP_LOW_SPEED_TIME": str(WAIT_S)},
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr.startswith(f"ERROR: {silent.address}/a.tif: ") and done.stderr.count("\n") == 1


def test_a_worker_has_the_options_from_what_it_is_sent(silent: Server) -> None:
    """A worker of a cluster imports what comes with its work, no more; there the image is opened."""
    raster = GdalRaster.__new__(GdalRaster)
    raster.__dict__ |= {"path": f"{silent.address}/a.tif", "_band": 1, "stamp": (), "size": (9, 9)}
    program = (
        "import pickle, sys\n"
        "raster = pickle.loads(sys.stdin.buffer.read())\n"
        "from osgeo import gdal\n"
        "print([gdal.GetConfigOption(name) for name in sys.argv[1:]])\n"
        "try:\n"
        "    raster.read(0, 0, 9, 9)\n"
        "except Exception as error:\n"
        "    print(type(error).__name__, error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, *HTTP_PATIENCE], input=pickle.dumps(raster), capture_output=True, check=False,
        timeout=120, env=os.environ | {"GDAL_HTTP_LOW_SPEED_TIME": str(WAIT_S)},
    )  # fmt: skip
    options, error = done.stdout.decode().splitlines()
    assert options == str([{**HTTP_PATIENCE, "GDAL_HTTP_LOW_SPEED_TIME": str(WAIT_S)}[name] for name in HTTP_PATIENCE])
    assert error.startswith(f"InputError {silent.address}/a.tif: ")
