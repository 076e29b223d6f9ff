"""Packages that only some work needs: imported at first use, with one clear error where they are missing."""

from functools import cache
from importlib import import_module
from typing import Any

from .errors import MissingPackageError

#: Import name -> pip's name, of packages that matching and measurements in pixels need.
PIXEL_PACKAGES = {"cv2": "opencv-python-headless", "numba": "numba"}


@cache
def require_package(module: str) -> Any:
    """Return an imported module of `PIXEL_PACKAGES`.

    Raises `MissingPackageError`: it cannot be imported.
    """
    try:
        return import_module(module)
    except ImportError as error:
        package = PIXEL_PACKAGES[module]
        raise MissingPackageError(
            f"matching and measurements in images need the Python package {package}, which cannot be loaded ({error}): "
            f"install it with `python -m pip install {package}`",
            package,
        ) from error
