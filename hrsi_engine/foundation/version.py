"""The version, defined here only (``metadata.txt`` repeats it for QGIS, and a test compares them), and the run date.

Results contain the date of the run; SOURCE_DATE_EPOCH replaces it, so that equal input gives equal bytes.
"""

import os
from datetime import UTC, datetime

VERSION = "0.1.0"


EPOCH = "SOURCE_DATE_EPOCH"  #: environment variable: seconds since 1970 (reproducible-builds.org/specs)


def run_date() -> str:
    """Return the current date and time in UTC (or that of SOURCE_DATE_EPOCH), in ISO 8601: ``2026-03-01T12:00:00Z``."""
    text = os.environ.get(EPOCH, "").strip()
    epoch = int(text) if text.isdecimal() else None
    now = datetime.now(UTC) if epoch is None else datetime.fromtimestamp(epoch, UTC)
    return now.strftime("%Y-%m-%dT%H:%M:%SZ")
