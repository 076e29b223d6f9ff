"""`hrsi rerun report.json`: repeats the run of a report, and lists which of its inputs have changed since."""

import itertools
import os
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.io.catalogue.lineage import HIDDEN, file_entry, versions
from ...hrsi_engine.io.opening.files import read_json
from ..interface.declare import READ_KINDS, Algorithm, Kind, Param, option_label
from ..interface.options import OptionSource, find_algorithm
from .command_parser import algorithm_parser

_REPORT = "report.json"
#: Options that are not repeated: their permission was for one run.
ONCE = ("overwrite", "force_write")
_NEEDED = {"algorithm": str, "options": dict}


def read_past_run(words: Sequence[str], registry: Mapping[str, Algorithm]) -> tuple[Algorithm, list[str], OptionSource]:
    """Return the algorithm, the typed words, and the other options with their origin, for ``report.json [options]``.

    Raises `InputError` if there is no report, or it does not contain the options of its run.
    """
    if not words or words[0].startswith("-"):
        raise InputError("rerun needs a report first: hrsi rerun report.json [options]")
    path = os.path.join(words[0], _REPORT) if os.path.isdir(words[0]) else words[0]
    report = read_json(path, "report")
    if not isinstance(report, dict) or any(not isinstance(report.get(key), kind) for key, kind in _NEEDED.items()):
        raise InputError(f"{path}: does not contain the options of its run: name a report.json of this version of hrsi")
    algorithm = find_algorithm(registry, report["algorithm"])
    places = _MovedPaths(path, report)
    given = {key: value for key, value in report["options"].items() if key not in ONCE}
    again = [param for param in algorithm.params if HIDDEN in str(given.get(param.key))]
    typed = algorithm_parser(algorithm).parse_words(words[1:])
    if hidden := [option_label(param) for param in again if param.key not in typed]:
        raise InputError(f"{path}: keeps no passwords: give {' and '.join(hidden)} again")
    for param in algorithm.params:
        names_files = param.kind in (*READ_KINDS, Kind.FOLDERS) or {"FILE", "DIR"} & set(param.metavar.split("|"))
        if param.key in given and param.kind is not Kind.OUTPUT_DIR and names_files:
            given[param.key] = places.move(param, given[param.key])
    changed = list(places.find_changes())
    origin = {"report": os.path.abspath(path), "date": report.get("date"), "changed_inputs": [c for c, _ in changed]}
    messages = [
        f"the run of {report.get('date', 'an unknown date')}: {report.get('command') or algorithm.name}",
        *(f"warning: {file} {how}" for file, how in changed),
    ]
    now, before = versions(), report.get("versions")
    if isinstance(before, dict):
        differ = [f"{name} {text} (now {now[name]})" for name, text in before.items() if now.get(name, text) != text]
        messages += [f"made with other versions: {', '.join(differ)}"] if differ else []
    if not changed and report.get("inputs"):
        messages.append(f"all {len(report['inputs'])} inputs are as they were")
    return algorithm, list(words[1:]), OptionSource(given, messages, {"rerun_of": origin})


class _MovedPaths:
    """Present paths of the files of an earlier run: unchanged, or moved together with the report."""

    def __init__(self, path: str, report: Mapping[str, Any]) -> None:
        self._report = report
        self._folders = [str(report["directory"])] if isinstance(report.get("directory"), str) else []
        # The report is in the output directory; the folder to which that was relative has moved with it
        output = report["options"].get("output_dir")
        if isinstance(output, str) and not os.path.isabs(output):
            up = os.path.normpath(output).split(os.sep)
            if os.pardir not in up:
                here = os.path.dirname(os.path.abspath(path))
                self._folders.append(os.path.normpath(os.path.join(here, *[os.pardir] * len(up))))

    def file(self, path: str) -> str:
        """Return the present path of a file or folder; unchanged if it is not found."""
        return next((place for place in self._candidates(path) if os.path.exists(place)), path)

    def _candidates(self, path: str) -> Iterator[str]:
        """Yield the places where a file of the report may be now, the likeliest first."""
        if os.path.isabs(path):
            yield path
            # Absolute, below the moved folder
            yield from (os.path.join(new, os.path.relpath(path, old)) for old, new in itertools.pairwise(self._folders))
        else:
            yield from (os.path.join(folder, path) for folder in self._folders)

    def move(self, param: Param, value: Any) -> Any:
        """Return the value of an option with the present paths of its files."""
        if isinstance(value, (list, tuple)):
            return [self.move(param, item) for item in value]
        if not isinstance(value, str) or value in param.words:
            return value
        if param.kind is Kind.FOLDERS:
            name, _, folder = value.partition("=")
            return f"{name}={self.file(folder)}"
        return ";".join(self._move_spec(part) for part in value.split(";"))

    def _move_spec(self, text: str) -> str:
        """Return the present path of a file with layer (``FILE|layername=L``), a list (``@FILE``) or a pattern."""
        file, bar, layer = text.partition("|")
        sign = "@" if file.startswith("@") and not self._exists(file) else ""
        bare = file.removeprefix(sign)
        if any(letter in bare for letter in "*?[") and not self._exists(bare):
            return f"{os.path.join(self.file(os.path.dirname(bare) or os.curdir), os.path.basename(bare))}{bar}{layer}"
        return f"{sign}{self.file(bare)}{bar}{layer}"

    def _exists(self, path: str) -> bool:
        return any(map(os.path.exists, self._candidates(path)))

    def find_changes(self) -> Iterator[tuple[str, str]]:
        """Yield the inputs that have changed since the earlier run, with the kind of change."""
        entries = [entry for entry in self._report.get("inputs") or () if isinstance(entry, dict)]
        for entry in [entry for entry in entries if isinstance(entry.get("path"), str)]:
            path = self.file(entry["path"])
            if path.startswith("/vsi"):
                continue
            if not os.path.isfile(path):
                yield entry["path"], "is gone"
                continue
            now = file_entry(path, complete=entry.get("sampled_sha256") is None)
            if entry.get("size") != now["size"]:
                yield path, f"has changed since: {entry.get('size')} bytes then, {now['size']} now"
            elif any(entry[kind] != now[kind] for kind in ("sha256", "sampled_sha256") if entry.get(kind)):
                yield path, "has changed since: its SHA-256 is another one"
