"""Every number that tables of the thesis print and that can be computed, beside ours: `thesis_numbers.py [--docs]`.

``--docs`` writes docs/protocols/thesis_numbers.md. A number is

* *equal*, where ours differs by one unit of its last digit at most;
* *within chance*, where it differs by less than the standard error of an RMSE of as many points, 1 / sqrt(2 n);
* *explained*, where it differs by more and `EXPLAINED` says why: data that are not printed, a misprint that is shown,
  another definition;
* *open* otherwise.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hrsi.benchmarks import block_tables, chapter2, thesis_tables
from hrsi.benchmarks.pages import DATA, DOCS, make_parser, render, write_sections
from hrsi.benchmarks.real_blocks import TEN, check_rmse, hobart
from hrsi.benchmarks.sampling_analysis import THESIS, table_2_1, table_2_2, table_2_3
from hrsi.benchmarks.spot5 import CASES, Spot5, read_printed_checks, read_spot5
from hrsi.benchmarks.thesis_appendix import read_appendix
from hrsi.benchmarks.thesis_formulas import residuals_of_checks
from hrsi.hrsi_engine import adjust

PAGE = DOCS / "protocols/thesis_numbers.md"
EQUAL, CHANCE, EXPLAINED_AS, OPEN = "equal", "within chance", "explained", "open"
#: Table and the beginning of a row -> why ours differs.
EXPLAINED = {
    ("2.1", "case 3"): "misprint: the mean of the two printed deviations, 1.58 and 3.81, is 2.70",
    ("2.1", "case 11"): "both columns and rows are ambiguous: nine outcomes are possible, and the thesis uses three",
    ("2.1", "mean"): "follows from cases 3 and 11",
    ("2.3", "different"): "follows from cases 3 and 11 of table 2.1",
    ("2.3", "same"): "printed: the ratio of the rounded figures; the ratio of the exact figures is 60.3 %",
    (
        "2.7",
        "QuickBird",
    ): "the thesis registers on the ground by sensor models and a DEM that are not printed; here "
    "an affine transformation of the printed whole pixels is used",
    ("2.7", "Hobart"): "the RPCs of the vendor are not printed; RPCs fitted to the measurements give smaller residuals",
    ("4.7", ""): "the RPC of the vendor is not printed; positions are whole pixels",
    (
        "4.9",
        "case 1",
    ): "0.1 rad: the area over which the erroneous RPC was fitted is not printed; "
    "shifts of 43 000 px are reproduced to 14 px",
    ("4.9", "case 7"): "as case 1",
    ("4.10", "case 1"): "as case 1 of table 4.9",
    ("4.10", "case 7"): "as case 1 of table 4.9",
    ("4.11", "case 1"): "as case 1 of table 4.9",
    ("4.11", "case 7"): "as case 1 of table 4.9",
    ("App. VII 2, 3", ""): "the height of the pseudo sensor is not printed",
    ("App. VII 5, 6", ""): "the RPC of the vendor is not printed; positions are whole pixels",
    ("App. VII 10-24", ""): "the height of the pseudo sensor is not printed",
    ("App. VII 10-24", "case 1"): "as case 1 of table 4.9",
    ("App. VII 10-24", "case 2"): "0.01 rad: as case 1 of table 4.9, a tenth of it",
    ("App. VII 10-24", "case 7"): "as case 1 of table 4.9",
    ("App. VII 10-24", "case 8"): "as case 2",
    ("5.2", ""): "positions of 42 of the 113 points, and of 54 of the 71 on image 2, are not printed: weak geometry",
    ("5.4", ""): "as table 5.2; the RMSE of the centres on all three images is 0.33, 0.25 and 0.73 m",
}
#: What is printed and cannot be computed: number of printed values, and why.
NOT_COMPUTABLE = {
    "chapter 3, correspondences found (8 areas)": (9, "the images are not published"),
    "4.1 to 4.4": (64, "other authors' results, quoted; their data are not published"),
    "App. VII 18": (272, "no figures below its head: cases 7 and 8 with 3 GCPs"),
    "5.3": (213, "the Melbourne field is not published; simulated in [accuracy of blocks](accuracy_blocks.md)"),
    "5.5": (60, "the Melbourne field is not published; simulated in [accuracy of blocks](accuracy_blocks.md)"),
}


@dataclass(frozen=True)
class Number:
    """A printed number with its digits as text, ours, and from how many points (0: no chance in it)."""

    table: str
    row: str
    column: str
    printed: str
    ours: float
    points: int = 0

    @property
    def status(self) -> str:
        """What the comparison says."""
        printed = float(self.printed)
        digits = len(self.printed.partition(".")[2])
        away = abs(self.ours - printed)
        if away <= 1.01 * 10.0**-digits:
            return EQUAL
        if self.points and away <= printed / np.sqrt(2.0 * self.points):
            return CHANCE
        return EXPLAINED_AS if self.why else OPEN

    @property
    def why(self) -> str:
        """Why it differs, "" where nothing is known."""
        rows = [text for (table, row), text in EXPLAINED.items() if table == self.table and self.row.startswith(row)]
        return rows[-1] if rows else ""


# ---- chapter 2 -----------------------------------------------------------------------------------------------------


def chapter_2(folder: Path) -> Iterator[Number]:
    """Yield tables 2.1 to 2.3 and 2.7."""
    cases = table_2_1()
    for case in cases:
        for name, values, printed in zip(
            ("corner", "centre"), (case.corners_px, case.centres_px), chapter2.PRINTED_2_1[case.case], strict=True
        ):
            yield Number("2.1", f"case {case.case}", name, f"{printed:.2f}", float(np.mean(values)))
    for name, printed in (("corner", "2.77"), ("centre", "1.31")):
        values = [getattr(case, f"{name}s_px") for case in cases]
        yield Number("2.1", "mean", name, printed, float(np.mean([np.mean(one) for one in values])))
    for case in table_2_2():
        if case.case not in SPREADS:
            continue
        ours = sorted((corner.column, corner.row) for corner in case.corners)
        for k, (printed, value) in enumerate(zip(sorted(SPREADS[case.case][0]), ours, strict=True), 1):
            for axis in (0, 1):
                yield Number(
                    "2.2", f"case {case.case}", f"corner {k}, {('column', 'row')[axis]}", printed[axis], value[axis]
                )
        for name, printed_centre in zip(("column", "row"), SPREADS[case.case][1], strict=True):
            yield Number("2.2", f"case {case.case}", f"centre, {name}", printed_centre, getattr(case.centre, name))
    for name, errors in table_2_3().items():
        corner, centre, ratio = THESIS[name]
        yield Number("2.3", name, "corner", f"{corner:.2f}", errors.corner_px)
        yield Number("2.3", name, "centre", f"{centre:.2f}", errors.centre_px)
        yield Number("2.3", name, "centre / corner, %", f"{100 * ratio:.1f}", 100 * errors.ratio)
    yield from registrations(folder)


#: Table 2.2: case -> standard deviations (column, row) of the four corners, and of the centre.
SPREADS = {
    2: ([("0", "0.71")] * 4, ("0", "0.50")), 3: ([("0.58", "0.58")] * 4, ("0.43", "0.43")),
    5: ([("0", "0.71"), ("0", "0.71"), ("0", "0"), ("0", "0")], ("0", "0.35")),
    6: ([("0.58", "0.58"), ("0", "0.71"), ("0", "0"), ("0.71", "0")], ("0.29", "0.29")),
}  # fmt: skip


def registrations(folder: Path) -> Iterator[Number]:
    """Yield table 2.7: errors (m) of corners and centres in the three experiments."""
    quickbird = chapter2.register_quickbird(folder, "affine")
    for kind, printed in (("corner", "3.72"), ("center", "1.25")):
        yield Number("2.7", "QuickBird", kind, printed, quickbird.alone[kind].distance, 26)
    for name, together, figures in (("apart", False, ("1.48", "0.55")), ("together", True, ("1.51", "0.64"))):
        for kind, printed in zip(("corner", "center"), figures, strict=True):
            ours = chapter2.planimetric_sigma(chapter2.hobart_deviations(folder, kind, together=together))
            yield Number("2.7", f"Hobart, {name}", kind, printed, ours, 30)


# ---- chapter 4 -----------------------------------------------------------------------------------------------------


def chapter_4(folder: Path) -> Iterator[Number]:
    """Yield tables 4.6, 4.7 and 4.9 to 4.11, and the residuals of single points of appendix VII."""
    spot5 = read_spot5(folder)
    for count, (generic, bias) in thesis_tables.TABLE_4_6.items():
        ours = thesis_tables.compare(spot5.image(0), *spot5.control(count), count)
        if count in (1, 3, 7):
            ours = ours[0], thesis_tables.by_formulas(spot5, 0, count)
        yield from _pairs("4.6", f"{_gcps(count)}", (bias, generic), ours, len(spot5.control(count)[1]))
    everything = thesis_tables.rows_4_7(folder)
    for row, (count, (generic, bias)) in zip(everything, thesis_tables.TABLE_4_7.items(), strict=True):
        our_bias, our_generic = (_pair(row[k]) for k in (2, 4))
        yield from _pairs("4.7", f"{_gcps(count)}", (bias, generic), (our_bias, our_generic), 113 - count % 113)
    for count, table in thesis_tables.TABLES_BY_CASE.items():
        for case in CASES:
            if case:
                bias, generic = (printed[::-1] for printed in table[case - 1])
                ours = thesis_tables.compare(spot5.image(case), *spot5.control(count), count)[0]
                both = (ours, thesis_tables.by_formulas(spot5, case, count))
                name = thesis_tables.TABLE_NAMES[count]
                yield from _pairs(name, f"case {case}", (bias, generic), both, 37 - count)
    for count, points in read_printed_checks(folder).items():
        control, check = spot5.control(count)
        bias_px = -thesis_tables.check_residuals(thesis_tables.bias_model(count), spot5.image(0), control, check)
        generic_px = -residuals_of_checks(spot5.camera, control, check)
        for name, two, four in zip(check.ids.tolist(), bias_px, generic_px, strict=True):
            for k, value in enumerate([*two, *four]):
                method, axis = ("bias", "generic")[k // 2], ("sample", "line")[k % 2]
                printed = f"{points[name][k]:.3f}"
                yield Number(
                    "App. VII 2, 3", f"{_gcps(count)}, point {name}", f"{method} {axis}", printed, float(value)
                )
    yield from appendix_vii(folder, spot5)


#: GCPs and check points by the number of check points in a table of appendix VII.
GCPS_OF_SPOT5 = {36: 1, 34: 3, 30: 7}


def appendix_vii(folder: Path, spot5: Spot5) -> Iterator[Number]:
    """Yield the residuals of single points in tables 5, 6 (IKONOS) and 10 to 24 (SPOT 5 with simulated errors)."""
    for printed in read_appendix(folder):
        if printed.case:
            count = GCPS_OF_SPOT5[len(printed.rows)]
            control, check = spot5.control(count)
            generic_px = -residuals_of_checks(spot5.disturbed_camera(printed.case), control, check)
            bias_px = -thesis_tables.check_residuals(
                thesis_tables.bias_model(count), spot5.image(printed.case), control, check
            )
            table, head = "App. VII 10-24", f"case {printed.case}, {_gcps(count)}"
        else:
            image, everything = thesis_tables.ikonos(folder)
            used = np.isin(everything.ids, {5: thesis_tables.IKONOS_ONE, 6: thesis_tables.IKONOS_NINE}[printed.table])
            control, check = everything.select(used), everything.select(~used)
            bias, generic = thesis_tables.bias_model(len(control)), thesis_tables.generic_model(image, control)
            bias_px, generic_px = (
                thesis_tables.check_residuals(model, image, control, check) for model in (bias, generic)
            )
            table, head = "App. VII 5, 6", _gcps(len(control))
        ours = np.column_stack([generic_px, bias_px])
        for name, texts, values in zip(check.ids.tolist(), printed.rows, ours.tolist(), strict=True):
            for k, (text, value) in enumerate(zip(texts, values, strict=True)):
                column = f"{('generic', 'bias')[k // 2]} {('sample', 'line')[k % 2]}"
                yield Number(table, f"{head}, point {name}", column, f"{float(text):.3f}", value)


def _gcps(count: int) -> str:
    return "1 GCP" if count == 1 else f"{count} GCPs"


def _pair(text: str) -> tuple[float, float]:
    sample, line = text.split(" / ")
    return float(sample), float(line)


def _pairs(table: str, row: str, printed: tuple, ours: tuple, points: int) -> Iterator[Number]:
    """Yield sample and line of bias compensation and generic method."""
    for method, theirs, mine in zip(("bias", "generic"), printed, ours, strict=True):
        for axis, a, b in zip(("sample", "line"), theirs, mine, strict=True):
            yield Number(table, f"{row}, {method}", axis, f"{a:.2f}", b, points)


# ---- chapter 5 -----------------------------------------------------------------------------------------------------


def chapter_5() -> Iterator[Number]:
    """Yield tables 5.2 (means of 103 rows) and 5.4."""
    result = adjust(hobart(), block_tables.ESTIMATED)
    sigma = np.nanmean(result.ground_sigma_m[result.block.points.role == block_tables.Role.CHECK], axis=0)
    for axis, printed, ours in zip("XYH", ("0.346", "0.244", "1.016"), sigma, strict=True):
        yield Number("5.2", "mean of 103 points", axis, printed, float(ours))
    for count, models in enumerate(block_tables.TABLE_5_4, 1):
        for model, printed_m in zip(("shift", "affine"), models, strict=True):
            options = block_tables.replace(block_tables.TIES, model=model)
            ours_m = check_rmse(adjust(hobart(TEN[:count]), options))
            for axis, a, b in zip("XYZ", printed_m, ours_m, strict=True):
                yield Number("5.4", f"{_gcps(count)}, {model}", axis, f"{a:.3f}", float(b), 71 - count)


def collect(folder: Path = DATA / "thesis") -> list[Number]:
    """Return all numbers."""
    return [*chapter_2(folder), *chapter_4(folder), *chapter_5()]


# ---- page ----------------------------------------------------------------------------------------------------------

STATES = (EQUAL, CHANCE, EXPLAINED_AS, OPEN)


def summarise(numbers: list[Number]) -> list[list[str]]:
    """Return a row for each table: how many numbers are in each state."""
    tables = dict.fromkeys(number.table for number in numbers)
    rows = []
    for table in [*tables, "all"]:
        counted = Counter(number.status for number in numbers if table in (number.table, "all"))
        rows.append([table, str(sum(counted.values())), *(str(counted[state]) for state in STATES)])
    return rows


def make_sections(numbers: list[Number]) -> dict[str, str]:
    """Return the tables of the page by their headings."""
    head = render(("table", "numbers", *STATES), summarise(numbers))
    missing = render(
        ("table", "numbers", "why it is not computed"),
        [[table, str(count), why] for table, (count, why) in NOT_COMPUTABLE.items()],
    )
    groups: dict[tuple[str, str, str], list[Number]] = {}
    for number in numbers:
        if number.status in (EXPLAINED_AS, OPEN):
            row = number.row.partition(", ")[0] if number.table.startswith("App") else number.row
            groups.setdefault((number.table, row, number.why), []).append(number)
    rows = [[table, row, _list(group), why or "**open**"] for (table, row, why), group in groups.items()]
    differing = render(("table", "row", "printed → computed", "why"), rows)
    return {"": head, "Not computed": missing, "Numbers that differ": differing}


def _list(group: list[Number]) -> str:
    """Return printed and our numbers, of many only how far they are apart."""
    if len(group) > 8:
        away = [abs(number.ours - float(number.printed)) for number in group]
        return f"{len(group)} numbers, by {np.median(away):.3f} in the median, {max(away):.3f} at most"
    digits = (len(number.printed.partition(".")[2]) for number in group)
    return "; ".join(
        f"{n.column.replace('center', 'centre')} {n.printed} → {n.ours:.{d}f}"
        for n, d in zip(group, digits, strict=True)
    )


def main() -> None:
    """Print the table; write the page where asked for."""
    parser = make_parser(__doc__.splitlines()[0], PAGE)
    parser.add_argument("--data", type=Path, default=DATA / "thesis")
    words = parser.parse_args()
    sections = make_sections(collect(words.data))
    print(*(f"## {title}\n\n{text}" for title, text in sections.items()), sep="\n\n")
    if words.docs:
        write_sections(PAGE, sections)


if __name__ == "__main__":
    main()
