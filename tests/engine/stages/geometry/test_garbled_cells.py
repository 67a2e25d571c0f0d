"""Whatever is written into a cell file, checking it ends with diagnostics."""

import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.stages.geometry.collision.builtin import BuiltinBackend
from cellwright.engine.stages.geometry.reach.cell_check import check_cell
from cellwright.kb.diagnostics import DIAGNOSTIC_CODES
from cellwright.kb.loader import bundled_domains, load_domain
from cellwright.kb.model.domain_model import Domain

TEXTS = {
    name: (bundled_domains()[name] / "cell.yaml").read_text("utf-8")
    for name in ("themse", "bulkhead")
}
WORDS = re.compile(r"[A-Za-z_0-9.]+")
ODD = [
    "",
    "0",
    "-1",
    "1e9",
    "nan",
    "inf",
    "1e-300",
    "''",
    "[]",
    "{}",
    "true",
    "world",
    "table",
    "9" * 30,
]

edits = st.tuples(
    st.floats(0, 1, exclude_max=True), st.sampled_from(ODD) | st.floats(0, 1, exclude_max=True)
)


@pytest.fixture(scope="module")
def domains() -> dict[str, Domain]:
    return {name: load_domain(name) for name in TEXTS}


def edited(text: str, at: float, new: str | float) -> str:
    """The text with one word replaced, by an odd one or by another of its own."""
    words = [found.span() for found in WORDS.finditer(text)]
    start, end = words[int(at * len(words))]
    if isinstance(new, float):
        first, last = words[int(new * len(words))]
        new = text[first:last]
    return text[:start] + new + text[end:]


@pytest.mark.slow
@settings(max_examples=80, deadline=None)
@given(st.sampled_from(sorted(TEXTS)), st.lists(edits, min_size=1, max_size=3))
def test_a_garbled_cell_is_told_and_never_makes_the_check_stumble(
    domains: dict[str, Domain],
    tmp_path_factory: pytest.TempPathFactory,
    name: str,
    changes: list[tuple[float, str | float]],
) -> None:
    text = TEXTS[name]
    for at, new in changes:
        text = edited(text, at, new)
    file: Path = tmp_path_factory.mktemp("garbled") / "cell.yaml"
    file.write_text(text, "utf-8")
    found = check_cell(file, domains[name], BuiltinBackend)
    assert all(each.code in DIAGNOSTIC_CODES and each.message for each in found)
    assert all(each.where.path.endswith((".yaml", ".urdf")) for each in found)


def test_a_shape_without_numbers_is_told(domains: dict[str, Domain], tmp_path: Path) -> None:
    (tmp_path / "cell.yaml").write_text("cell: bare\nfixtures: {block: {shapes: [{cylinder: }]}}\n")
    (found,) = check_cell(tmp_path / "cell.yaml", domains["themse"], BuiltinBackend)
    assert (found.code, found.message) == ("K005", "an entry without a shape")
