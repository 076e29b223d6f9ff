"""Plausibility of the inputs: checks of a block before its adjustment, and input errors that explain a misfit."""

from .block_check import check_block

__all__ = ["check_block"]
