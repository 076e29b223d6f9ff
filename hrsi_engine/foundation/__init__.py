"""Basis of all other packages: errors, progress, threads and workers, compiled loops, robust scale."""

from .lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "errors": "Cancelled HrsiError InputError MissingPackageError OutputError SolveError",
        "progress": "Progress",
        "reasons": "Level Reason",
        "version": "VERSION",
    },
)
