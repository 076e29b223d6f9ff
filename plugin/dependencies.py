"""What to tell a user of QGIS whose Python lacks a package."""

import importlib.util
import shlex
import sys
import sysconfig
from pathlib import Path

#: Import name of a package -> its name for pip, where they differ.
PIP_NAMES = {"cv2": "opencv-python-headless"}
#: Packages whose wheels bring a second GEOS that collides with that of QGIS -> their name at Debian and OSGeo4W.
SYSTEM_NAMES = {"shapely": "python3-shapely"}
_CONSTRAINTS = Path(__file__).resolve().parent.parent / "constraints.txt"


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
    return f"The Python package {pip_name} cannot be loaded ({error}): run  {pip_command(pip_name)}  and restart QGIS"


def absence_note() -> str:
    """Return what to tell before anything is run about packages that every algorithm needs; empty if all are there."""
    notes = [f"It needs {name}, missing here: {_system_advice(name)}." for name in SYSTEM_NAMES if _is_missing(name)]
    return " ".join(notes)


def speed_note() -> str:
    """Return the command that installs the missing packages that make matching faster; empty without such."""
    missing = [PIP_NAMES.get(name, name) for name in ("numba", "cv2") if _is_missing(name)]
    told = f"Matching is about three times as fast with {' and '.join(missing)}: run  {pip_command(*missing)}  once."
    return told if missing else ""


def _is_missing(package: str) -> bool:
    return importlib.util.find_spec(package) is None


def _system_advice(package: str) -> str:
    """Say how to install a package of `SYSTEM_NAMES`."""
    return f"install {SYSTEM_NAMES[package]} where your QGIS comes from (apt, OSGeo4W), not with pip, and restart QGIS"


def pip_command(*pip_names: str) -> str:
    """Return the command that installs packages for a user, with HRSI's tested versions where the file is at hand."""
    constraints = ["-c", str(_CONSTRAINTS)] if _CONSTRAINTS.exists() else []
    # Debian's Python, which is QGIS's there, takes packages beside its own only when told so
    is_managed = Path(sysconfig.get_path("stdlib"), "EXTERNALLY-MANAGED").exists() and sys.prefix == sys.base_prefix
    managed = ["--user", "--break-system-packages"] if is_managed else []
    return shlex.join([python_executable(), "-m", "pip", "install", *managed, *constraints, *pip_names])


def python_executable() -> str:
    """Return the Python interpreter beside this process: inside QGIS, ``sys.executable`` may be QGIS itself."""
    if "python" in Path(sys.executable or "").name.lower():
        return sys.executable
    candidates = (Path(sys.exec_prefix) / name for name in ("bin/python3", "python.exe", "python3.exe"))
    return str(next((path for path in candidates if path.exists()), "python3"))
