"""The laboratory: simulated blocks and the studies of the thesis; nothing else in the engine imports it."""

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .registration import MethodComparison as MethodComparison
from .registration import compare_kinds as compare_kinds
