"""The command `hrsi`, also as ``python -m hrsi``: a signal ends it in one line from here on, while modules load too."""

from __future__ import annotations

import sys

from .hrsi_engine.foundation.interruption import quit_on_signals


def main() -> int:
    """Run the command line and return its exit code."""
    quit_on_signals()
    from .processing_algorithms.command_line import cli  # loads all declarations

    return cli.run_process()


if __name__ == "__main__":
    sys.exit(main())
