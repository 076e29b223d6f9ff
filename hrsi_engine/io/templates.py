"""Jinja templates of pages and styles; their compiled form is stored in the same folder, as Python does it."""

import os
import sys
from collections.abc import Callable, Mapping
from typing import Any

#: Folder of compiled templates in that of the templates; compiling takes a quarter of a second for each report.
COMPILED = "__pycache__"


def make_environment(folder: str, filters: Mapping[str, Callable[..., Any]], *, strict: bool = False) -> Any:
    """Return Jinja's environment of a folder of templates.

    filters : functions by their names in the templates; strict : True if values that are missing are errors
    """
    import jinja2

    class CompiledTemplates(jinja2.FileSystemBytecodeCache):
        def load_bytecode(self, bucket: Any) -> None:
            try:
                super().load_bytecode(bucket)
            except Exception:  # whatever a damaged file causes: the template is compiled again
                bucket.reset()

    compiled, cache = os.path.join(folder, COMPILED), None
    if os.access(folder, os.W_OK) and not sys.dont_write_bytecode:
        os.makedirs(compiled, exist_ok=True)
        cache = CompiledTemplates(compiled) if os.access(compiled, os.W_OK) else None
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(folder),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined if strict else jinja2.ChainableUndefined,
        bytecode_cache=cache,
    )
    environment.filters |= filters
    return environment
