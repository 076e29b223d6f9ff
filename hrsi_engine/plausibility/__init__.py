"""Plausibility of the inputs: checks of a block before its adjustment, and the mistakes that explain a misfit."""

from .block_check import check_block

__all__ = ["check_block"]
