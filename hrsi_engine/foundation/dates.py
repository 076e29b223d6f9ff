"""The date that results bear: that of the run, or one that is stated so that the same input gives the same bytes."""

import os
from datetime import UTC, datetime

EPOCH = "SOURCE_DATE_EPOCH"  #: environment variable: seconds since 1970 (reproducible-builds.org/specs)


def run_date() -> str:
    """Return the date of now in UTC, to the second, by ISO 8601: ``2026-03-01T12:00:00Z``."""
    text = os.environ.get(EPOCH, "").strip()
    epoch = int(text) if text.isdecimal() else None
    now = datetime.now(UTC) if epoch is None else datetime.fromtimestamp(epoch, UTC)
    return now.strftime("%Y-%m-%dT%H:%M:%SZ")
