"""The version, written once (``metadata.txt`` repeats it for QGIS and a test compares them), and the date of results.

Results bear the date of the run, or one that is stated so that the same input gives the same bytes.
"""

import os
from datetime import UTC, datetime

VERSION = "0.1.0"


EPOCH = "SOURCE_DATE_EPOCH"  #: environment variable: seconds since 1970 (reproducible-builds.org/specs)


def run_date() -> str:
    """Return the date of now in UTC, to the second, by ISO 8601: ``2026-03-01T12:00:00Z``."""
    text = os.environ.get(EPOCH, "").strip()
    epoch = int(text) if text.isdecimal() else None
    now = datetime.now(UTC) if epoch is None else datetime.fromtimestamp(epoch, UTC)
    return now.strftime("%Y-%m-%dT%H:%M:%SZ")
