"""Packages that the Python of a QGIS lacks: messages, and the command that installs them into the user's profile."""

import importlib.util
import os
import shlex
import sys
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

from ..hrsi_engine.foundation.errors import MissingPackageError
from ..hrsi_engine.foundation.packages import PIXEL_PACKAGES

#: Packages whose wheels contain a second GEOS that conflicts with that of QGIS -> their name in Debian and OSGeo4W.
SYSTEM_NAMES = {"shapely": "python3-shapely"}
#: Packages whose version must not change: GDAL's bindings and SciPy are compiled for this NumPy.
KEPT_NAMES = ("numpy",)
#: pip's names -> Debian's, if these are not "python3-" and pip's.
DEBIAN_NAMES = {"opencv-python-headless": "python3-opencv"}
MENU_ENTRY = "Packages for matching"


def missing_package_message(error: ImportError | MissingPackageError) -> str | None:
    """Return which package is missing, and how to install it for the Python of QGIS.

    None if the failed import is one of HRSI's own modules: that is a fault of HRSI.
    """
    if isinstance(error, MissingPackageError):
        return (
            f"Matching and measuring in images need {error.package}, which this QGIS lacks: choose Plugins, HRSI, "
            f"{MENU_ENTRY}"
        )
    package = (error.name or "").partition(".")[0]
    if package in ("", __name__.partition(".")[0]):
        return None
    if package in SYSTEM_NAMES:
        return f"The Python package {package} cannot be loaded ({error}): {_system_advice(package)}"
    name = PIXEL_PACKAGES.get(package, package)
    command = quote_command([python_executable(), "-m", "pip", "install", name])
    return f"The Python package {name} cannot be loaded ({error}): run  {command}  and restart QGIS"


def absence_note() -> str:
    """Return a note on packages that every algorithm needs and that are missing; empty if there are none."""
    notes = [f"It needs {name}, missing here: {_system_advice(name)}." for name in SYSTEM_NAMES if _is_missing(name)]
    return " ".join(notes)


def list_missing_packages() -> list[str]:
    """Return pip's names of the packages that matching needs and that are missing."""
    return [name for module, name in PIXEL_PACKAGES.items() if _is_missing(module)]


def _is_missing(package: str) -> bool:
    return importlib.util.find_spec(package) is None


def _system_advice(package: str) -> str:
    """Return how to install a package of `SYSTEM_NAMES`."""
    return f"install {SYSTEM_NAMES[package]} where your QGIS comes from (apt, OSGeo4W), not with pip, and restart QGIS"


def package_folder(profile: str) -> Path:
    """Return the folder of packages in a profile of QGIS, for this version of Python."""
    return Path(profile, "python", "hrsi_packages", "{}.{}".format(*sys.version_info[:2]))


def use_packages(folder: Path) -> None:
    """Let Python find the packages of a folder; packages of QGIS, such as NumPy, have precedence."""
    if folder.exists() and str(folder) not in sys.path:
        sys.path.append(str(folder))
    importlib.invalidate_caches()


def can_install() -> bool:
    """Return whether pip is available, so that the user can install packages without further permissions."""
    return not _is_missing("pip")


def install_command(pip_names: Sequence[str], folder: Path) -> list[str]:
    """Return the command that installs packages into a folder for the Python of QGIS; without pip, that of Debian."""
    if not can_install():
        return ["sudo", "apt-get", "install", *(DEBIAN_NAMES.get(name, f"python3-{name}") for name in pip_names)]
    kept = [f"{name}=={metadata.version(name)}" for name in KEPT_NAMES if not _is_missing(name)]
    return [python_executable(), "-m", "pip", "install", "--upgrade", "--target", str(folder), *pip_names, *kept]


def quote_command(command: Sequence[str]) -> str:
    """Return a command as typed in a terminal."""
    quoted = " ".join(f'"{word}"' if " " in word else word for word in command)
    return quoted if sys.platform == "win32" else shlex.join(command)


def python_executable() -> str:
    """Return the Python interpreter of this process.

    Inside QGIS, ``sys.executable`` is QGIS, or the first ``python3`` on PATH, which may be another Python. The loaded
    standard library is that of the right one: its interpreter is in the same prefix.
    """
    if sys.prefix != sys.base_prefix:  # a virtual environment
        return sys.executable
    library = Path(os.__file__).resolve().parent
    names = (f"python{'.'.join(map(str, sys.version_info[:2]))}", "python3", "python.exe", "python3.exe")
    folders = (library.parent.parent / "bin", library.parent)
    found = (folder / name for folder in folders for name in names if (folder / name).exists())
    return str(next(found, sys.executable))
