"""List functions and classes whose name is no verb with its object and no noun: participles, adverbs, single letters.

``python scripts/check_names.py [--locals] [FOLDER …]`` prints one line a name, then the share of all names; with no
folder it reads the whole product. ``make lint`` runs it: it fails where a public name is listed, or more than 1 % of
all names. The names inside functions are counted too: arguments and local variables that are function words or
participles (``told``, ``own``, ``here``) may be `MOST_FUNCTION_WORDS` of all; ``--locals`` lists them.

A call of a function or class of the product passes at most `MOST_POSITIONAL` arguments without their names: a reader
cannot count further. Compiled loops, which take arrays one after the other, are left out.

A name is a participle where its first or its last word is one (``_joined_rows``, ``points_seen``): a reader cannot tell
whether it does something, is something, or answers a question. ``is_…`` and ``has_…`` answer questions, ``find_…``,
``select_…``, ``compute_…`` do something. A property may be the noun or adjective that it is, and a class may have an
adjective before its noun.
"""

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
PARTS = ("hrsi_engine", "processing_algorithms", "plugin")
#: The largest share of private names that may be listed.
MOST_LISTED = 0.01
#: The largest share of arguments and local variables that are function words; it may only become smaller.
MOST_FUNCTION_WORDS = 0.03
#: The largest number of arguments without names in a call.
MOST_POSITIONAL = 6
#: Modules of compiled loops, and functions of BLAS: their arguments are arrays in the order of the formula.
LOOPS = re.compile(r"kernels|compiled_|dense_matrices")
#: Verbs that end as participles do, and participles that have become nouns or verbs of the field.
VERBS = {"need", "seed", "feed", "speed", "embed", "proceed", "exceed", "succeed", "shed", "weed"}  # fmt: skip
PARTICIPLES = {
    "built", "chosen", "done", "drawn", "driven", "fallen", "felt", "found", "given", "gone", "grown", "held", "hidden",
    "kept", "known", "laid", "left", "lent", "lost", "made", "meant", "met", "seen", "sent", "shown", "spelt", "spent",
    "spread", "sought", "stood", "sunk", "swept", "taken", "thrown", "told", "torn", "won", "worn", "written",
}  # fmt: skip
#: Names that Qt and QGIS call, and one that users catch.
INHERITED = {"finished", "Cancelled"}
#: Words that say nothing alone.
EMPTY = {
    "about", "after", "again", "all", "alone", "also", "and", "any", "apart", "around", "as", "aside", "at", "away",
    "back", "before", "below", "beside", "both", "by", "down", "each", "else", "enough", "every", "few", "for", "from",
    "further", "here", "how", "in", "into", "it", "less", "many", "more", "most", "much", "of", "off", "on", "once",
    "only", "other", "others", "out", "over", "rest", "so", "some", "such", "that", "them", "then", "there", "these",
    "this", "those", "to", "together", "twice", "under", "up", "what", "when", "where", "which", "who", "why", "with",
    "within", "without",
}  # fmt: skip
#: Further words that name nothing as an argument or a local variable.
FUNCTION_WORDS = (EMPTY | PARTICIPLES | {
    "alike", "asked", "bad", "both", "far", "few", "fitted", "good", "joined", "least", "listed", "moved", "named",
    "near", "needed", "own", "same", "shared", "some", "tried", "until", "used", "wanted", "whole", "wrong",
}) - {"down", "left", "spread", "up"}  # fmt: skip  # directions of axes, and a noun
PARTICIPLE = re.compile(r"[a-z]{2,}ed$")
ADVERB = re.compile(r"[a-z]{3,}ly$")
NO_ADVERBS = {"apply", "multiply", "supply", "family", "assembly", "anomaly", "reply", "fly", "poly", "imply"}


class Name(NamedTuple):
    """A function or class: where it stands, its name, and which it is."""

    place: str
    name: str
    is_property: bool
    is_class: bool


def names_in(tree: ast.Module, place: str) -> Iterator[Name]:
    """Yield the functions, methods and classes of a file."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            decorators = [] if isinstance(node, ast.ClassDef) else node.decorator_list
            is_property = any("property" in ast.unparse(decorator) for decorator in decorators)
            yield Name(f"{place}:{node.lineno}", node.name, is_property, isinstance(node, ast.ClassDef))


def fault_of(name: Name) -> str:
    """Return what is wrong with a name, empty where nothing is."""
    if name.name.startswith("__") or name.name in INHERITED:
        return ""
    words = [word.lower() for word in re.findall(r"[A-Z]?[a-z0-9]+|[A-Z]+", name.name)]
    if len(words) == 1 and len(words[0]) == 1:
        return "a single letter"
    if len(words) == 1 and words[0] in EMPTY:
        return "says nothing alone"
    ends = {words[0]} if words[0] in ("is", "has", "as") or "by" in words[1:] else {words[0], words[-1]}
    if name.is_class:  # an adjective before its noun: ``AdjustedPoint``
        ends = {words[-1]}
    for word in ends - VERBS:
        if ADVERB.fullmatch(word) and word not in NO_ADVERBS and not name.is_property:
            return f"{word}: an adverb"
        if (word in PARTICIPLES or PARTICIPLE.fullmatch(word)) and not name.is_property:
            return f"{word}: a participle"
    return ""


def list_locals(function: ast.FunctionDef | ast.AsyncFunctionDef) -> set[str]:
    """Return the arguments and local variables of a function, those of functions inside it too."""
    arguments = function.args
    listed = arguments.posonlyargs + arguments.args + arguments.kwonlyargs
    listed += [argument for argument in (arguments.vararg, arguments.kwarg) if argument]
    stored = {node.id for node in ast.walk(function) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}
    return ({argument.arg for argument in listed} | stored) - {"self", "cls", "_"}


def count_function_words(paths: list[Path], is_listed: bool) -> float:
    """Return the share of arguments and local variables that are function words; print them if asked."""
    names, words = 0, 0
    for path in paths:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                variables = list_locals(node)
                empty = sorted(variables & FUNCTION_WORDS)
                names, words = names + len(variables), words + len(empty)
                if empty and is_listed:
                    print(f"{path.relative_to(ROOT)}:{node.lineno} {node.name}: {', '.join(empty)}")
    return words / max(names, 1)


def list_long_calls(paths: list[Path]) -> Iterator[str]:
    """Yield the calls of functions and classes of the product with too many arguments without names."""
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in paths if not LOOPS.search(path.name)}
    defined = {
        node.name
        for tree in trees.values()
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef) or (isinstance(node, ast.FunctionDef) and not node.args.vararg)
    }
    for path, tree in trees.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and len(node.args) > MOST_POSITIONAL:
                module, _, name = ast.unparse(node.func).rpartition(".")
                if (
                    name in defined | {"cls"}
                    and module != "struct"
                    and not any(isinstance(one, ast.Starred) for one in node.args)
                ):
                    yield f"{path.relative_to(ROOT)}:{node.lineno} {name}: {len(node.args)} arguments without names"


def main(arguments: list[str]) -> int:
    """Print the names and calls with faults and return 1 where there are too many."""
    folders = [argument for argument in arguments if argument != "--locals"]
    places = [ROOT / folder for folder in folders or PARTS]
    paths = sorted(path for place in places for path in (place.rglob("*.py") if place.is_dir() else [place]))
    names = [
        name
        for path in paths
        for name in names_in(ast.parse(path.read_text(encoding="utf-8")), str(path.relative_to(ROOT)))
    ]
    faults = [(name, fault) for name in names if (fault := fault_of(name))]
    for name, fault in faults:
        print(f"{name.place} {name.name}: {fault}")
    is_public = [not name.name.startswith("_") for name, _ in faults]
    print(
        f"names: {len(faults)} of {len(names)} listed ({len(faults) / max(len(names), 1):.1%}), {sum(is_public)} public"
    )
    share = count_function_words(paths, "--locals" in arguments)
    print(f"names: {share:.1%} of arguments and local variables are function words, at most {MOST_FUNCTION_WORDS:.0%}")
    calls = list(list_long_calls(paths))
    print(*calls, f"names: {len(calls)} calls with more than {MOST_POSITIONAL} arguments without names", sep="\n")
    return int(any(is_public) or len(faults) > MOST_LISTED * len(names) or share > MOST_FUNCTION_WORDS or bool(calls))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
