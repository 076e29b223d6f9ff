"""Time the RPC evaluation of rpcm and shareloc; run by ``speed.py`` in an environment that has them.

    python rpc_seconds.py IMAGE POINTS.npz

Prints one JSON object: per package and direction seconds for all points and the largest difference from the
reference (px, or metres on the ground). A package that is not there or fails is named with the reason.
"""

from __future__ import annotations

import json
import sys
import time
import types
from collections.abc import Callable

import numpy as np


def seconds_of(function: Callable[[], object], rounds: int = 2) -> tuple[float, object]:
    """Return the best time of some rounds (the first one compiles, where there is a compiler) and the result."""
    best, result = np.inf, None
    for _ in range(rounds):
        start = time.perf_counter()
        result = function()
        best = min(best, time.perf_counter() - start)
    return best, result


def rpcm_figures(path: str, image: np.ndarray, ground: np.ndarray) -> dict[str, float]:
    """Return rpcm's seconds; its localization stops at its own tolerance."""
    # rpcm imports srtm4 for SRTM heights, which are not wanted here and need a C compiler to install
    sys.modules.setdefault("srtm4", types.ModuleType("srtm4"))
    from rpcm.rpc_model import rpc_from_geotiff

    rpc = rpc_from_geotiff(path)
    forward, (col, row) = seconds_of(lambda: rpc.projection(*ground.T))
    there = np.column_stack([col, row])
    own = image + own_origin(there, image)
    inverse, (lon, lat) = seconds_of(lambda: rpc.localization(*own.T, ground[:, 2]))
    return figures(forward, inverse, there - own, np.column_stack([lon, lat]) - ground[:, :2], ground)


def shareloc_figures(path: str, image: np.ndarray, ground: np.ndarray) -> dict[str, float]:
    """Return shareloc's seconds (Numba, parallel)."""
    from shareloc.geomodels import GeoModel

    model = GeoModel(path, "RPC")
    forward, (row, col, _) = seconds_of(lambda: model.inverse_loc(*ground.T))
    there = np.column_stack([col, row])
    own = image + own_origin(there, image)
    inverse, found = seconds_of(
        lambda: model.direct_loc_inverse_iterative(own[:, 1], own[:, 0], ground[:, 2], 10, False)
    )
    return figures(forward, inverse, there - own, np.column_stack(found[:2]) - ground[:, :2], ground)


def own_origin(there: np.ndarray, image: np.ndarray) -> np.ndarray:
    """Return what a package adds to image coordinates: a constant half or whole pixel, by its convention."""
    return np.round(2.0 * np.median(there - image, axis=0)) / 2.0


def figures(
    forward: float, inverse: float, pixels: np.ndarray, degrees: np.ndarray, ground: np.ndarray
) -> dict[str, float]:
    """Return seconds and the largest differences."""
    metres = 111320.0 * degrees * np.column_stack([np.cos(np.radians(ground[:, 1])), np.ones(len(ground))])
    return {
        "project_s": forward,
        "localize_s": inverse,
        "project_px": float(np.abs(pixels).max()),
        "localize_m": float(np.abs(metres).max()),
    }


PACKAGES = {"rpcm": rpcm_figures, "shareloc": shareloc_figures}


def main() -> None:
    """Time every package that is there."""
    points = np.load(sys.argv[2])
    results: dict[str, object] = {}
    for name, measure in PACKAGES.items():
        try:
            results[name] = measure(sys.argv[1], points["image"], points["ground"])
        except Exception as error:  # any fault of a rival is a line in the table, no reason to stop
            results[name] = f"{type(error).__name__}: {error}"
    print(json.dumps(results))


if __name__ == "__main__":
    main()
