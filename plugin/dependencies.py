"""Messages for a user of QGIS whose Python lacks a package."""

import importlib.util
import shlex
import sys
import sysconfig
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

#: Import name of a package -> its name for pip, if they differ.
PIP_NAMES = {"cv2": "opencv-python-headless"}
#: Packages whose wheels contain a second GEOS that conflicts with that of QGIS -> their name in Debian and OSGeo4W.
SYSTEM_NAMES = {"shapely": "python3-shapely"}
#: Packages whose version must not change: GDAL's bindings and SciPy are compiled for this NumPy.
KEPT_NAMES = ("numpy",)
#: pip's names -> Debian's, if these are not "python3-" and pip's.
DEBIAN_NAMES = {"opencv-python-headless": "python3-opencv"}


def missing_package_message(error: ImportError) -> str | None:
    """Return which package is missing, and how to install it for the Python of QGIS.

    None if the failed import is one of HRSI's own modules: that is a fault of HRSI.
    """
    package = (error.name or "").partition(".")[0]
    if package in ("", __name__.partition(".")[0]):
        return None
    if package in SYSTEM_NAMES:
        return f"The Python package {package} cannot be loaded ({error}): {_system_advice(package)}"
    pip_name = PIP_NAMES.get(package, package)
    command = quote_command(install_command([pip_name]))
    return f"The Python package {pip_name} cannot be loaded ({error}): run  {command}  and restart QGIS"


def absence_note() -> str:
    """Return a note on packages that every algorithm needs and that are missing; empty if there are none."""
    notes = [f"It needs {name}, missing here: {_system_advice(name)}." for name in SYSTEM_NAMES if _is_missing(name)]
    return " ".join(notes)


def missing_fast_packages() -> list[str]:
    """Return pip's names of missing packages that make matching faster."""
    return [PIP_NAMES.get(name, name) for name in ("numba", "cv2") if _is_missing(name)]


def speed_note() -> str:
    """Return a note with the command that installs missing packages for faster matching; empty if there are none."""
    missing = missing_fast_packages()
    command = quote_command(install_command(missing))
    told = f"Matching is two to three times as fast with {' and '.join(missing)}: run  {command}  once."
    return told if missing else ""


def _is_missing(package: str) -> bool:
    return importlib.util.find_spec(package) is None


def _system_advice(package: str) -> str:
    """Return how to install a package of `SYSTEM_NAMES`."""
    return f"install {SYSTEM_NAMES[package]} where your QGIS comes from (apt, OSGeo4W), not with pip, and restart QGIS"


def can_install() -> bool:
    """Return whether pip is available, so that the user can install packages without further permissions."""
    return not _is_missing("pip")


def install_command(pip_names: Sequence[str]) -> list[str]:
    """Return the command that installs packages for the Python of QGIS: pip, or on a Debian without pip, apt."""
    # Debian's Python, which is QGIS's there, accepts pip packages only with an option
    is_managed = Path(sysconfig.get_path("stdlib"), "EXTERNALLY-MANAGED").exists() and sys.prefix == sys.base_prefix
    if is_managed and not can_install():
        return ["sudo", "apt-get", "install", *(DEBIAN_NAMES.get(name, f"python3-{name}") for name in pip_names)]
    managed = ["--user", "--break-system-packages"] if is_managed else []
    kept = [f"{name}=={metadata.version(name)}" for name in KEPT_NAMES if not _is_missing(name)]
    return [python_executable(), "-m", "pip", "install", *managed, *pip_names, *kept]


def quote_command(command: Sequence[str]) -> str:
    """Return a command as typed in a terminal."""
    if sys.platform == "win32":
        return " ".join(f'"{word}"' if " " in word else word for word in command)
    return shlex.join(command)


def python_executable() -> str:
    """Return the Python interpreter of this process: inside QGIS, ``sys.executable`` may be QGIS itself."""
    if "python" in Path(sys.executable or "").name.lower():
        return sys.executable
    candidates = (Path(sys.exec_prefix) / name for name in ("bin/python3", "python.exe", "python3.exe"))
    return str(next((path for path in candidates if path.exists()), "python3"))
