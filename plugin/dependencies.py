"""What to tell a user of QGIS whose Python lacks a package."""

import importlib.util
import shlex
import sys
import sysconfig
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

#: Import name of a package -> its name for pip, where they differ.
PIP_NAMES = {"cv2": "opencv-python-headless"}
#: Packages whose wheels bring a second GEOS that collides with that of QGIS -> their name at Debian and OSGeo4W.
SYSTEM_NAMES = {"shapely": "python3-shapely"}
#: What stays as QGIS has it whatever is installed beside: GDAL's bindings and SciPy are compiled for this NumPy.
KEPT_NAMES = ("numpy",)
#: pip's names -> Debian's, where these are not "python3-" and pip's.
DEBIAN_NAMES = {"opencv-python-headless": "python3-opencv"}


def missing_package_message(error: ImportError) -> str | None:
    """Say which package is missing and how to install it for the Python that QGIS runs.

    None where the import that failed is HRSI's own: that is a fault of HRSI, which installing cannot mend.
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
    """Return what to tell before anything is run about packages that every algorithm needs; empty if all are there."""
    notes = [f"It needs {name}, missing here: {_system_advice(name)}." for name in SYSTEM_NAMES if _is_missing(name)]
    return " ".join(notes)


def missing_fast_packages() -> list[str]:
    """Return pip's names of the packages that make matching faster and are missing."""
    return [PIP_NAMES.get(name, name) for name in ("numba", "cv2") if _is_missing(name)]


def speed_note() -> str:
    """Return the command that installs the missing packages that make matching faster; empty without such."""
    missing = missing_fast_packages()
    command = quote_command(install_command(missing))
    told = f"Matching is two to three times as fast with {' and '.join(missing)}: run  {command}  once."
    return told if missing else ""


def _is_missing(package: str) -> bool:
    return importlib.util.find_spec(package) is None


def _system_advice(package: str) -> str:
    """Say how to install a package of `SYSTEM_NAMES`."""
    return f"install {SYSTEM_NAMES[package]} where your QGIS comes from (apt, OSGeo4W), not with pip, and restart QGIS"


def can_install() -> bool:
    """Tell whether pip is there, so that no other rights than the user's are needed."""
    return not _is_missing("pip")


def install_command(pip_names: Sequence[str]) -> list[str]:
    """Return the command that installs packages for the Python of QGIS: by pip, or where a Debian has none by apt."""
    # Debian's Python, which is QGIS's there, takes packages beside its own only when told so
    is_managed = Path(sysconfig.get_path("stdlib"), "EXTERNALLY-MANAGED").exists() and sys.prefix == sys.base_prefix
    if is_managed and not can_install():
        return ["sudo", "apt-get", "install", *(DEBIAN_NAMES.get(name, f"python3-{name}") for name in pip_names)]
    managed = ["--user", "--break-system-packages"] if is_managed else []
    kept = [f"{name}=={metadata.version(name)}" for name in KEPT_NAMES if not _is_missing(name)]
    return [python_executable(), "-m", "pip", "install", *managed, *pip_names, *kept]


def quote_command(command: Sequence[str]) -> str:
    """Return a command as it is typed in a terminal."""
    if sys.platform == "win32":
        return " ".join(f'"{word}"' if " " in word else word for word in command)
    return shlex.join(command)


def python_executable() -> str:
    """Return the Python interpreter beside this process: inside QGIS, ``sys.executable`` may be QGIS itself."""
    if "python" in Path(sys.executable or "").name.lower():
        return sys.executable
    candidates = (Path(sys.exec_prefix) / name for name in ("bin/python3", "python.exe", "python3.exe"))
    return str(next((path for path in candidates if path.exists()), "python3"))
