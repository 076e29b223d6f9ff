"""Measurement in images: image matching, gravity centres, targets, tie points and control from a reference."""

from ..foundation.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "tie_options": "TieOptions",
        "tie_points": "TiePoints find_tie_points",
        "targets.options": "TargetOptions",
        "targets.measuring": "TargetMeasurement measure_edges measure_target",
        "reference.options": "ReferenceOptions",
        "reference.matching": "ReferenceControl match_reference",
    },
)
