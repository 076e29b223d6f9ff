"""What an adjustment is turned into: residuals, statistics, figures of the report, tables, layers; each rule once."""

from ..foundation.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, {
    "figures": "block_report control_and_check",
    "layers": "block_layers",
    "residuals": "Residuals",
    "verdict": "Evidence Verdict find_reasons",
})  # fmt: skip
