"""QGIS as its users have it: the real window with a profile of its own, the zip of `make plugin` installed.

``with Desktop(work, zip_file) as desktop:`` starts it. `Desktop.ask` evaluates Python in QGIS, to look and to arrange
(names of ``agent.py``: ``panel()``, ``iface``, ``middle_of``, …); what a user does is done by real events of mouse and
keyboard: `click`, `press`, `write`. An exception that QGIS would show its user fails the step that it comes with.
The interpreter is the system's: no package beside those that QGIS brings.

``python tests/desktop/desktop.py FOLDER`` starts it and writes a picture: a try by hand.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[2] / "scripts"))
import make_plugin

from hrsi.tests.desktop.screen import SIZE_PX, Screen

HERE = Path(__file__).resolve().parent
PROGRAM = "qgis.bin"
START_S, ANSWER_S, WAIT_S = 600.0, 300.0, 180.0  # on cores that others keep busy
EVENT_S = 5.0  # an event that QGIS does not get by then goes to nobody, such as a key without a window to take it
SYSTEM_PATH = "/usr/local/bin:/usr/bin:/bin"  # no virtual environment: its Python would be QGIS's
#: Questions and hints that QGIS has for a new user only, and those of the plugin.
SETTINGS = """[PythonPlugins]
processing=true
[app]
projections\\defaultProjectCrs=EPSG:4326
[qgis]
checkVersion=false
newsFeed\\httpsfeedqgisorg\\disabled=true
[core]
NewsFeed\\httpsfeedqgisorg\\disabled=true
[hrsi]
first_steps_done=true
"""


class DesktopError(AssertionError):
    """QGIS raised an exception, or something that was waited for did not come."""


def build_zip(folder: Path) -> Path:
    """Build the plugin's zip as `make plugin` does."""
    target = folder / "hrsi.zip"
    make_plugin.build(target, {})
    return target


class Desktop:
    """A running QGIS; ``work`` keeps profile and pictures, and a second one on it goes on with the profile.

    ``zip_file`` None takes the profile's plugin as it is. ``pictures`` is where `picture` writes; ``settings`` are
    added to those of the profile, ``variables`` to the environment.
    """

    def __init__(
        self,
        work: Path,
        zip_file: Path | None = None,
        pictures: Path | None = None,
        path: str = "",
        settings: str = "",
        size_px: tuple[int, int] = SIZE_PX,
        **variables: str,
    ) -> None:
        self.work, self.pictures = work, pictures or work / "pictures"
        self.pictures.mkdir(parents=True, exist_ok=True)
        self.path, self.size_px = path or SYSTEM_PATH, size_px
        self._zip, self._settings, self._variables = zip_file, settings, variables
        self._socket_folder = tempfile.mkdtemp(prefix="hrsi-desktop-")  # its path must be short
        self.actions = 0  # clicks and keys so far

    def __enter__(self) -> Desktop:
        self.screen = Screen(self.size_px)
        try:
            self._start()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_error: Any) -> None:
        if hasattr(self, "process"):
            self.kill()
        self.screen.close()
        shutil.rmtree(self._socket_folder, ignore_errors=True)

    def _start(self) -> None:
        settings = self.work / "profiles" / "default" / "QGIS" / "QGIS3.ini"
        if not settings.exists():
            settings.parent.mkdir(parents=True)
            settings.write_text(SETTINGS, encoding="utf-8")
        if self._settings:
            with settings.open("a", encoding="utf-8") as file:
                file.write(self._settings)
        runtime = self.work / "runtime"
        runtime.mkdir(exist_ok=True)
        runtime.chmod(0o700)
        address = str(Path(self._socket_folder) / "agent")
        kept = {name: os.environ[name] for name in ("HOME", "LANG", "LC_ALL") if name in os.environ}
        kept |= {name: value for name, value in os.environ.items() if name.startswith("PIP_")} | self._variables
        environment = kept | {
            "DISPLAY": self.screen.name, "PATH": self.path, "XDG_RUNTIME_DIR": str(runtime),
            "HRSI_DESKTOP_SOCKET": address, "HRSI_DESKTOP_SIZE": "{}x{}".format(*self.screen.size_px),
            "OPENBLAS_NUM_THREADS": "1", "QT_LOGGING_RULES": "*.debug=false", "CPL_LOG": str(self.work / "gdal.log"),
        }  # fmt: skip
        command = [
            PROGRAM,
            "--nologo",
            "--noversioncheck",
            "--profiles-path",
            str(self.work),
            "--code",
            HERE / "agent.py",
        ]
        self.log = (self.work / "qgis.log").open("ab")
        self.process = subprocess.Popen(command, env=environment, stdout=self.log, stderr=self.log)
        self._connect(address)
        if self._zip is not None:
            self.ask(f"install({str(self._zip)!r})")
            self.wait("'hrsi' in plugins or failures()", START_S)
        if failures := self.ask("failures()"):
            raise DesktopError(f"the zip does not become a running plugin: {failures}")

    def _connect(self, address: str) -> None:
        end = time.monotonic() + START_S
        while True:
            try:
                self._socket = socket.socket(socket.AF_UNIX)
                self._socket.connect(address)
                break
            except OSError:
                if self.process.poll() is not None or time.monotonic() > end:
                    raise DesktopError(f"QGIS does not start: {(self.work / 'qgis.log').read_text()[-2000:]}") from None
                time.sleep(0.2)
        self._socket.settimeout(ANSWER_S)
        self._answers = self._socket.makefile("r", encoding="utf-8")

    # ---- looking ------------------------------------------------------------------------------------------------

    def ask(self, code: str) -> Any:
        """Return an expression's value in QGIS, or the ``result`` that statements leave."""
        line = ""
        try:
            self._socket.sendall(json.dumps({"code": code}).encode() + b"\n")
            line = self._answers.readline()
        except ConnectionError:
            time.sleep(1.0)  # for its last words
        except TimeoutError:
            self.process.send_signal(signal.SIGUSR1)
            time.sleep(1.0)
            raise DesktopError(f"no answer: {(self.work / 'qgis.log').read_text()[-6000:]}") from None
        if not line:
            raise DesktopError(f"QGIS is gone: {(self.work / 'qgis.log').read_text()[-6000:]}")
        answer = json.loads(line)
        failures = [*answer["uncaught"], answer["error"]]
        if any(failures):
            raise DesktopError("\n".join(filter(None, failures)))
        return answer["value"]

    def wait(self, expression: str, seconds: float = WAIT_S, pause_s: float = 0.05) -> Any:
        """Ask until an expression is true; return its value."""
        end = time.monotonic() + seconds
        while not (value := self.ask(expression)):
            if time.monotonic() > end:
                raise DesktopError(f"waited {seconds} s in vain for {expression}")
            time.sleep(pause_s)
        return value

    def picture(self, name: str) -> Path:
        """Write a picture of the whole screen; return its path."""
        path = self.pictures / f"{name}.png"
        self.ask(f"screenshot({str(path)!r})")
        return path

    # ---- doing --------------------------------------------------------------------------------------------------

    def click(self, place: str, times: int = 1) -> None:
        """Click where an expression says, such as ``button_of(panel().ui.save)``."""
        self.screen.click(*self.ask(place), times=times)
        self._settle()

    def press(self, keys: str) -> None:
        """Press a key where the focus is."""
        self.screen.press(keys)
        self._settle()

    def write(self, text: str) -> None:
        """Type a text where the focus is."""
        self.screen.write(text)
        self._settle()

    def _settle(self) -> None:
        """Wait until QGIS has taken the events, and raise what it raised."""
        self.actions += 1
        end = time.monotonic() + EVENT_S
        while self.ask("RELEASES.number") < self.screen.releases and time.monotonic() < end:
            time.sleep(0.01)
        self.screen.releases = self.ask("RELEASES.number")

    def cpu_s(self) -> float:
        """Return the processor time that QGIS has taken so far."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def kill(self) -> None:
        """End QGIS at once, as a crash does."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGKILL)
            self.process.wait()
        self.log.close()


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    with Desktop(folder, build_zip(folder)) as tried:
        tried.ask("panel().show()")
        time.sleep(1.0)
        print(tried.picture("started"), tried.cpu_s())
