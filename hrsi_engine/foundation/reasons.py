"""What a careful operator would have to look into: a reason has a stable code, a level, and says what to do.

Checks before an adjustment and after it return reasons; `results.verdict` makes one verdict of them. A code is a word
that scripts may rely on, and a section of the documentation.
"""

from dataclasses import dataclass
from enum import IntEnum


class Level(IntEnum):
    """Severity of a reason; the verdict has the worst level of its reasons."""

    OK = 0
    DOUBTFUL = 1  #: written, but look first
    UNUSABLE = 2  #: no refined RPC is written unless the user forces it

    @property
    def label(self) -> str:
        """The word of reports: ``ok``, ``doubtful``, ``unusable``."""
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
        The ids concerned, all of them; who prints them shortens the list.
    """

    code: str
    level: Level
    message: str
    advice: str
    images: tuple[str, ...] = ()
    points: tuple[str, ...] = ()
