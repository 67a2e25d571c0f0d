"""Every example of the language reference is loaded, as an addition to the cell at the top of
the page.
"""

import re
from pathlib import Path
from typing import Any

import pytest

from cellwright.engine.authoring import domain_check
from cellwright.engine.faces.cli.verb_table import VERBS
from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.kb.loader import load
from cellwright.kb.model.name_conventions import CONVENTION_BY_NAME
from cellwright.kb.schema import json_schema

PAGE = (Path(__file__).parents[2] / "docs" / "language.md").read_text("utf-8")
ALL = re.findall(r"^```([\w ]+)\n(.*?)^```$", PAGE, re.M | re.S)
BASE = {kind: text for kind, text in ALL if kind in ("yaml domain", "prolog rules", "yaml problem")}
PROBLEM_FRAGMENTS = [text for kind, text in ALL if kind == "yaml problem fragment"]


def merged(base: str, fragment: str) -> str:
    """The base with the entries of the fragment's sections added to its own; single lines are
    replaced.
    """
    sections = dict(re.findall(r"^(\w+:[^\n]*)\n((?:[ #][^\n]*\n)*)", base, re.M))
    for head, body in re.findall(r"^(\w+:[^\n]*)\n((?:[ #][^\n]*\n)*)", fragment, re.M):
        name = head.partition(":")[0]
        same = next((each for each in sections if each.partition(":")[0] == name), None)
        if same is None or not body:
            sections.pop(same, None) if same else None
            sections[head] = body
        else:
            sections[same] += body
    return "".join(f"{head}\n{body}" for head, body in sections.items())


def domain_fragments() -> list[tuple[str, str]]:
    """The fragments of domain.yaml, each with the rules that follow it."""
    found: list[tuple[str, str]] = []
    for (kind, text), (following, rules) in zip(ALL, [*ALL[1:], ("", "")], strict=True):
        if kind == "yaml":
            found.append((text, rules if following == "prolog" else ""))
    return found


def cell(folder: Path, domain: str = "", rules: str = "", problem: str | None = None) -> Path:
    (folder / "domain.yaml").write_text(merged(BASE["yaml domain"], domain), "utf-8")
    (folder / "rules.lp").write_text(BASE["prolog rules"] + rules, "utf-8")
    (folder / "problem.yaml").write_text(problem or BASE["yaml problem"], "utf-8")
    return folder / "problem.yaml"


def test_the_cell_of_the_page_has_a_plan(tmp_path: Path) -> None:
    outcome = checked_plan.plan_problem(checked_plan.problem_of(str(cell(tmp_path))))
    assert isinstance(outcome, Found)
    assert len(outcome.plan.steps) >= 4


def test_there_are_examples() -> None:
    assert len(domain_fragments()) >= 14
    assert len(PROBLEM_FRAGMENTS) >= 3


@pytest.mark.parametrize(("fragment", "rules"), domain_fragments())
def test_an_example_of_a_domain_is_sound_and_grounds(
    fragment: str, rules: str, tmp_path: Path
) -> None:
    target = cell(tmp_path, fragment, rules)
    loaded = load(target)
    assert loaded.warnings == ()
    assert not [
        each
        for each in domain_check.check_domain_files(str(target)).diagnostics
        if not each.warning
    ]


@pytest.mark.parametrize("fragment", PROBLEM_FRAGMENTS)
def test_an_example_of_a_problem_is_sound_and_grounds(fragment: str, tmp_path: Path) -> None:
    base = re.sub(r"^workflow:\n(?: .*\n)*", "", BASE["yaml problem"], flags=re.M)
    if "complete" in fragment:
        base = re.sub(r"^initial:\n(?: .*\n)*", "", base, flags=re.M)
    target = cell(tmp_path, problem=merged(base, fragment))
    assert load(target).warnings == ()
    assert not [
        each
        for each in domain_check.check_domain_files(str(target)).diagnostics
        if not each.warning
    ]


def test_the_page_lists_the_conventions_as_the_engine_has_them() -> None:
    section = PAGE.partition("\n## Conventions\n")[2].partition("\n## ")[0]
    told = [
        f"| `{each.written()}` | {each.sort.value} | {each.meaning} | "
        f"{', '.join(f'`{verb}`' for verb in each.used_by)} |"
        for each in CONVENTION_BY_NAME.values()
    ]
    assert re.findall(r"^\| `.*", section, re.MULTILINE) == told


def test_conventions_are_used_by_verbs_that_there_are() -> None:
    assert {verb for each in CONVENTION_BY_NAME.values() for verb in each.used_by} <= set(VERBS)


def keys(schema: Any) -> set[str]:
    """Every key that a file may have, wherever in it."""
    found: set[str] = set()
    for part in [schema, *schema.get("$defs", {}).values()]:
        found |= set(part.get("properties", {}))
    return found


@pytest.mark.parametrize("kind", ["domain", "problem"])
def test_the_page_names_every_key(kind: str) -> None:
    commands = {"say", "goal", "stage", "words", "phrases"}  # have a page of their own
    assert {key for key in keys(json_schema(kind)) - commands if f"`{key}`" not in PAGE} == set()
