"""The texts for users keep to the vocabulary of docs/glossary.md; scripts/check_words.py finds what does not."""

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "scripts"))
import check_words  # noqa: E402

WORDS = check_words.read_vocabulary((ROOT / check_words.GLOSSARY).read_text(encoding="utf-8")) | check_words.SPELLINGS
PATTERN = check_words.make_pattern(WORDS)

MANY = " ".join(["word"] * 20)
GOOD = (
    "# Tie points\n\nThe adjustment uses 30 GCPs and `tells`; see [the page](tells.md).\n\n"
    "```\nhrsi tells\n```\n\n$$\nholds\n$$\n\nHeld-out tie points are not used.\n"
)
CODE = 'def f(x):\n    """It tells what holds."""\n    raise ValueError(f"{x} tells nothing of it: name another")\n'
#: Not the names of parameters, nor comments for tools; sentences may be long, and without a verb.
NOTES = '''def f(ties):
    """What the points tell.

    ties : (n,) the tie points
    """
    x = 1  # it stands here
    return x  # noqa: sound
'''


@pytest.mark.parametrize(
    ("read", "text", "faults"),
    [
        ("texts_of_page", "The GCPs tell where the block is.", ["1: 'tell'"]),
        ("texts_of_page", "* One item is 3 px off.", ["1: 'px off'"]),
        ("texts_of_page", "# What holds the block", ["1: 'holds'"]),
        ("texts_of_page", "| a cell | believed to be right |", ["1: 'believed'"]),
        ("texts_of_page", "It takes some 15 s.", ["1: 'some 15'"]),
        ("texts_of_page", "The color of the arrows is red.", ["1: 'color'"]),
        ("texts_of_page", "Independent measurements of a few hundredths of a pixel.", ["no verb"]),
        ("texts_of_page", " ".join(["word"] * 30) + " is.", ["31 words"]),
        ("texts_of_page", "```{glossary}\nterm\n  What nobody uses.\n```", ["'nobody'"]),
        ("texts_of_page", GOOD, []),
        ("texts_of_code", CODE, ["3: 'tells'"]),  # the docstring is not a text for users
        ("texts_of_code", f"x = '{MANY}: {MANY}'", []),  # a message's sentence ends at its colon
        ("texts_of_code", f"x = '{MANY} {MANY}'", ["40 words"]),
        ("notes_of_code", NOTES, ["2: 'tell'", "6: 'stands'"]),
    ],
)
def test_faults_of_texts_are_those_that_stand_there(read: str, text: str, faults: list[str]) -> None:
    found = [
        fault
        for part in getattr(check_words, read)("file", text)
        for fault in check_words.find_faults(part, WORDS, PATTERN)
    ]
    assert len(found) == len(faults) and all(map(str.__contains__, found, faults)), found
