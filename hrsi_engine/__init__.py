"""HRSI's engine: block triangulation of satellite images with RPC cameras, on arrays and objects.

The names below are the public interface; each is imported when it is first used, so that command line and plugin
start without the numerics.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_WHERE = {
    "RPC": ".camera.rpc",
    "Adjustment": ".adjustment",
    "AdjustOptions": ".adjustment",
    "adjust": ".adjustment",
    "Block": ".block.block",
    "GroundPoints": ".block.block",
    "Image": ".block.block",
    "ImagePoints": ".block.block",
    "Role": ".block.block",
    "assemble": ".block.block",
    "HrsiError": ".foundation.errors",
    "MODELS": ".refinement",
    "Control": ".refinement.estimate",
    "choose_model": ".refinement.selection",
    "compare_models": ".refinement.refine",
    "refine_rpc": ".refinement.refine",
    "TieOptions": ".measurement.tie_points",
    "find_tie_points": ".measurement.tie_points",
    "fit_rpc": ".camera.rpc_fit",
    "open_image": ".io.rasters",
    "read_rpc": ".io.rpc_files",
    "residuals": ".results.residuals",
}

__all__ = sorted(_WHERE)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_WHERE[name], __name__), name)


def __dir__() -> list[str]:
    return __all__
