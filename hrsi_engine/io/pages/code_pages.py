"""What the documentation says of a verdict's codes, for reports: a page that travels alone brings its own explanations.

``docs/verdict.md`` is the one place where that is written; its headings ``### code`` are the codes. Of Markdown,
paragraphs, lists, code, bold words and the words of links are understood.
"""

import re
from collections.abc import Iterable
from functools import cache
from html import escape
from pathlib import Path

PAGE = Path(__file__).resolve().parents[3] / "docs" / "verdict.md"
_SECTION = re.compile(r"^### ([a-z0-9-]+)\n(.*?)(?=^#{1,3} |\Z)", re.MULTILINE | re.DOTALL)
_INLINE = (
    (re.compile(r"`([^`]+)`"), r"<code>\1</code>"),
    (re.compile(r"\*\*([^*]+)\*\*"), r"<b>\1</b>"),
    (re.compile(r"\[([^\]]+)\]\([^)]*\)"), r"\1"),
)


def explain_codes(codes: Iterable[str]) -> dict[str, str]:
    """Return the documentation of codes of reasons as HTML, by code in their order; empty where none is installed."""
    sections = _read_sections()
    return {code: sections[code] for code in dict.fromkeys(codes) if code in sections}


@cache
def _read_sections() -> dict[str, str]:
    try:
        text = PAGE.read_text(encoding="utf-8")
    except OSError:  # installed without documentation
        return {}
    return {code: _write_blocks(body) for code, body in _SECTION.findall(text)}


def _write_blocks(markdown: str) -> str:
    """Return paragraphs and lists as HTML."""
    parts = []
    for block in re.split(r"\n\s*\n", markdown.strip()):
        items = re.split(r"^[*-] ", block, flags=re.MULTILINE)
        if len(items) > 1 and not items[0].strip():
            parts.append("<ul>" + "".join(f"<li>{_write_inline(item)}</li>" for item in items[1:]) + "</ul>")
        else:
            parts.append(f"<p>{_write_inline(block)}</p>")
    return "".join(parts)


def _write_inline(text: str) -> str:
    text = escape(" ".join(text.split()), quote=False)
    for pattern, replacement in _INLINE:
        text = pattern.sub(replacement, text)
    return text
