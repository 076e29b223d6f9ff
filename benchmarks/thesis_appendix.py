"""Residuals of single check points that appendix VII of the thesis prints: tables 5, 6 and 10 to 24.

`read_appendix` reads them from the tables as printed, `thesis_numbers` compares them with ours.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

TABLE = re.compile(r"^Table (\d+) ")
CASE = re.compile(r"Case (\d)")
NAME = "appendix_vii_tables_5_6_10-24.md"


class PrintedResiduals(NamedTuple):
    """Residuals of check points in the order of their numbers, as texts: generic column and row, bias column and row.

    case : number of the simulated error of table 4.8; 0 for the tables of IKONOS
    """

    table: int
    case: int
    rows: list[list[str]]

    @property
    def values(self) -> np.ndarray:
        """The residuals as numbers ``(n, 4)``, px."""
        return np.array(self.rows, dtype=float).reshape(-1, 4)


def read_appendix(folder: Path) -> list[PrintedResiduals]:
    """Return the tables of the appendix, one for each case; a table stands in two halves beside each other."""
    found: list[PrintedResiduals] = []
    left = right = PrintedResiduals(0, 0, [])
    table = 0
    for line in (folder / NAME).read_text(encoding="utf-8").splitlines():
        if head := TABLE.match(line):
            table = int(head[1])
            continue
        cells = [cell.strip() for cell in line.strip("| ").split("|")]
        if cells[0] == "No":
            cases = [int(case) for case in CASE.findall(line)]
            left = PrintedResiduals(table, cases[0] if cases else 0, [])
            right = PrintedResiduals(table, cases[1], []) if len(cases) > 1 else left
            found += [left, right] if len(cases) > 1 else [left]
            later: list[list[str]] = []  # the right half of a table of one case goes on with its left half
        elif cells[0].isdigit():
            left.rows.append(cells[1:5])
            if len(cells) > 5 and not (right is left and int(cells[5]) <= len(left.rows)):
                (later if right is left else right.rows).append(cells[6:10])
        if line == "" and right is left and left.rows and table:
            left.rows.extend(later)
            later = []
    return [one for one in found if one.rows]
