"""Sentences and what is understood; wrong ones and what is said about them. Golden, one file for each."""

from collections.abc import Callable

import pytest

from kb.commands import understand
from kb.diagnostics import InvalidInput
from kb.loader import load_problem
from kb.model.domain import Domain
from kb.model.problem import Problem

GOOD = {
    "the_sentence_of_themse": "process probes 1 and 2 in the furnace for 15 min, cool them down in the freezer for "
    "5 min and store them in the drawer again",
    "as_the_paper_prints_it": "process probes 1 and 2 in the furnace for 15 min., cool them down in the freezer for "
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
    "them_after_single_probes": "heat probe 1 for 15 min and heat probe 2 for 10 min, then store them",
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
}


def printed(target: Problem | Domain, sentence: str) -> str:
    try:
        problem = understand(target, sentence)
    except InvalidInput as error:
        return f"{error}\n"
    lines = [f"say: {sentence}", f"goal: {problem.goal}".rstrip()]
    for chain in problem.chains:
        after = f" after {', '.join(chain.after)}" if chain.after else ""
        lines.append(f"chain {chain.name}{after}: {', '.join(map(str, chain.stages))}")
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("name", GOOD)
def test_what_is_understood(name: str, themse: Domain, golden: Callable[[str, str], None]) -> None:
    understand(themse, GOOD[name])
    golden(f"{name}.txt", printed(themse, GOOD[name]))


@pytest.mark.parametrize("name", BAD)
def test_what_is_said_about_a_wrong_command(
    name: str, themse: Domain, golden: Callable[[str, str], None]
) -> None:
    with pytest.raises(InvalidInput):
        understand(themse, BAD[name])
    golden(f"{name}.txt", printed(themse, BAD[name]))


@pytest.mark.parametrize("name", BULKHEAD)
def test_what_the_bulkhead_cell_understands(name: str, golden: Callable[[str, str], None]) -> None:
    golden(f"{name}.txt", printed(load_problem("bulkhead/twelve_points"), BULKHEAD[name]))
