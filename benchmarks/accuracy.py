"""Accuracy figures: `accuracy.py thesis [--docs]`, `blocks [NAME …] [--docs]`."""

import sys
from collections.abc import Callable
from importlib import import_module

SUBJECTS = {
    "thesis": "hrsi.benchmarks.thesis_tables",
    "blocks": "hrsi.benchmarks.block_tables",
}


def main(words: list[str]) -> int:
    """Run one subject with the rest of the command line."""
    if not words or words[0] not in SUBJECTS:
        print(f"usage: accuracy.py {'|'.join(SUBJECTS)} [options]", file=sys.stderr)
        return 2
    run: Callable[[list[str]], None] = import_module(SUBJECTS[words[0]]).main
    run(words[1:])
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
