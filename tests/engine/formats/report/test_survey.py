"""The report of an inspection: everything in it is escaped, it needs nothing else, and it names
what is missing.
"""

import re
from html import escape
from html.parser import HTMLParser

from cellwright.engine.formats.report.measurements.survey_report import (
    survey_entry,
    survey_html,
    survey_summary,
)
from cellwright.engine.model.verdicts import MeasuredFeature, Survey, Unmeasured
from cellwright.kb.model.measured_results import Measured, Results

EVIL = "<script>alert('&\"')</script>"
VALUE = Measured(EVIL, "thickness", 9.0, "um", 10.0, 8.0, 12.0, EVIL, EVIL, 5, 1.0, 5.0)
DEMAND = ("um", 10.0, 8.0, 12.0, 5.0)
SURVEY = Survey(
    (
        MeasuredFeature(EVIL, "thickness", *DEMAND, 9.5, 0.4, (VALUE,), ((VALUE, EVIL),)),
        MeasuredFeature("m2", "thickness", *DEMAND, 8.1, 1.0, (VALUE,), again=("in doubt", EVIL)),
        MeasuredFeature("m3", "thickness", *DEMAND, 3.0, 1.0, (VALUE,), doubt=EVIL),
    ),
    (Unmeasured("m4", EVIL),),
    {EVIL: (0.0, 0.0, 0.0), "m2": (1.0, 0.5, 0.0), "m3": (2.0, 0.1, 0.0), "m4": (0.3, 0.9, 0.0)},
)


class Reader(HTMLParser):
    """Collects tags, what they refer to, and which are open."""

    def __init__(self) -> None:
        super().__init__()
        self.tags, self.refers, self.open = list[str](), list[str](), list[str]()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.refers += [
            name for name, _ in attrs if name in ("src", "href") or name.startswith("on")
        ]
        self.open += [tag] if tag not in ("meta",) else []

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_a_report_is_well_formed_and_fetches_and_runs_nothing() -> None:
    page, reader = survey_html(Results(EVIL, EVIL), SURVEY), Reader()
    reader.feed(page)
    assert not reader.open
    assert not reader.refers
    assert "script" not in reader.tags
    assert not re.search(r"url\(|@import|https?:", page)
    assert reader.tags.count("circle") == 4  # one picture: the points lie in a plane


def test_a_report_names_verdicts_and_what_is_missing() -> None:
    assert SURVEY.counts() == {"conforming": 1, "doubtful": 1, "not measured": 1, "undecided": 1}
    assert survey_summary(SURVEY) == (
        "4 features: 1 conforming, 1 doubtful, 1 not measured, 1 undecided; 1 bad value left out"
    )
    page = survey_html(Results("monday"), SURVEY)
    for each in ("Not measured", "Values left out", "undecided", "doubtful", "m4"):
        assert each in page
    assert survey_entry(SURVEY)["not_measured"] == [{"name": "m4", "why": EVIL}]


def test_a_report_tells_what_was_measured_again_and_why_and_by_what() -> None:
    page = survey_html(Results("monday"), SURVEY)
    row = page.split("<h2>Measured again</h2>")[1].split("<tbody>")[1].split("</tbody>")[0]
    assert row.count("<tr>") == 1
    for each in (
        "m2",
        escape(EVIL),
        "(2 times; this was the last reason)",
        f"9 um by {escape(EVIL)}",
        "undecided",
    ):
        assert each in row
    assert "Measured again" not in survey_html(Results("monday"), Survey(SURVEY.features[:1]))


def test_a_report_of_nothing_or_of_one_place_is_a_page() -> None:
    one = Survey((SURVEY.features[1],), (), {"m2": (1.0, 0.5, 0.0)})
    for each in (Survey(()), one):
        assert survey_html(Results("empty"), each).endswith("</html>\n")
