"""Joined words in every spelling; and what is unclear is told in the words of the sentence."""

from pathlib import Path

import pytest

from cellwright.kb.commands import understand_command
from cellwright.kb.commands.phrase_patterns import split_word
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load_domain
from cellwright.kb.model.domain_model import Domain

DOMAIN = """domain: wells
types: {probe: object, machine: object}
objects: {probe: [plate_1..3], machine: [heater_shaker, plate_hotel]}
fluents: {"inside(probe, machine)": {}, "clean(machine)": {}, "shaken(probe)": {}}
operators:
  move(P, M): {adds: "inside(P, M)"}
  wash(M): {adds: clean(M)}
  shake(P): {adds: shaken(P)}
commands:
  words: {probe: [probe, probes, plate, plates, well plate, well plates], plate_hotel: [plate-hotel]}
  phrases:
    - say: "put {P:probe} into the WRITTEN"
      goal: inside(P, heater_shaker)
    - say: "clean {M:machine}"
      goal: clean(M)
    - say: "shake {P:probe}"
      goal: shaken(P)
"""
SPELLINGS = ["heater shaker", "heater-shaker", "heater_shaker"]


def domain(folder: Path, written: str = "heater shaker") -> Domain:
    (folder / "domain.yaml").write_text(DOMAIN.replace("WRITTEN", written), "utf-8")
    return load_domain(str(folder))


def goal(found: Domain, sentence: str) -> str:
    return str(understand_command(found, sentence).goal)


def refusal(found: Domain, sentence: str) -> str:
    with pytest.raises(InvalidInput) as raised:
        understand_command(found, sentence)
    return f"{raised.value.diagnostics[0].code} {raised.value.diagnostics[0].message}"


@pytest.mark.parametrize("written", SPELLINGS)
@pytest.mark.parametrize("said", [*SPELLINGS, "Heater-Shaker"])
def test_a_joined_word_is_understood_in_each_spelling(
    tmp_path: Path, written: str, said: str
) -> None:
    found = domain(tmp_path, written)
    assert goal(found, f"put plate 2 into the {said}") == "inside(plate_2, heater_shaker)"
    assert goal(found, f"clean the {said}") == "clean(heater_shaker)"


@pytest.mark.parametrize("said", ["plate hotel", "plate-hotel", "plate_hotel"])
def test_a_noun_that_is_written_with_a_hyphen_is_understood_in_each_spelling(
    tmp_path: Path, said: str
) -> None:
    assert goal(domain(tmp_path), f"clean the {said}") == "clean(plate_hotel)"
    assert goal(domain(tmp_path), "shake well-plate 1") == "shaken(plate_1)"


def test_what_is_not_understood_is_told_behind_a_joined_word(tmp_path: Path) -> None:
    assert (
        refusal(domain(tmp_path), "put plate 2 into the heater-shakr")
        == "K602 'shakr' is not understood here"
    )
    assert refusal(domain(tmp_path), "put plate 2 into the heater-shaker qickly").startswith(
        "K602 'qickly'"
    )


def test_numbers_and_names_with_numbers_stay_whole() -> None:
    assert [split_word(each) for each in ("twenty-one", "m_12", "t3_746")] == [
        ("twenty-one",),
        ("m_12",),
        ("t3_746",),
    ]


def test_what_is_unclear_is_told_with_the_noun_of_the_sentence(tmp_path: Path) -> None:
    found = domain(tmp_path)
    assert refusal(found, "shake plate 9") == "K603 there is no plate 9"
    assert refusal(found, "shake well plates 1 and 9") == "K603 there is no well plate 9"
    assert refusal(found, "shake probe 9") == "K603 there is no probe 9"
    assert (
        refusal(found, "shake plate 1, then put 9 into the heater shaker")
        == "K603 there is no plate 9"
    )
    assert "no plate was named before" in refusal(found, "shake the other plates")


def test_where_no_noun_was_said_the_names_of_the_objects_give_it(tmp_path: Path) -> None:
    assert refusal(domain(tmp_path), "shake it") == "K603 nothing before 'it' is a plate"
    assert (
        refusal(domain(tmp_path), "shake heater_shaker")
        == "K603 heater_shaker is a machine, not a plate"
    )


@pytest.mark.parametrize("said", ["oven 2", "oven two", "oven_2", "oven-2"])
def test_a_name_with_a_number_is_understood_in_each_spelling(tmp_path: Path, said: str) -> None:
    found = domain(tmp_path, "oven two")
    assert goal(found, f"put plate 2 into the {said}") == "inside(plate_2, heater_shaker)"
    assert goal(found, "put plate-2 into the oven 2") == "inside(plate_2, heater_shaker)"
