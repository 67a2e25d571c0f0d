"""The decisions: each has a heading and a date; one that was replaced names the one that holds."""

import re

from tests.docs.pages import DECISIONS

PAGES = {path.name: path.read_text("utf-8") for path in DECISIONS if path.name != "index.md"}
SECTIONS = [
    (name, heading, body)
    for name, page in PAGES.items()
    for heading, body in re.findall(r"^## (.*)\n((?:(?!## ).*\n)*)", page, re.MULTILINE)
]


def anchor(heading: str) -> str:
    """The anchor that the site and forges give a heading."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def test_each_decision_has_a_date_first_and_a_heading_of_its_own() -> None:
    assert len(SECTIONS) >= 290
    assert [s[1] for s in SECTIONS if not re.match(r"\n\*20\d\d-\d\d-\d\d\.\*", s[2])] == []
    headings = [heading for _, heading, _ in SECTIONS]
    assert len(set(headings)) == len(headings)


def test_a_replaced_decision_links_to_the_one_that_holds() -> None:
    anchors = {(name, anchor(heading)) for name, heading, _ in SECTIONS}
    links = [
        (file or name, place)
        for name, _, body in SECTIONS
        for file, place in re.findall(r"\]\(([\w-]*(?:\.md)?)#([^)]+)\)", " ".join(body.split()))
    ]
    assert len(links) >= 25
    assert [link for link in links if link not in anchors] == []


def test_the_index_counts_the_decisions_of_each_topic() -> None:
    (index,) = (path.read_text("utf-8") for path in DECISIONS if path.name == "index.md")
    counts = dict(re.findall(r"^\| \[[^\]]*\]\((.*?)\) \| (\d+) \|", index, re.MULTILINE))
    assert {name: page.count("\n## ") for name, page in PAGES.items()} == {
        name: int(count) for name, count in counts.items()
    }
