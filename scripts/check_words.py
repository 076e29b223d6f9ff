"""Check the texts that users read: words, length of sentences, verbs, spelling.

``python scripts/check_words.py [FILE …]`` prints one line for each fault and ends with 1 if there is one. Without a
file it reads all texts of the repository: the pages in Markdown, the templates of reports, and the strings of the code
(help texts, messages, reasons, labels). ``make lint`` runs it. Of docstrings and comments only the words are checked.

The vocabulary is the table *Words not to use* of docs/glossary.md. A sentence has 30 words at most and, in a paragraph
of a page, a verb. Messages of the code have the form "what happened: what to do"; there a colon or semicolon ends a
sentence.
"""

import ast
import io
import re
import subprocess
import sys
import tokenize
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
GLOSSARY = "docs/glossary.md"
VOCABULARY_TITLE = "## Words not to use"
#: Generated pages are checked in the code.
NOT_READ = {"docs/developing/thresholds.md", "docs/developing/structure.md", "docs/layers.md"}
MOST_WORDS = 30
#: Sentences of fewer words are labels.
LEAST_WORDS_WITH_VERB = 5
#: Spellings of the United States, and other second spellings, with the one that is used.
SPELLINGS = {
    "analyze": "analyse", "behavior": "behaviour", "center": "centre", "centers": "centres", "centered": "centred",
    "color": "colour", "colors": "colours", "gray": "grey", "meter": "metre", "meters": "metres",
    "kilometer": "kilometre", "kilometers": "kilometres", "neighbor": "neighbour", "neighbors": "neighbours",
    "neighboring": "neighbouring", "license": "licence", "optimize": "optimise", "optimized": "optimised",
    "normalize": "normalise", "normalized": "normalised", "ortho-image": "orthoimage", "ortho-images": "orthoimages",
    "tiepoint": "tie point", "tiepoints": "tie points", "tie-point": "tie point", "data set": "dataset",
    "data sets": "datasets", "no-data": "nodata", "subpixel": "sub-pixel", "meta data": "metadata",
    "checkpoint": "check point", "checkpoints": "check points",
}  # fmt: skip
#: Verbs of the texts, without their endings.
VERBS = (
    "accept add adjust affect agree aim allow alternate answer appear append apply ask assume avoid bear become begin "
    "belong bring build call carry cause change check choose click clip close come compare complete compute "
    "conclude confirm connect consider consist constrain contain continue control convert copy correct correspond "
    "cost count cover create cross cut decide declare decrease define delete deliver depend derive describe detect "
    "determine deviate differ disagree discard display distinguish divide do draw drop edit end enter estimate "
    "evaluate exceed exchange exclude exist expect explain extend fail fall feed fill find finish fit fix follow "
    "forget form function gain get give go grow hand handle happen have help hide ignore import improve include "
    "increase indicate install interpolate intersect invert join keep know lack lead learn leave lie limit link "
    "list load localise look lose make mark match matter mean measure meet merge miss move name need note notice "
    "number observe obtain occur offer omit open order overlap owe pass perform place plan plot point predict "
    "prefer prepare press prevent print produce project propagate protect provide put quote raise reach read "
    "receive recommend reduce refer refine refuse register reject relate remain remove rename reorder repair "
    "repeat replace report represent reproject require resample restore restrict result return reveal rise run "
    "save scale search see select send separate serve set shift show shrink simplify simulate solve sort specify "
    "speed spread standardise start state stay stop store suffice suggest supply support survive suspect take "
    "test tie tilt transform treat triangulate trust try turn update use validate vary verify wait want warn "
    "weigh weight widen work write "
)
IRREGULAR = (
    "am are be been began begun being brought built came can cannot chose chosen could cut did does done drawn drew "
    "fallen fell felt found gave given gone got grew grown had has is kept knew known laid lay left lent lost made "
    "may meant met might must paid put ran read rose said saw seen sent set shall should shown spent spread stood "
    "taken took understood was went were will would written wrote "
)
ENDINGS = ("", "s", "es", "d", "ed", "ing")


class Text(NamedTuple):
    """A piece of prose: place, text, and whether it is a message of the code, or a label (cell, heading, item).

    Of a note (docstring or comment of the code) only the words are checked.
    """

    place: str
    text: str
    is_message: bool
    is_label: bool
    is_item: bool = False
    is_note: bool = False


def list_verb_forms() -> set[str]:
    """Return the finite and infinite forms of the verbs."""
    forms = set(IRREGULAR.split())
    for verb in VERBS.split():
        stems = {verb, verb.rstrip("e"), verb + verb[-1]}
        forms |= {stem + ending for stem in stems for ending in ENDINGS}
        if verb.endswith("y"):
            forms |= {verb[:-1] + "ies", verb[:-1] + "ied"}
    return forms


VERB_FORMS = list_verb_forms()


def read_vocabulary(page: str) -> dict[str, str]:
    """Return the words not to use of the glossary's table, each with what to write instead."""
    words: dict[str, str] = {}
    for line in page.partition(VOCABULARY_TITLE)[2].split("\n## ")[0].splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if len(cells) == 2 and not cells[0].startswith(("---", "not")):
            words |= {word.strip(): cells[1] for word in cells[0].split(",")}
    if not words:
        raise SystemExit(f"{GLOSSARY}: the table '{VOCABULARY_TITLE}' is missing or empty: restore it")
    return words


def make_pattern(words: dict[str, str]) -> re.Pattern[str]:
    """Return the pattern that finds the words; # stands for a number."""
    spelt = (re.escape(word).replace(r"\#", r"\d[\d.]*").replace(r"\ ", r"\s+") for word in words)
    return re.compile(rf"(?<![\w`-])(?:{'|'.join(sorted(spelt, key=len, reverse=True))})(?![\w-])", re.IGNORECASE)


def plain(text: str) -> str:
    """Return a text without code, formulas, addresses and marks."""
    text = re.sub(r"^\*\*[^*]+\.\*\*", "", text)  # a heading within its paragraph
    text = re.sub(r"``.*?``|`[^`]*`", "CODE", text, flags=re.DOTALL)
    text = re.sub(r"\$[^$]*\$", "FORMULA", text)
    text = re.sub(r"!\[[^\]]*\]\([^)]*\)|<https?:[^>]*>|https?://\S+", "", text)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    return re.sub(r"(\*\*|\*|(?<!\w)_|_(?!\w))", "", text)


def split_sentences(text: Text) -> list[str]:
    """Return the sentences of a text; in messages a colon or semicolon ends one too."""
    ends = r"(?<=[.!?:;])\s+" if text.is_message or text.is_label else r"(?<=[.!?])[)\"']?\s+(?=[A-Z0-9\"'(])"
    return [sentence for sentence in re.split(ends, plain(text.text)) if sentence.strip()]


def find_faults(text: Text, words: dict[str, str], pattern: re.Pattern[str]) -> Iterator[str]:
    """Yield the faults of a text, with the place."""
    if text.is_note and not pattern.search(text.text):  # most are without fault
        return
    flat = plain(text.text)
    for found in pattern.finditer(flat):
        if found[0].lower() in SPELLINGS and not found[0].islower():  # a name: Cloud Optimized GeoTIFF, a class
            continue
        key = re.sub(r"\s+", " ", re.sub(r"\d[\d.]*", "#", found[0])).lower()
        yield f"{text.place}: '{found[0]}': {words.get(key, '')}".rstrip(": ")
    for sentence in [] if text.is_note else split_sentences(text):
        tokens = re.findall(r"[^\W\d_][\w'-]*", sentence)
        if len(tokens) > MOST_WORDS:
            yield f"{text.place}: {len(tokens)} words: {' '.join(sentence.split())[:60]}…: make it shorter"
        prose = not (text.is_message or text.is_label or text.is_item) and sentence.rstrip().endswith(".")
        if prose and len(tokens) >= LEAST_WORDS_WITH_VERB and not VERB_FORMS & {token.lower() for token in tokens}:
            yield f"{text.place}: no verb: {' '.join(sentence.split())[:60]}: add one, or to VERBS of this script"


def texts_of_page(place: str, page: str) -> Iterator[Text]:
    """Yield the paragraphs, list items, cells, headings and definitions of a page; not its code and formulas."""
    page = re.sub(r"<!--.*?-->", lambda comment: "\n" * comment[0].count("\n"), page, flags=re.DOTALL)
    lines: list[str] = []  # of the paragraph that is being read
    start, fence, is_vocabulary, is_glossary, is_item = 0, "", False, False, False
    for number, line in enumerate([*page.splitlines(), ""], 1):
        bare = line.strip()
        if fence:
            fence = "" if bare.endswith(fence) else fence
            continue
        opens = bare.startswith(("```", "$$")) and not is_glossary and bare != "```{glossary}"
        is_glossary = bare == "```{glossary}" or (is_glossary and bare != "```")
        begins_item = re.match(r"([*+-]|\d+\.|>)\s", bare)
        if lines and (not bare or bare.startswith(("```", "$$", "|", "#")) or begins_item):
            yield Text(f"{place}:{start}", "\n".join(lines), False, is_glossary, is_item)
            lines, is_item = [], False
        if bare.startswith(("|", "#")):
            is_vocabulary = bare == VOCABULARY_TITLE if bare.startswith("#") else is_vocabulary
            cells = bare.strip("|").split("|") if bare.startswith("|") else [bare.lstrip("#")]
            yield from (Text(f"{place}:{number}", cell, False, True) for cell in cells if not is_vocabulary)
        elif opens:
            fence = (
                ""
                if bare.startswith("$$") and bare.endswith("$$") and len(bare) > 2
                else bare[:3]
                if bare[0] == "`"
                else "$$"
            )
        elif bare and not bare.startswith("```"):
            start, is_item = (start, is_item) if lines else (number, bool(begins_item))
            lines.append(re.sub(r"^([*+-]|\d+\.|>)\s+", "", bare))


#: Strings that are no prose: SQL, markup, styles, PROJ pipelines, patterns, commands.
NO_PROSE = re.compile(
    r"\s*(SELECT|INSERT|CREATE|DELETE|UPDATE|PRAGMA|ALTER|DROP)\b|.*(</|/>|<\?xml|\+proj|\(\?|\{ [a-z-]+:|--\w+ )"
    r"|\s*(hrsi|mm3d|python|echo) ", re.DOTALL,
)  # fmt: skip


@lru_cache(maxsize=1)
def list_nodes(source: str) -> list[ast.AST]:
    """Return all nodes of a module; both readers of its texts go through them."""
    return list(ast.walk(ast.parse(source)))


def texts_of_code(place: str, source: str) -> Iterator[Text]:
    """Yield the strings of a module that are prose; docstrings are not among them."""
    nodes = list_nodes(source)
    skipped: set[int] = set()
    for node in nodes:
        body = getattr(node, "body", None)
        if isinstance(body, list) and body and isinstance(body[0], ast.Expr):
            skipped.add(id(body[0].value))
        if isinstance(node, ast.JoinedStr):
            skipped |= {id(part) for part in ast.walk(node) if part is not node}
    for node in nodes:
        if id(node) in skipped or not isinstance(node, ast.Constant | ast.JoinedStr):
            continue
        text = ""
        if isinstance(node, ast.JoinedStr):
            text = "".join(str(part.value) if isinstance(part, ast.Constant) else "1" for part in node.values)
        elif isinstance(node.value, str):
            text = node.value
        if len(re.findall(r"[A-Za-z]{2,}", text)) >= 3 and " " in text.strip() and not NO_PROSE.match(text):
            yield Text(f"{place}:{node.lineno}", text, True, False)


def notes_of_code(place: str, source: str) -> Iterator[Text]:
    """Yield the docstrings and comments of a module; comments for tools (noqa, fmt) are not among them."""
    for node in list_nodes(source):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and (text := ast.get_docstring(node)):
            text = re.sub(r"(?m)(^\s*|; )[\w*, ]+ : |\bhold(s|ing)?\s+out\b", r"\1", text)  # parameters, and a term
            yield Text(f"{place}:{node.body[0].lineno}", text, False, False, is_note=True)
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT and not re.match(r"#:?\s*(noqa|fmt|type|pragma)\b", token.string):
            yield Text(f"{place}:{token.start[0]}", token.string.lstrip("#: "), False, False, is_note=True)


def texts_of_template(place: str, page: str) -> Iterator[Text]:
    """Yield the lines of a template of a page (Jinja), without its marks, styles and scripts."""
    marks = r"<style.*?</style>|<script.*?</script>|\{#.*?#\}|\{%.*?%\}|\{\{.*?\}\}"
    page = re.sub(marks, lambda found: "\n" * found[0].count("\n"), page, flags=re.DOTALL)
    for number, line in enumerate(page.splitlines(), 1):
        yield from (Text(f"{place}:{number}", text, True, False) for text in re.split(r"<[^>]*>", line) if text.strip())


def list_files() -> list[str]:
    """Return the files with texts for users: the pages, and the code of the product."""
    kinds = ("*.md", "hrsi_engine/*.py", "hrsi_engine/*.html.j2", "processing_algorithms/*.py", "plugin/*.py")
    found = subprocess.run(["git", "ls-files", *kinds], cwd=ROOT, capture_output=True, text=True, check=True)
    return [name for name in found.stdout.split() if name not in NOT_READ and (ROOT / name).exists()]


def check_file(name: str, words: dict[str, str], pattern: re.Pattern[str]) -> list[str]:
    """Return the faults of a file."""
    content = (ROOT / name).read_text(encoding="utf-8")
    read = {".py": texts_of_code, ".md": texts_of_page, ".j2": texts_of_template}[Path(name).suffix]
    texts = [*read(name, content), *(notes_of_code(name, content) if name.endswith(".py") else ())]
    return [fault for text in texts for fault in find_faults(text, words, pattern)]


def main(arguments: list[str]) -> int:
    """Print the faults; the exit code says whether there are any."""
    words = read_vocabulary((ROOT / GLOSSARY).read_text(encoding="utf-8")) | SPELLINGS
    pattern = make_pattern(words)
    names = arguments or list_files()
    faults = [fault for name in names for fault in check_file(name, words, pattern)]
    for fault in faults:
        print(fault)
    print(f"words: {len(faults)} faults in {len(names)} files")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
