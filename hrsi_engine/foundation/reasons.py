"""Reasons of the verdict: findings to be checked by the operator, each with a stable code, a level and advice.

The checks before and after an adjustment return reasons; `results.verdict` combines them to one verdict. A code is a
word that scripts can rely on, and the title of a section of the documentation.
"""

from dataclasses import dataclass
from enum import IntEnum


class Level(IntEnum):
    """Severity of a reason; the verdict has the worst level of its reasons."""

    OK = 0
    DOUBTFUL = 1  #: results are written, but should be checked first
    UNUSABLE = 2  #: no refined RPC is written unless the user forces it

    @property
    def label(self) -> str:
        """The level in reports: ``ok``, ``doubtful``, ``unusable``."""
        return self.name.lower()


@dataclass(frozen=True)
class Reason:
    """One finding about a block.

    Parameters
    ----------
    code : str
        A stable word in lower case with hyphens, ``height-datum``.
    level : Level
        `Level.DOUBTFUL` or `Level.UNUSABLE`.
    message : str
        One sentence with the figures: what is wrong, and where.
    advice : str
        One sentence: what to do.
    images, points : tuple of str
        All ids concerned; the printing function shortens the list.
    """

    code: str
    level: Level
    message: str
    advice: str
    images: tuple[str, ...] = ()
    points: tuple[str, ...] = ()
