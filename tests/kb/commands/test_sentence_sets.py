"""Thirty and more sentences for each large cell, and some for each small one, that are understood,
and as many that are not: what is made of each, and what is said.

Each file of `golden/sets` has the sentences of one cell; behind each stands what comes of it. To
add a sentence, write a line `say: ...` and run with `--update-golden`.
"""

from collections.abc import Callable
from pathlib import Path

import pytest

from cellwright.kb.commands import understand_command
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import bundled_domains, load_domain, load_problem
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.planning_problem import Problem

SETS = Path(__file__).parent / "golden" / "sets"
CAPPING = Path(__file__).parents[2] / "domains" / "capping" / "problems" / "three.yaml"
CELLS: dict[str, Callable[[], Problem | Domain]] = {
    "themse": lambda: load_domain("themse"),
    "bulkhead": lambda: load_problem("bulkhead/twelve_points"),
    "capping": lambda: load_problem(str(CAPPING)),
    "handey": lambda: load_problem("handey/five"),
    "centrifuge": lambda: load_problem("centrifuge/four"),
    "dual": lambda: load_domain("dual"),
    "gauging": lambda: load_problem("gauging/wall"),
    "halves": lambda: load_problem("halves/six"),
    "screening": lambda: load_problem("screening/day8"),
    "elisa": lambda: load_problem("elisa/plates3"),
}
SMALL = ("centrifuge", "dual", "elisa", "gauging", "halves", "screening")
SAY = "say: "


def sentences(cell: str, kind: str) -> list[str]:
    lines = (SETS / f"{cell}_{kind}.txt").read_text("utf-8").splitlines()
    return [line.removeprefix(SAY) for line in lines if line.startswith(SAY)]


def understood(target: Problem | Domain, sentence: str) -> str:
    """A sentence with its goals and chains."""
    problem = understand_command(target, sentence)
    lines = [f"  goal: {problem.goal}"] if not problem.chains else []
    for chain in problem.chains:
        after = f" after {', '.join(chain.after)}" if chain.after else ""
        lines.append(f"  {chain.name}{after}: {', '.join(map(str, chain.stages))}")
    lines += [f"  window: {window}" for window in problem.windows]
    return "\n".join([SAY + sentence, *lines]) + "\n"


def refused(target: Problem | Domain, sentence: str) -> str:
    """A sentence with what is said about it, and under which character."""
    with pytest.raises(InvalidInput) as error:
        understand_command(target, sentence)
    lines = (
        f"  {e.where.column}: {e.code} {e.message}; {e.hint}".rstrip("; ")
        for e in error.value.diagnostics
    )
    return "\n".join([SAY + sentence, *lines]) + "\n"


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize(("kind", "told"), [("good", understood), ("bad", refused)])
def test_what_each_cell_makes_of_its_sentences(
    cell: str,
    kind: str,
    told: Callable[[Problem | Domain, str], str],
    golden: Callable[[str, str], None],
) -> None:
    target, listed = CELLS[cell](), sentences(cell, kind)
    assert len(set(listed)) == len(listed) >= (4 if cell in SMALL else 30)
    golden(f"sets/{cell}_{kind}.txt", "".join(told(target, each) for each in listed))


@pytest.mark.parametrize("cell", CELLS)
def test_it_is_said_in_every_cell(cell: str) -> None:
    assert any("it" in sentence.split() for sentence in sentences(cell, "good"))


def test_every_bundled_cell_has_its_sentences() -> None:
    assert set(bundled_domains()) <= set(CELLS)
