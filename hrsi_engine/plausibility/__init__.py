"""Could the inputs be what they claim? Checks of a block before its adjustment, and the slips that explain a misfit."""

from .block_check import check_block

__all__ = ["check_block"]
