"""Ids that differ in spelling only. HRSI compares ids as text, exactly; similar ids are reported, never matched.

Spreadsheets drop leading zeros and add ``.0``, word processors turn hyphens into dashes, and people mix capitals,
blanks and underscores.
"""

import re
import unicodedata
from collections.abc import Iterable
from itertools import islice

_APART = "\x01"  # between ids while all are spelt in one go; it is no blank, and no sane id holds it
_AT_ONCE = 50_000  # ids in memory together: as texts they take a hundred times the memory of a table's
_DASHES = dict.fromkeys(map(ord, "‐‑‒–—―−⁃﹘﹣－"), "-")
_INVISIBLE = dict.fromkeys(map(ord, "\u00ad\u200b\u200c\u200d\u2060\ufeff"), None)
#: What spellings differ in, and what stands for it here; in this order.
_SPELLINGS = (
    (r"[\s_-]+", "-"),
    (rf"(?<![^{_APART}])-|-(?![^{_APART}])", ""),  # at the ends
    (r"(?<=[^\W\d])-(?=\d)", ""),  # GCP-7, GCP 7: GCP7
    (r"(?<=\d)\.0+(?![\d.])", ""),  # 7.0: 7
    (r"(?<![\d.])0+(?=\d)", ""),  # 007: 7
)


#: All that spellings differ in is made of these.
_SLIGHT = dict.fromkeys([*map(ord, "-_.0"), *(code for code in range(0x3001) if chr(code).isspace())])


def normalise_spellings(ids: Iterable[str]) -> list[str]:
    """Return a normalised spelling of each id, equal for similar ids."""
    listed = list(ids)
    text = _join_lower_case(listed)
    for pattern, plain in _SPELLINGS:
        text = re.sub(pattern, plain, text)
    return text.split(_APART) if listed else []


def _join_lower_case(ids: Iterable[str]) -> str:
    """Return ids joined to one text in lower case: a call for each of a million ids would take seconds."""
    text = _APART.join(str(name).replace(_APART, "") for name in ids)
    if not text.isascii():
        text = unicodedata.normalize("NFKC", text).translate(_DASHES | _INVISIBLE)
    return text.casefold()


def _strip_separators(ids: Iterable[str]) -> list[str]:
    """Return each id without separators, zeros and blanks: a pre-test, ten times as fast as normalised spellings."""
    return _join_lower_case(ids).translate(_SLIGHT).split(_APART)


def find_similar_ids(strangers: Iterable[str], known: Iterable[str]) -> dict[str, list[str]]:
    """Return the known ids that are similar to each of ``strangers``; without those that have none."""
    by_spelling: dict[str, list[str]] = {}
    waiting = map(str, strangers)
    names = list(islice(waiting, _AT_ONCE))
    known = list(map(str, known)) if names else []  # all ids of a large block may be known: nothing is spelt
    if not known:
        return {}
    for name, spelling in zip(known, normalise_spellings(known), strict=True):
        by_spelling.setdefault(spelling, []).append(name)
    found, bones = dict[str, list[str]](), set(_strip_separators(known))
    while names:
        names = [name for name, own in zip(names, _strip_separators(names), strict=True) if own in bones]
        spelt = zip(names, normalise_spellings(names), strict=True)
        found |= {name: by_spelling[spelling] for name, spelling in spelt if spelling in by_spelling}
        names = list(islice(waiting, _AT_ONCE))
    return found
