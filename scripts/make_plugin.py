"""Build the zip of the QGIS plugin: ``python scripts/make_plugin.py [--email … --homepage … …] [FILE]``.

The zip holds the folder ``hrsi`` as QGIS installs it ("Install from ZIP"). The plugin repository wants an address, the
homepage, the source repository and its tracker (`PUBLISHER_FIELDS`) in metadata.txt as well: they belong to who
publishes, so they are given here.
"""

import argparse
import configparser
import io
import sys
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FOLDER = "hrsi"
FILES = (
    "__init__.py", "__init__.pyi", "py.typed", "metadata.txt", "LICENSE", "README.md", "CHANGELOG.md",
    "SECURITY.md", "docs/verdict.md",
)  # fmt: skip
PARTS = ("plugin", "processing_algorithms", "hrsi_engine")
#: What else the plugin repository wants beside what metadata.txt holds.
PUBLISHER_FIELDS = ("email", "homepage", "repository", "tracker")
REQUIRED = ("name", "description", "about", "version", "qgisMinimumVersion", "author", "icon")
#: Kinds of files that the plugin consists of; what a build, an editor or a system leaves beside them is none of it.
KINDS = {
    ".py",
    ".txt",
    ".bash",
    ".zsh",
    ".fish",
    ".pyi",
    ".html",
    ".css",
    ".js",
    ".j2",
    ".qml",
    ".svg",
    ".png",
    ".model3",
    ".qm",
    ".ts",
}
LEFT_BEHIND = {".pyc", ".pyo", ".nbi", ".nbc", ".cache"}
LARGEST_BYTES = 20 * 1024**2  # the plugin repository's limit
OLDEST = (1980, 1, 1, 0, 0, 0)  # one time for all files: the same sources give the same zip


def plugin_files(root: Path = ROOT) -> Iterator[Path]:
    """Yield the files of the plugin, in order; raise ValueError for a file that is none of its kinds."""
    yield from (root / name for name in FILES)
    for part in PARTS:
        for path in sorted((root / part).rglob("*")):
            if not path.is_file() or path.suffix in LEFT_BEHIND:
                continue
            if path.suffix not in KINDS or path.name.startswith(".") or path.is_symlink():
                raise ValueError(f"{path.relative_to(root)} is no file of the plugin: remove it, or name its kind here")
            yield path


def plugin_metadata(root: Path, publisher: Mapping[str, str]) -> str:
    """Return metadata.txt with the publisher's fields; raise ValueError where a field is missing."""
    metadata = configparser.ConfigParser()
    metadata.optionxform = str  # type: ignore[assignment,method-assign]  # QGIS's keys have capitals
    metadata.read(root / "metadata.txt", encoding="utf-8")
    general = metadata["general"]
    for field, value in publisher.items():
        general[field] = value
    missing = [field for field in REQUIRED if not general.get(field)]
    if missing:
        raise ValueError(f"metadata.txt lacks {', '.join(missing)}")
    text = io.StringIO()
    metadata.write(text, space_around_delimiters=False)
    return text.getvalue()


def build(target: Path, publisher: Mapping[str, str], root: Path = ROOT) -> None:
    """Write the zip; raise ValueError where the plugin repository would refuse it."""
    metadata = plugin_metadata(root, publisher)
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = target.with_suffix(".part")
    with zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in plugin_files(root):
            name = path.relative_to(root)
            entry = zipfile.ZipInfo(f"{FOLDER}/{name.as_posix()}", OLDEST)
            entry.external_attr, entry.create_system = 0o100644 << 16, 3  # readable, not executable, on every system
            content = metadata.encode("utf-8") if str(name) == "metadata.txt" else path.read_bytes()
            archive.writestr(entry, content, zipfile.ZIP_DEFLATED, 9)
    size = temporary.stat().st_size
    if size > LARGEST_BYTES:
        temporary.unlink()
        raise ValueError(f"the zip has {size} bytes, more than the plugin repository takes: what grew?")
    temporary.replace(target)


def main(arguments: list[str]) -> int:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for field in PUBLISHER_FIELDS:
        parser.add_argument(f"--{field}")
    parser.add_argument("file", nargs="?", type=Path)
    options = vars(parser.parse_args(arguments))
    publisher = {field: options[field] for field in PUBLISHER_FIELDS if options[field]}
    metadata = configparser.ConfigParser()
    metadata.read(ROOT / "metadata.txt", encoding="utf-8")
    target = options["file"] or ROOT / "dist" / f"hrsi-{metadata['general']['version']}.zip"
    try:
        build(target, publisher)
    except ValueError as error:
        print(f"ERROR: {error}", file=sys.stderr)
        return 2
    print(f"{target}: {target.stat().st_size / 1024:.0f} KiB")
    absent = [field for field in PUBLISHER_FIELDS if field not in publisher and not metadata["general"].get(field)]
    if absent:
        named = " ".join(f"--{field}" for field in absent)
        print(f"QGIS installs it; to publish it in the plugin repository give {named} too", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
