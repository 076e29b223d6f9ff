"""Write ``docs/project.schema.json``: the JSON Schema of project files, from the declarations of the algorithms."""

import json
from pathlib import Path
from typing import Any

from hrsi.processing_algorithms import REGISTRY
from hrsi.processing_algorithms.interface.declare import Kind, Param
from hrsi.processing_algorithms.projects.project_file import FOLDERS, SHARED, SKIP, TEXTS

PAGE = Path(__file__).resolve().parents[1] / "docs" / "project.schema.json"


def project_schema() -> dict[str, Any]:
    """Return the JSON Schema of project files, with which editors complete and check them."""
    tables = {name: {"type": "object", "additionalProperties": False, "properties": {
        SKIP: {"type": ["boolean", "string"], "description": "Leave this step out; the reason is in the report"},
        **{param.key: _describe_param(param) for param in REGISTRY[name].params},
    }} for name in FOLDERS}  # fmt: skip
    shared = {param.key: _describe_param(param) for param in REGISTRY["triangulate"].params if param.key in SHARED}
    texts = {key: {"type": "string", "description": text} for key, text in TEXTS.items()}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema", "title": "HRSI project", "type": "object",
        "required": ["images"], "additionalProperties": False, "properties": {**texts, **shared, **tables},
    }  # fmt: skip


#: JSON types by kind; all other kinds are texts.
_TYPES = {Kind.FLAG: "boolean", Kind.INTEGER: "integer", Kind.NUMBER: "number"}
_LISTS = (Kind.IMAGES, Kind.IDS, Kind.FOLDERS, Kind.GROUPS)


def _describe_param(param: Param) -> dict[str, Any]:
    kind = {"type": ["array", "string"]} if param.kind in _LISTS else {"type": _TYPES.get(param.kind, "string")}
    facts = {"enum": list(param.choices), "minimum": param.minimum, "maximum": param.maximum}
    given = {key: value for key, value in facts.items() if value not in (None, [])}
    unit = f" ({param.unit})" if param.unit else ""
    return {**kind, **given, "description": param.help.replace("`", "") + unit}


if __name__ == "__main__":
    PAGE.write_text(json.dumps(project_schema(), indent=1) + "\n", encoding="utf-8")
