"""The laboratory: simulated blocks and the studies of the thesis; nothing else in the engine imports it."""

from ..foundation.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "registration": "MethodComparison compare_kinds",
        "interest_points": "DetectionOptions InterestPoints detect_interest_points",
        "control_network": "ControlNetworkMatch ControlNetworkOptions match_windows",
    },
)
