"""Write `docs/layers.md`: the columns of every layer, from `hrsi_engine.io.geopackage.declared_layers`.

``python scripts/list_layers.py`` writes the page; ``--check`` only tells whether the page is current.
"""

import sys
from pathlib import Path

from hrsi.hrsi_engine.io.geopackage import declared_layers
from hrsi.hrsi_engine.io.geopackage.typed_rows import LayerRows
from hrsi.processing_algorithms.laboratory import layers as layers_of_laboratory

PAGE = Path(__file__).resolve().parents[1] / "docs" / "layers.md"
COMMAND = ".venv/bin/python scripts/list_layers.py"
KINDS = {str: "text", float: "number", int: "whole number", bool: "yes or no"}
HEAD = f"""# Layers and their columns

<!-- Written by `{COMMAND}`: change the declarations and run it again. -->

What HRSI writes into GeoPackages. Each file says the same of its fields (table `gpkg_data_columns`), and QGIS shows the
titles in forms. Layers of residuals are written in WGS84 (`residuals_wgs84`), in UTM (`residuals_utm`) or, by
`evaluate`, for each set of RPCs; those of `ortho-check` as `misregistration_utm` and `misregistration_wgs84`.
"""


def write_page() -> str:
    """Return the page: a table for each class of rows, in the order of the declarations."""
    return "\n".join([HEAD, *map(write_layer, declared_classes())])


def declared_classes() -> list[type[LayerRows]]:
    """Return the classes of rows that declare a layer."""
    values = (vars(declared_layers) | vars(layers_of_laboratory)).values()
    return [rows for rows in values if isinstance(rows, type) and issubclass(rows, LayerRows) and rows.layer]


def write_layer(rows: type[LayerRows]) -> str:
    """Return a heading, what the layer holds, and a line for each column."""
    told = (rows.__doc__ or "").partition("\n")[0]
    lines = [f"## `{rows.layer}`", "", told, "", "| column | kind | unit | holds |", "|---|---|---|---|"]
    for name, said in rows.declared.items():
        level = f" (level {said.level})" if said.level else ""
        lines.append(f"| `{name}` | {KINDS[said.kind]} | {said.unit} | {said.description}{level} |")
    return "\n".join([*lines, ""])


def main() -> int:
    """Write the page, or say that it is stale."""
    text = write_page()
    if "--check" in sys.argv[1:]:
        if PAGE.read_text(encoding="utf-8") != text:
            print(f"{PAGE.name} is not what the declarations say: run {COMMAND}", file=sys.stderr)
            return 1
        return 0
    PAGE.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
