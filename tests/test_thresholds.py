"""Thresholds are declared by topic, with unit, meaning and origin, and their page shows all of them."""

import list_thresholds

from hrsi.hrsi_engine.foundation.thresholds import threshold, thresholds


@thresholds
class SAMPLE:
    """What a sample decides."""

    largest_miss_px: float = threshold(3.0, "px", "largest miss | of a sample", "Lowe 2004")
    steps: tuple[int, int] = threshold((1, 20_000), "px", "first and last step")


def test_a_topic_without_meaning_is_a_fault():
    @thresholds
    class BARE:
        """What nobody uses."""

        limit: float = threshold(1.0, "", "", "")

    topic = list_thresholds.Topic("a", "BARE", BARE)
    assert list(list_thresholds.find_faults(topic)) == ["a.BARE.limit: say its meaning", "a.BARE.limit: say its origin"]


def test_the_page_shows_name_value_unit_meaning_and_origin():
    topic = list_thresholds.Topic("hrsi.a.b", "SAMPLE", SAMPLE)
    assert list(list_thresholds.format_topic(topic)) == [
        "",
        "## Sample",
        "",
        "`a.b`",
        "",
        "What a sample decides.",
        "",
        "| SAMPLE | value | unit | meaning | origin | without it |",
        "|---|---:|---|---|---|---|",
        "| largest_miss_px | 3 | px | largest miss \\| of a sample | Lowe 2004 |  |",
        "| steps | 1, 20 000 | px | first and last step | judgement |  |",
    ]


def test_a_threshold_that_no_case_needs_is_a_fault(monkeypatch):
    cases = {"a.b.SAMPLE.steps": "nothing", "a.b.SAMPLE.largest_miss_px": "a wrong match"}
    monkeypatch.setattr(list_thresholds, "read_cases", lambda: cases)
    topic = list_thresholds.Topic("hrsi.a.b", "SAMPLE", SAMPLE)
    assert list(list_thresholds.find_faults(topic)) == ["hrsi.a.b.SAMPLE.steps: no case fails without it: delete it"]
    assert list(list_thresholds.format_topic(topic))[-2].endswith("| Lowe 2004 | a wrong match |")
    assert list_thresholds.count_untried([topic]) == 0
