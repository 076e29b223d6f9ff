"""The texts for users keep to the vocabulary of docs/glossary.md; scripts/check_words.py finds what does not."""

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "scripts"))
import check_words  # noqa: E402

WORDS = check_words.read_vocabulary((ROOT / check_words.GLOSSARY).read_text(encoding="utf-8")) | check_words.SPELLINGS
PATTERN = check_words.make_pattern(WORDS)


def faults_of_page(page: str) -> list[str]:
    """Return the faults of a page."""
    return [
        fault
        for text in check_words.texts_of_page("page.md", page)
        for fault in check_words.find_faults(text, WORDS, PATTERN)
    ]


def faults_of_code(source: str) -> list[str]:
    """Return the faults of a module."""
    return [
        fault
        for text in check_words.texts_of_code("a.py", source)
        for fault in check_words.find_faults(text, WORDS, PATTERN)
    ]


@pytest.mark.parametrize(
    ("page", "fault"),
    [
        ("The GCPs tell where the block is.", "'tell'"),
        ("* One item is 3 px off.", "'px off'"),
        ("# What holds the block", "'holds'"),
        ("| a cell | believed to be right |", "'believed'"),
        ("It takes some 15 s.", "'some 15'"),
        ("The color of the arrows is red.", "'color'"),
        ("Independent measurements of a few hundredths of a pixel.", "no verb"),
        (" ".join(["word"] * 30) + " is.", "31 words"),
        ("```{glossary}\nterm\n  What nobody uses.\n```", "'nobody'"),
    ],
)
def test_bad_sentence_of_a_page_is_found(page: str, fault: str) -> None:
    assert any(fault in found for found in faults_of_page(page)), faults_of_page(page)


def test_good_page_has_no_fault() -> None:
    page = (
        "# Tie points\n\nThe adjustment uses 30 GCPs and `tells`; see [the page](tells.md).\n\n"
        "```\nhrsi tells\n```\n\n$$\nholds\n$$\n\nHeld-out tie points are not used.\n"
    )
    assert faults_of_page(page) == []


def test_strings_of_code_are_read_and_docstrings_are_not() -> None:
    source = (
        'def f(x):\n    """It tells what holds."""\n    raise ValueError(f"{x} tells nothing of it: name another")\n'
    )
    assert [fault.split(":")[1] for fault in faults_of_code(source)] == ["3"]


def test_sentence_of_a_message_ends_at_its_colon() -> None:
    message = " ".join(["word"] * 20) + ": " + " ".join(["word"] * 20)
    assert faults_of_code(f"x = {message!r}") == []
    assert len(faults_of_code(f"x = {message.replace(':', '')!r}")) == 1


def test_words_of_docstrings_and_comments_are_checked() -> None:
    """Not the names of parameters, nor comments for tools; sentences may be long, and without a verb."""
    source = '''def f(ties):
    """What the points tell.

    ties : (n,) the tie points
    """
    x = 1  # it stands here
    return x  # noqa: sound
'''
    faults = [
        fault
        for text in check_words.notes_of_code("a.py", source)
        for fault in check_words.find_faults(text, WORDS, PATTERN)
    ]
    assert [fault.split(": ")[:2] for fault in faults] == [["a.py:2", "'tell'"], ["a.py:6", "'stands'"]]
