"""HRSI's engine: block triangulation of satellite images with RPC cameras, on arrays and objects.

The names below are the public interface; each is imported when it is first used, so that command line and plugin
start without the numerics. Every room of the engine shows more in a face of its own, for those who look deeper.
"""

from .foundation.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "foundation": "HrsiError",
        "camera": "RPC fit_rpc",
        "block": "Block GroundPoints Image ImagePoints Role assemble",
        "adjustment": "AdjustOptions Adjustment adjust",
        "refinement": "MODELS",
        "refinement.estimate": "Control",
        "refinement.refine": "refine_rpc",
        "refinement.selection": "choose_model",
        "measurement": "TieOptions find_tie_points",
        "plausibility": "check_block",
        "results.residuals": "compute_residuals",
        "results.judged_block": "judge",
        "io": "open_image read_rpc",
    },
)
