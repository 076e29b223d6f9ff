"""Results of an adjustment: residuals, statistics, figures of the report, tables, layers; each rule in one place."""

from ..foundation.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, {"residuals": "Residuals", "verdict": "Evidence Verdict"})
