"""Sentences and what is understood; wrong ones and what is said about them.

Golden, one file for each.
"""

from collections.abc import Callable
from pathlib import Path

import pytest

from cellwright.kb.commands import understand_command
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load_domain, load_problem
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.planning_problem import Problem

GOOD = {
    "the_sentence_of_themse": "process probes 1 and 2 in the furnace for 15 min, cool them down in "
    "the "
    "freezer "
    "for "
    "5 min and store them in the drawer again",
    "as_the_paper_prints_it": "process probes 1 and 2 in the furnace for 15 min., cool them down "
    "in "
    "the "
    "freezer "
    "for "
    "5 min. and store them in the drawer again.",
    "all_probes": "process all probes for 15 min, cool them for 5 min and store them again",
    "list_of_three": "heat probes 1, 2 and 4 for 90 s",
    "noun_repeated": "heat probe 1 and probe 3 for 1.5 hours",
    "range_in_words": "heat probes 1 to 3 for 10 minutes",
    "range_with_a_dash": "heat samples 1-3 for 10 minutes",
    "range_with_dots": "heat probe_1..3 for 10 minutes",
    "hours_and_minutes": "cool probe 2 for 1 h 30 min",
    "times_in_words": "heat probe one for a quarter of an hour, then cool it for half a minute",
    "it": "heat probe 1 for 15 min and store it",
    "both": "heat probe 1 for 15 min, cool probe 2 for 5 min, then store both",
    "them_after_single_probes": "heat probe 1 for 15 min and heat probe 2 for 10 min, then store "
    "them",
    "then_for_the_same_probes": "heat probes 1 and 2 for 15 min, then cool them for 5 min",
    "then_for_another_probe": "heat probe 1 for 15 min, then cool probe 2 for 5 min",
    "and_for_another_probe": "heat probe 1 for 15 min and cool probe 2 for 5 min",
    "sentences": "Heat probe 1 for 15 min. Then cool it for 5 min. Store it.",
    "single_act": "open the drawer",
    "two_single_acts": "open the drawer and close the flap",
    "put_into_the_freezer": "put probe 3 into the freezer",
    "put_into_a_depot": "put probe 1 into depot 3",
    "act_among_stages": "heat probe 1 for 15 min, put it into the freezer, then take it back",
    "act_between_probes": "heat probes 1 and 2 for 15 min, then open the drawer, then store them",
    "open_and_close": "open the drawer, put probe 3 into the freezer and close the drawer",
    "goal_beside_a_workflow": "heat probe 1 for 15 min and put probe 2 into the freezer",
    "sensors": "check the grip force and read the laser",
    "the_freezer_is_opened_and_closed": "open the freezer, put probe 1 into the freezer and close "
    "the "
    "freezer",
    "the_lid_is_part_of_the_freezer": "open the lid, put probe 1 into the freezer and close the "
    "freezer",
    "furnace_and_flap": "open the furnace, put probe 1 into the furnace and close the flap",
    "opened_and_closed": "open the drawer and close it",
    "it_is_the_freezer": "open the freezer, put probe 1 into it and close it",
    "place_behind_the_time": "heat probe 1 for 15 min in the furnace",
    "place_before_the_verb": "in the furnace, heat probe 1 for 15 min",
    "each_probe": "heat each probe for 5 min",
    "every_probe": "put every probe back",
    "each_behind": "heat probes 1 and 2 for 5 min each",
    "both_and_a_list": "heat both probes 1 and 2 for 5 min",
    "another_time_for_another_probe": "heat probe 1 for 15 min and probe 2 for 10 min",
    "the_same_time_for_another_probe": "heat probe 1 for 15 min and probe 2 too",
    "another_place_for_another_probe": "put probe 1 into the freezer and probe 2 into the furnace",
    "another_number": "put probe 1 in depot 3 and probe 2 in depot 4",
    "same_verb": "open the drawer and the flap",
    "once_more": "heat probe 1 for 15 min, then for 10 min",
    "no_object_said_again": "heat probe 1 for 5 min, cool for 3 min and store",
    "object_behind_the_second_verb": "take and return probe 2",
    "exclamation": "Open the drawer!",
    "polite": "Could you please heat probe 1 for 5 min?",
    "time_behind": "heat probe 1 for 15 min, then cool it for 5 min within 10 min",
    "time_of_each": "heat probes 1 and 2 for 15 min, cool them for 5 min within 10 min of heating them",
    "time_from_the_start": "heat probe 1 for 15 min and cool it for 5 min an hour after the start of "
    "heating it",
    "least_time_in_front": "at least 5 min after heating probe 1 for 15 min, store it",
    "time_after_a_fact": "exactly 90 s after opening the drawer, close it",
    "after_in_front": "after heating probe 1 for 5 min, store it",
    "after_behind": "store probe 1 after heating it for 5 min",
    "after_two_acts": "after heating probe 1 for 5 min and cooling it for 3 min, store it and open "
    "the "
    "drawer",
    "before_in_front": "before storing it, heat probe 1 for 5 min",
    "before_another_probe": "store probe 1 before heating probe 2 for 5 min",
    "after_that": "heat probe 1 for 15 min, after that cool it for 5 min, finally store it",
    "first_second": "first heat probe 1 for 5 min, second cool it for 3 min, lastly store it",
    "then_some_of_them": "heat probes 1 and 2 for 15 min, then cool probe 1 for 5 min",
    "all_but_one": "heat all probes except 3 for 5 min",
    "the_others": "heat probe 1 for 5 min and the other probes for 10 min",
    "all_four": "heat all four probes for 5 min",
    "the_probe_named": "heat probe 1 for 5 min, then cool the probe for 3 min",
    "this_probe": "heat probe 2 for 5 min and put this probe into the freezer",
    "with_the_word_number": "heat probe number 2 for 5 min",
    "hours_and_a_half": "heat probe 1 for one and a half hours",
    "days": "heat probe 1 for 2 days",
    "out_of": "take probe 1 out of the furnace",
    "steps_of_two_devices": "put the lid on the freezer and lock it",
    "opened_heated_closed": "open the drawer, heat probe 1 for 10 min, then close the drawer",
    "taken_and_put_back": "take probe 1 out of the drawer, heat probe 2 for 10 min, put probe 1 "
    "back",
    "furnace_cannot_be_open": "open the furnace, heat probe 1 for 10 min, close the furnace",
    "one_in_the_other": "open the drawer and the flap, put probe 1 into the furnace, close the "
    "flap "
    "and "
    "close "
    "the drawer",
    "once_passive": "once probe 1 has been heated for 10 min, close the drawer",
    "once_what_was_said": "heat probes 1 and 2 for 10 min; once probe 1 is heated, open the drawer",
    "once_with_two_times": "heat probe 1 for 5 min and probe 2 for 20 min; once both are heated, "
    "open "
    "the "
    "drawer",
    "once_two_acts": "once probe 1 has been heated for 5 min and cooled for 3 min, store it",
    "once_open": "once the drawer is open, heat probe 1 for 5 min and close the drawer",
    "as_soon_as": "close the drawer as soon as probe 1 has been stored",
    "when_done": "heat probe 1 for 10 min, and when this is done, open the drawer",
    "after_you_have": "after you have heated probe 1 for 5 min, store it",
    "after_only_for_one": "heat probe 1 for 10 min and store probe 2 after cooling it for 5 min",
    "before_what_was_said": "heat probe 1 for 10 min. Before heating it, open the drawer.",
    "before_two_acts": "before storing it, heat probe 1 for 5 min and open the flap",
    "before_without_a_verb": "heat probe 1 for 5 min before probe 2",
    "before_and_after": "open the drawer before heating probe 1 for 5 min, then close the drawer "
    "after "
    "heating "
    "it",
    "once_all_of_them": "heat probe 1 for 5 min and probe 2 for 6 min, once all are heated store "
    "them",
    "each_by_itself": "after heating probes 1 and 2 for 5 min, store them",
    "it_is_each": "heat every probe for 5 min and store it",
    "but_first": "heat probe 2 for 5 min but first cool probe 1 for 5 min",
    "but_first_behind": "heat probe 1 for 5 min, but open the drawer first",
    "but_before_that": "heat probe 1 for 5 min and store it, but before that open the flap",
    "first_of_a_new_sentence": "open the drawer. First heat probe 1 for 5 min, then close the "
    "drawer",
    "semicolons": "heat probe 1 for 5 min; open the drawer; store it.",
}

BAD = {
    "misspelt_word": "procss probe 1 for 5 min",
    "strange_word": "heat probe 1 quickly for 5 min",
    "no_unit": "heat probe 1 for 15",
    "too_early": "heat probe 1",
    "empty": "",
    "nothing_known": "sing a song",
    "wrong_place": "put probe 1 into the cupboard",
    "wrong_object": "put the slippage into the freezer",
    "no_such_probe": "put probe 7 into the furnace and store probe 9",
    "range_backwards": "heat probes 3 to 1 for 5 min",
    "pronoun_without_a_noun": "heat them for 3 min",
    "it_for_two": "heat probes 1 and 2 for 5 min and cool it for 3 min",
    "both_of_four": "heat both probes for 5 min",
    "which_probe": "heat the probe for 5 min",
    "not_a_whole_second": "heat probe 1 for 2 ms",
    "then_what": "open the drawer, then",
    "no_time_at_all": "heat probe 1 for 0 min",
    "too_long": "heat probe 1 for 600000 h",
    "too_large": "put probe 1 into depot 99999999999",
    "negation": "do not open the drawer",
    "negation_in_short": "heat probe 1 for 5 min but don't store it",
    "never": "never close the flap",
    "without": "heat probe 1 for 5 min without opening the flap",
    "german": "nimm Probe 1 und lege sie in den Ofen",
    "french": "ouvrez le tiroir et mettez la sonde 1 dans le four",
    "spanish": "abre el horno y pon la muestra",
    "cyrillic": "открой ящик",
    "until": "heat probe 1 until it is warm",
    "if": "if the drawer is open, close it",
    "or": "heat probe 1 or probe 2 for 5 min",
    "any": "heat any probe for 5 min",
    "while": "cool probe 1 for 5 min while heating probe 2 for 5 min",
    "twice": "heat probe 1 twice for 5 min",
    "respectively": "put probes 1 and 2 into the freezer and the furnace respectively",
    "question": "is the drawer open?",
    "degrees": "heat probe 1 for 5 min at 300 degrees",
    "wait": "wait for 5 min, then open the drawer",
    "the_same_again": "heat probe 1 for 5 min, and do the same with probe 2",
    "after_a_time": "after 5 min store probe 1",
    "decimal_comma": "heat probe 1 for 1,5 hours",
    "which_two": "heat two probes for 5 min",
    "not_three": "heat all three probes for 5 min",
    "who_are_the_others": "heat the other probes for 5 min",
    "what_to_heat": "heat for 5 min",
    "wrong_kind": "put the furnace into the freezer",
    "once_what_was_not_said": "heat probe 1 for 5 min, once probe 2 is heated open the drawer",
    "once_warm": "once probe 1 is warm, store it",
    "after_a_time_behind": "store probe 1 after 5 min",
    "second_line": "heat probe 1 for 5 min,\ncool it dawn for 5 min",
}

BULKHEAD = {
    "bulkhead_point": "measure m1",
    "bulkhead_points": "measure points m1 to m12",
    "bulkhead_all_points": "measure all points",
    "bulkhead_with_the_laser": "measure m4 with the laser",
    "bulkhead_pick_up": "pick up the laser",
    "bulkhead_in_order": "measure points 1 and 2, then pick up the laser",
    "bulkhead_wrong_type": "measure m1 with m2",
    "bulkhead_no_such_point": "measure m13 with the laser",
    "bulkhead_which_tool": "take the tool",
    "bulkhead_with_in_front": "with the laser measure m4",
    "bulkhead_tool_and_points": "take the laser and measure points 3 and 4 with it, then put it "
    "back",
    "bulkhead_one_tool_after_the_other": "pick up the laser, measure m4, then pick up the "
    "ultrasonic "
    "probe",
    "bulkhead_all_but": "measure all points except m3 and m4",
    "bulkhead_back_again": "go to m3, measure m4, go to m3",
    "bulkhead_but_first": "measure points 1 and 2 with the laser, but first go to m3",
    "bulkhead_before": "measure m1 before m2",
    "bulkhead_once_all": "put the laser back once points 3 and 4 are measured",
    "bulkhead_go": "go to m3, then to m4",
    "bulkhead_each_its_tool": "measure m4 with the laser and m2 with the ultrasonic probe",
}


WORKSHOP = {
    "workshop_open_and_close": "open the red box, put part A into the red box and close the red "
    "box",
    "workshop_two_boxes": "open both boxes, pack part a into the red box, pack part b into the "
    "blue "
    "box "
    "and "
    "close "
    "them",
    "workshop_gate": "open the gate, bring part b to the rack and close the gate",
    "workshop_between": "open the red box; wash part a; close the red box",
    "workshop_two_verbs": "wash and dry part a for 5 min",
    "workshop_letters": "wash part a and part b, paint part c",
    "workshop_box": "open the red box and fill it with 12 screws, then close it",
    "workshop_short": "open the red one, fill with ten screws and shut",
    "workshop_other_number": "fill the red box with 3 screws and the blue box with 4",
    "workshop_everything": "put everything into the red box",
    "workshop_with_the_brush": "take the brush and paint part a with the brush",
    "workshop_on_the_way": "put part a on the rack, then on the bench",
    "workshop_after": "after washing part a, paint it and pack it into the red box",
    "workshop_which_box": "open the box",
    "workshop_no_such_part": "wash part d",
    "workshop_soap": "wash part a with soap",
    "workshop_within": "paint part a, then pack it into the red box within 10 min",
    "workshop_no_stage": "take the brush, drop the brush and take the sponge, then take the brush",
}


def printed(target: Problem | Domain, sentence: str) -> str:
    try:
        problem = understand_command(target, sentence)
    except InvalidInput as error:
        return f"{error}\n"
    lines = [f"say: {sentence}", f"goal: {problem.goal}".rstrip()]
    for chain in problem.chains:
        after = f" after {', '.join(chain.after)}" if chain.after else ""
        lines.append(f"chain {chain.name}{after}: {', '.join(map(str, chain.stages))}")
    lines += [f"window: {window}" for window in problem.windows]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("name", GOOD)
def test_what_is_understood(name: str, themse: Domain, golden: Callable[[str, str], None]) -> None:
    understand_command(themse, GOOD[name])
    golden(f"{name}.txt", printed(themse, GOOD[name]))


@pytest.mark.parametrize("name", BAD)
def test_what_is_said_about_a_wrong_command(
    name: str, themse: Domain, golden: Callable[[str, str], None]
) -> None:
    with pytest.raises(InvalidInput):
        understand_command(themse, BAD[name])
    golden(f"{name}.txt", printed(themse, BAD[name]))


@pytest.mark.parametrize("name", BULKHEAD)
def test_what_the_bulkhead_cell_understands(name: str, golden: Callable[[str, str], None]) -> None:
    golden(f"{name}.txt", printed(load_problem("bulkhead/twelve_points"), BULKHEAD[name]))


@pytest.mark.parametrize("name", WORKSHOP)
def test_what_a_cell_with_slots_everywhere_understands(
    name: str, golden: Callable[[str, str], None]
) -> None:
    golden(
        f"{name}.txt", printed(load_domain(str(Path(__file__).parent / "workshop")), WORKSHOP[name])
    )


def test_there_are_sixty_good_and_forty_bad_sentences() -> None:
    folder = Path(__file__).parent / "golden"
    texts = [
        (folder / f"{name}.txt").read_text("utf-8") for name in (*GOOD, *BAD, *BULKHEAD, *WORKSHOP)
    ]
    good = sum(text.startswith("say: ") for text in texts)
    assert good >= 60
    assert len(texts) - good >= 40


def test_a_domain_without_such_objects_points_to_its_problems() -> None:
    with pytest.raises(InvalidInput, match="there is no tube 4") as refused:
        understand_command(load_domain("centrifuge"), "cap tube 4")
    assert "give the command to a problem that has a tube" in refused.value.diagnostics[0].hint


@pytest.mark.parametrize(
    ("said", "codes"),
    [
        ("heat probe 99 for 5 min, cool it for 5 min and store", ["K603"]),
        ("heat probe 99 for 5 min, cool probe 98 for 5 min and store", ["K603", "K603"]),
        ("heat it for 5 min and store probe 99", ["K603", "K603"]),
    ],
)
def test_what_leans_on_something_unclear_is_not_told_as_well(
    said: str, codes: list[str], themse: Domain
) -> None:
    with pytest.raises(InvalidInput) as refused:
        understand_command(themse, said)
    assert [each.code for each in refused.value.diagnostics] == codes


def test_a_misspelt_word_is_said_to_be_one_of_the_domain(tmp_path: Path) -> None:
    (tmp_path / "domain.yaml").write_text(
        "domain: foils\ntypes: {plate: object}\nobjects: {plate: [plate_1]}\nfluents:\n  "
        "sealed(plate): {}\n"
        'commands:\n  phrases:\n    - say: "seal {P:plate}"\n      goal: sealed(P)\n',
        "utf-8",
    )
    with pytest.raises(InvalidInput) as refused:
        understand_command(load_domain(str(tmp_path)), "seel plate 1")
    assert "did you mean 'seal'?" in refused.value.diagnostics[0].hint
