"""A fresh QGIS profile with the HRSI plugin in it, for ``qgis_process`` and for the desktop.

``python tests/qgis/profile.py FOLDER [ARGUMENT …]`` makes the profile and runs ``qgis_process`` with the arguments::

    python tests/qgis/profile.py /tmp/profile help hrsi:triangulate
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]


def make_profile(folder: Path) -> dict[str, str]:
    """Make a profile below ``folder``, with the plugin linked and enabled; return the environment that uses it.

    A plugin that is installed there already stays. QGIS's Python is the interpreter that runs this function, through
    PATH.
    """
    default = folder / "profiles" / "default"
    plugins, settings = default / "python" / "plugins", default / "QGIS"
    plugins.mkdir(parents=True, exist_ok=True)
    settings.mkdir(parents=True, exist_ok=True)
    if not (plugins / "hrsi").exists():
        (plugins / "hrsi").symlink_to(REPOSITORY, target_is_directory=True)
    (settings / "QGIS3.ini").write_text("[PythonPlugins]\nhrsi=true\nprocessing=true\n", encoding="utf-8")
    runtime = folder / "runtime"
    runtime.mkdir(exist_ok=True)
    runtime.chmod(0o700)  # Qt refuses a runtime folder that others can read
    return os.environ | {
        "QGIS_CUSTOM_CONFIG_PATH": str(folder),
        "XDG_RUNTIME_DIR": str(runtime),
        "QT_QPA_PLATFORM": "offscreen",
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
    }


def qgis_process_program() -> str | None:
    """Return the program's path, None without QGIS; Debian's own wrapper script around it is broken."""
    return shutil.which("qgis_process.bin") or shutil.which("qgis_process")


def qgis_process(
    folder: Path, *arguments: str, timeout_s: float = 300.0, **variables: str
) -> subprocess.CompletedProcess[str]:
    """Run ``qgis_process`` with a profile below ``folder`` and more environment variables; return what it printed."""
    program = qgis_process_program()
    if program is None:
        raise FileNotFoundError("qgis_process is not installed: apt-get install qgis python3-qgis")
    environment = make_profile(folder) | variables
    return subprocess.run(
        [program, *arguments], env=environment, capture_output=True, text=True, timeout=timeout_s, check=False
    )


def main(arguments: list[str]) -> int:
    """Run from the command line; a FOLDER of ``-`` is a temporary one."""
    folder = Path(tempfile.mkdtemp(prefix="qgis-profile-")) if arguments[0] == "-" else Path(arguments[0])
    folder.mkdir(parents=True, exist_ok=True)
    finished = qgis_process(folder, *arguments[1:])
    sys.stdout.write(finished.stdout)
    sys.stderr.write(finished.stderr)
    return finished.returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
