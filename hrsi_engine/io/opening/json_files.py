"""JSON files of any origin, read within their budget."""

import json
from typing import Any

from ...foundation.errors import InputError
from .budgets import require_size


def read_json(path: str, kind: str) -> Any:
    """Return what a JSON file (UTF-8, with or without a byte order mark) holds.

    ``kind`` is what it is read as, one of `budgets.MOST_BYTES`. Raises `InputError` where it cannot be read, is too
    large, or no JSON.
    """
    require_size(path, kind)
    try:
        with open(path, encoding="utf-8-sig") as file:
            return json.load(file)
    except (OSError, ValueError, RecursionError) as error:  # the last: brackets nested thousands deep
        raise InputError(f"{path}: is no JSON that can be read ({error}): get the file again") from None
