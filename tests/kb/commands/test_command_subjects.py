"""What an act is about, as its phrase says it, and what is reached together."""

from pathlib import Path

import pytest

from cellwright.kb.commands import understand_command
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load_domain
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.planning_problem import Chain

DOMAIN = """domain: cell
types: {part: object, box: object, setting: object}
objects: {part: [p1..2], box: [b1..2], setting: [opened, shut]}
fluents: {"in(part, box)": {}, "lid(setting)": {}, "clean(part)": {}, "dry(part)": {}}
operators:
  pack(P, B): {preconditions: "lid(opened)", adds: "in(P, B)"}
  turn(S): {preconditions: "not lid(S)", adds: lid(S)}
  wash(P): {adds: clean(P)}
  dry_off(P): {adds: dry(P)}
deductive_operators:
  - {when: lid(S), denies: "lid(Other), Other != S"}
  - {when: "in(P, B)", denies: "in(P, Other), Other != B"}
commands:
  words: {part: [part, parts], box: [box, boxes], setting: [setting]}
  phrases:
    - say: "load {B:box} with {P:part}"
      stage: in(P, B)
      SUBJECT
    - say: "turn the lid {S:setting}"
      stage: lid(S)
    - say: "prepare {P:part}"
      stage: clean(P) & dry(P)
    - say: "wash and dry {P:part}"
      goal: clean(P), dry(P)
    - say: "dry {P:part}"
      goal: dry(P)
"""


def domain(folder: Path, subject: str = "subject: P") -> Domain:
    (folder / "domain.yaml").write_text(DOMAIN.replace("SUBJECT", subject), "utf-8")
    return load_domain(str(folder))


def chains(found: Domain, sentence: str) -> dict[str, str]:
    return {chain.name: _shown(chain) for chain in understand_command(found, sentence).chains}


def _shown(chain: Chain) -> str:
    return f"{', '.join(map(str, chain.stages))} after {', '.join(chain.after) or 'nothing'}"


def test_a_phrase_says_what_its_act_is_about(tmp_path: Path) -> None:
    """The part goes into two boxes one after the other; about the boxes, the two acts would
    have no order.
    """
    found = chains(
        domain(tmp_path), "load box 1 with part 1, prepare part 2, load box 2 with part 1"
    )
    assert found["p1"] == "in(p1, b1) after nothing"
    assert found["p1:2"] == "in(p1, b1), in(p1, b2) after p2"


@pytest.mark.parametrize("subject", ["subject: P", "subject: B", ""])
def test_acts_that_exclude_each_other_are_one_chain_whatever_they_are_about(
    tmp_path: Path, subject: str
) -> None:
    found = chains(domain(tmp_path, subject), "load box 1 with part 1, load box 2 with part 1")
    assert [*found.values()] == ["in(p1, b1), in(p1, b2) after nothing"]


def test_a_setting_in_a_slot_makes_no_chains_that_contradict_each_other(tmp_path: Path) -> None:
    found = chains(
        domain(tmp_path), "turn the lid opened, load box 1 with part 1, turn the lid shut"
    )
    assert [*found.values()] == [
        "lid(opened) after nothing",
        "in(p1, b1) after opened",
        "lid(opened), lid(shut) after p1",
    ]


def test_what_is_reached_together_is_one_stage(tmp_path: Path) -> None:
    found = domain(tmp_path)
    assert chains(found, "prepare part 1, then load box 1 with part 1") == {
        "p1": "clean(p1) & dry(p1), in(p1, b1) after nothing"
    }
    assert chains(found, "wash and dry part 1, then turn the lid shut") == {
        "p1": "clean(p1) & dry(p1) after nothing",
        "shut": "lid(shut) after p1",
    }


@pytest.mark.parametrize(
    ("sentence", "hint"),
    [
        ("dry parts 1 and 2 one after the other", "... box 1, then box 2"),
        ("dry parts 1 and 2 respectively", "put box 1 into"),
        ("dry all parts likewise", "'boxes 1 and 2'"),
    ],
)
def test_hints_speak_of_the_objects_of_the_domain(tmp_path: Path, sentence: str, hint: str) -> None:
    with pytest.raises(InvalidInput) as refused:
        understand_command(domain(tmp_path), sentence)
    (diagnostic,) = refused.value.diagnostics
    assert hint in diagnostic.hint
