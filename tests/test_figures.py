"""The registry of the documentation's figures: complete, runnable, and able to tell a changed figure."""

import re
from pathlib import Path

import pytest

from hrsi.benchmarks import figures, mutants
from hrsi.benchmarks.pages import ROOT

REGISTRY = figures.read_registry()
PAGE = """# Title

Made by a benchmark in 12 CPU s.

| GCPs | RMSE px | CPU s |
| ---- | ------- | ----- |
| 3    | 1.13    | 4.2   |
| 37   | 0.99    | 17    |
"""


def test_errors_of_the_list_fit_the_sources_and_tests():
    """A renamed name would leave an error out of `benchmarks/mutants.py`, which only says so when it runs."""
    for mutant in mutants.MUTANTS:
        file, _, test = mutant["test"].partition("::")
        assert mutant["old"] in (ROOT / mutant["file"]).read_text(encoding="utf-8"), mutant["name"]
        assert f"def {test.partition('[')[0]}" in (ROOT / file).read_text(encoding="utf-8"), mutant["name"]


def test_every_entry_names_a_script_and_a_page():
    for entry in REGISTRY.values():
        script = entry.command.split()[0]
        assert script == "-m" or (ROOT / script).is_file(), entry.name
        assert (ROOT / "docs" / entry.page).is_file(), entry.name
        assert entry.text(ROOT / "docs"), entry.name
        assert 0.0 < entry.tolerance <= 0.05, f"{entry.name}: a change of 5 % must be seen"
        assert entry.cpu_s > 0.0, entry.name


def test_every_page_that_a_benchmark_makes_is_registered():
    """Pages say so themselves: "Made by `python benchmarks/…`" in their first lines; others are named with a reason."""
    registered = {entry.page for entry in REGISTRY.values()}
    made = set()
    for path in (ROOT / "docs").rglob("*.md"):
        head = "\n".join(path.read_text(encoding="utf-8").splitlines()[:8])
        if re.search(r"(?:Made|Printed) by `(?:python )?(?:-m )?(?:hrsi\.)?benchmarks", head):
            made.add(str(path.relative_to(ROOT / "docs")))
    missing = made - registered - set(NOT_REGISTERED)
    assert not missing, f"add to benchmarks/registry.toml: {sorted(missing)}"
    assert not set(NOT_REGISTERED) & registered, "registered now: take it out of NOT_REGISTERED"


#: Pages whose figures are the machine's, or pooled over several runs; the command stands on the page.
NOT_REGISTERED = {
    "protocols/large_blocks.md": "times and memory only, beside another program",
    "protocols/surface_model.md": "beside other programs that are not installed here, with times and memory",
}


def test_turns_share_out_all_that_is_short_enough():
    shares = [figures.take_turn(list(REGISTRY.values()), day) for day in range(figures.TURNS)]
    dealt = [entry.name for share in shares for entry in share]
    checks = figures.list_checks(list(REGISTRY.values()))
    short = [entry.name for entry in checks if entry.cpu_s <= figures.MOST_CPU_S_IN_TURN]
    assert sorted(dealt) == sorted(short)
    assert all(sum(entry.cpu_s for entry in share) <= 600.0 for share in shares), "CI has ten minutes for it"


@pytest.mark.parametrize(
    ("old", "new", "differs"),
    [
        ("", "", False),
        ("1.13", "1.14", False),  # one unit of the last digit
        ("12 CPU s", "30 CPU s", False),  # times are not compared
        ("4.2", "9.9", False),
        ("1.13", "1.16", True),  # 2 %
        ("| 37 ", "| 38 ", True),  # a count is whole
        ("0.99", "-0.99", True),
        ("GCPs", "points", True),
        ("| 37   | 0.99    | 17    |\n", "", True),
    ],
)
def test_changes_are_found(old, new, differs):
    found = figures.compare(PAGE, PAGE.replace(old, new), 0.005)
    assert bool(found) is differs
    if differs and "px" not in old and new:
        assert any(new.strip("| \n") in difference.now for difference in found) or old == "GCPs"


def test_a_figure_made_anew_is_compared_with_its_page(tmp_path: Path, monkeypatch, capsys):
    """`check` runs the command with its page aside: a script that writes another number is caught, the docs stay."""
    (tmp_path / "docs" / "developing").mkdir(parents=True)
    (tmp_path / "docs" / "page.md").write_text(PAGE)
    script = "import os, pathlib; p = pathlib.Path(os.environ['HRSI_DOCS'], 'page.md'); "
    (tmp_path / "make.py").write_text(script + "p.write_text(p.read_text().replace('1.13', '1.16'))")
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "points.csv").write_text("1")
    monkeypatch.setattr(figures, "ROOT", tmp_path)
    monkeypatch.setattr(figures, "DATA", tmp_path)
    entry = figures.Figure("page", "page.md", "make.py", ("data",), 1.0, 0.005)
    assert figures.check([entry]) == 1
    assert "docs/page.md:7" in capsys.readouterr().out
    assert (tmp_path / "docs" / "page.md").read_text() == PAGE


def test_a_page_made_anew_has_not_been_checked(tmp_path: Path, monkeypatch):
    """What a check said of the page before does not stand beside the new one; other entries keep theirs."""
    (tmp_path / "docs" / "developing").mkdir(parents=True)
    (tmp_path / "docs" / "page.md").write_text(PAGE)
    (tmp_path / "make.py").write_text("")
    for name, path in (("ROOT", tmp_path), ("MADE", tmp_path / "made.csv"), ("CHECKED", tmp_path / "checked.csv")):
        monkeypatch.setattr(figures, name, path)
    checked = {}
    for name in ("page", "other"):
        figures.note_check(checked, figures.Figure(name, "page.md", "make.py", (), 1.0, 0.005), "aaaa", 1.0, False)
    figures.write_rows(figures.CHECKED, checked, figures.CHECKED_COLUMNS)
    assert figures.renew([figures.Figure("page", "page.md", "make.py", (), 1.0, 0.005)], {}) == 0
    assert set(figures.read_rows(figures.MADE)) == {"page"}
    assert set(figures.read_rows(figures.CHECKED)) == {"other"}


def test_pages_with_figures_of_hobart_say_that_its_rpcs_were_fitted():
    """The check points of Hobart are no independent ones: whoever reads an accuracy has to know it."""
    named = {}
    for path in sorted((ROOT / "docs").rglob("*.md")):
        text = path.read_text(encoding="utf-8")
        accuracies = [
            line for line in text.splitlines() if "Hobart" in line and re.search(r"\d\.\d+ (?:m|px)|\|.*\d\.\d", line)
        ]
        if accuracies or re.search(r"^#+ .*Hobart", text, re.MULTILINE):
            named[str(path.relative_to(ROOT / "docs"))] = bool(re.search(r"RPCs?\b[^.]{0,80}\bfitted", text))
    assert {"protocols/accuracy_blocks.md", "protocols/few_gcps.md", "tutorial/hobart.md"} <= set(named)
    assert not [page for page, said in named.items() if not said]


def test_samples_name_rows_of_the_page():
    page = "| sensor | ok |\n| --- | --- |\n| ikonos | 75 m | 8 |\n| ikonos | 112 m | 7 |\n"
    assert figures.compare_rows(page, "ikonos | 112 m | 7\n1 kinds: nothing else\n", 0.01) == []
    assert figures.compare_rows(page, "all        ikonos   75 m   8\n", 0.01) == []  # blanks, and a column before
    assert [one.now for one in figures.compare_rows(page, "ikonos | 75 m | 7\n", 0.01)] == ["ikonos | 75 m | 7"]
    assert figures.compare_rows(page, "quickbird | 75 m | 8\n", 0.01), "no row of the page was printed"


def test_samples_leave_out_columns_of_times_and_of_the_machine():
    page = "| pair | scale | found | CPU s | ratio |\n|---|---|---|---|---|\n| s2p | 0.6 | 71 | 4.2 | 2.85 |\n"
    printed = page.replace("4.2", "9.9").replace("2.85", "3.40")
    assert figures.compare_rows(page, printed, 0.01, ["ratio"]) == []
    assert figures.compare_rows(page, printed, 0.01), "the ratio is compared unless it is named"
    assert figures.compare_rows(page, printed.replace("71", "75"), 0.01, ["ratio"])


def test_long_studies_have_samples():
    """What takes longer than a turn allows is checked by samples, which are short enough."""
    for entry in REGISTRY.values():
        if entry.cpu_s > 4000.0:
            assert entry.samples, entry.name
        for sample in entry.draw_samples():
            assert 0.0 < sample.cpu_s <= figures.MOST_CPU_S_IN_TURN, entry.name
            assert (ROOT / sample.command.split()[0]).is_file() or sample.command.startswith("-m "), entry.name


def test_notes_of_checks_say_what_was_checked():
    """Samples of one commit stand together, and differ where one does; a whole page and another commit begin anew."""
    figure, checked = REGISTRY["coverage"], {}
    first, second = figure.draw_samples()[:2]
    figures.note_check(checked, first, "aaaa", 10.0, True)
    figures.note_check(checked, second, "aaaa", 5.0, True)
    assert (checked["coverage"]["what"], checked["coverage"]["cpu_s"]) == ("samples 1 2", "15")
    figures.note_check(checked, second, "bbbb", 5.0, True)
    assert (checked["coverage"]["what"], checked["coverage"]["commit"]) == ("samples 2", "bbbb")
    figures.note_check(checked, figure, "bbbb", 50.0, True)
    assert checked["coverage"]["what"] == "whole"
    figures.note_check(checked, first, "cccc", 10.0, False)
    figures.note_check(checked, second, "cccc", 5.0, True)
    assert (checked["coverage"]["what"], checked["coverage"]["commit"]) == ("differs", "cccc")
