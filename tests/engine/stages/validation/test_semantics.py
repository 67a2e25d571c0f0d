"""What the checker takes domains to mean: initial states as grounding finds them, and each rule
of deduction by example.
"""

import dataclasses

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.engine.stages.validation.step_changes import CheckedChange, Denial
from cellwright.engine.stages.validation.step_interference import ExecutedStep
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.conditions import Literal
from cellwright.kb.model.domain_model import Default
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import ANYTHING, Function
from tests.engine.stages.validation.small_plans import CELL, atom, link, problem, step, wrong
from tests.properties.problems import CONSTANTS, ONE_X, X, atoms, problems

MANY = settings(max_examples=80, deadline=None, suppress_health_check=list(HealthCheck))
default = st.one_of(
    st.builds(Default, atoms(CONSTANTS)),
    st.builds(Default, atoms((X,)), st.just(ONE_X)),
    st.builds(Default, atoms((X,)), st.just(ONE_X), st.just((Literal(Function("good", (X,))),))),
)


@given(problems(deductive=True), st.lists(default, max_size=3).map(tuple))
@MANY
def test_the_initial_state_is_that_of_grounding(
    found: Problem, defaults: tuple[Default, ...]
) -> None:
    domain = dataclasses.replace(found.domain, defaults=defaults)
    good = (Function("good", (CONSTANTS[0],)),)
    for complete in (False, True):
        posed = dataclasses.replace(found, domain=domain, statics=good, complete=complete)
        try:
            task = ground(posed)
        except InvalidInput:
            assume(False)
        assert {each for each in task.names(task.initial) if each.name in ("p", "q", "r")} == (
            Semantics(posed).initial()
        )


DEFAULTS = """domain: shelf
types: {item: object, place: object}
objects: {item: [bolt, nut], place: [table, bin]}
statics: {"home(item, place)": {}}
fluents: {"at(item, place)": {}, free(place): {}, tidy: {}}
operators:
  rest: {adds: tidy}
deductive_operators:
  - {when: "at(I, P)", denies: "at(I, Q), Q != P; free(P)"}
defaults:
  - at(I, P), home(I, P)
  - free(P)
"""


def test_a_default_holds_unless_what_is_there_denies_it_or_it_denies_that() -> None:
    statics = ("home(bolt, table)", "home(nut, table)")
    posed = problem("tidy", ("at(bolt, bin)",), DEFAULTS, statics=statics)
    assert {str(each) for each in Semantics(posed).initial()} == {"at(bolt, bin)", "at(nut, table)"}
    posed = problem("tidy", ("free(table)", "at(bolt, bin)"), DEFAULTS, statics=statics)
    assert {str(each) for each in Semantics(posed).initial()} == {"at(bolt, bin)", "free(table)"}


COUNTING = """domain: boxes
types: {box: object}
objects: {box: [b1, b2, b3]}
statics: {heavy(box): {}}
fluents: {sent(box): {}, warned(box): {}, watched(box): {}}
operators:
  send(B):
    where: "#count { C : heavy(C), C != B } < 2"
    preconditions: not sent(B)
    adds: sent(B)
deductive_operators:
  - {when: sent(B), where: "#count { C : heavy(C) } > 1", implies: warned(B)}
defaults:
  - "watched(B), heavy(B), #count { C : heavy(C) } > 1"
"""


@pytest.mark.parametrize(
    ("heavy", "sendable"), [((), True), (("b2",), True), (("b2", "b3"), False)]
)
def test_aggregates_are_evaluated_for_each_instance(heavy: tuple[str, ...], sendable: bool) -> None:
    posed = problem("sent(b1)", (), COUNTING, statics=tuple(f"heavy({box})" for box in heavy))
    assert (wrong(posed, (step(1, "send(b1)"),)) == []) == sendable


def test_aggregates_decide_what_is_deduced_and_what_is_so_by_default() -> None:
    one = problem("sent(b2), not warned(b2), not watched(b2)", (), COUNTING, statics=("heavy(b2)",))
    two = problem(
        "sent(b2), warned(b2), watched(b2)", (), COUNTING, statics=("heavy(b2)", "heavy(b3)")
    )
    assert wrong(one, (step(1, "send(b2)"),)) == []
    assert wrong(two, (step(1, "send(b2)"),)) == []


EFFECTS = """domain: trays
types: {tray: object, place: object}
objects: {tray: [t1, t2], place: [rack, oven]}
fluents: {"at(tray, place)": {}, hot(tray): {}, wet(tray): {}, done: {}}
operators:
  shake(P):
    types: {P: place}
    adds: done
    effects:
      - {when: "at(T, P), hot(T)", deletes: hot(T)}
      - {when: wet(T), adds: hot(T)}
  turn(T): {adds: hot(T), deletes: "hot(T), wet(T)"}
"""


def test_a_conditional_effect_comes_for_every_binding_that_held_before() -> None:
    initial = ("at(t1, rack)", "at(t2, oven)", "hot(t1)", "hot(t2)")
    assert wrong(problem("not hot(t1), hot(t2)", initial, EFFECTS), (step(1, "shake(rack)"),)) == []
    assert wrong(problem("hot(t1), not hot(t2)", initial, EFFECTS), (step(1, "shake(oven)"),)) == []
    assert (
        wrong(
            problem("hot(t1), hot(t2)", ("wet(t1)", "wet(t2)"), EFFECTS), (step(1, "shake(oven)"),)
        )
        == []
    )


def test_what_is_added_and_deleted_explicitly_stays_true() -> None:
    posed = problem("hot(t1), not wet(t1)", ("hot(t1)", "wet(t1)"), EFFECTS)
    assert wrong(posed, (step(1, "turn(t1)"),)) == []


CLOSURE = """domain: chain
types: {item: object, tool: item}
objects: {item: [bolt], tool: [saw]}
statics: {"next(item, item)": {}}
fluents: {on(item): {}, warm(item): {}, cold(item): {}, idle(item): {}, sharp(tool): {}}
operators:
  start(I): {adds: on(I)}
  stop(I): {deletes: on(I)}
deductive_operators:
  - {when: on(I), implies: "warm(I); on(J), next(I, J)"}
  - {when: warm(I), denies: cold(I)}
  - {when: on(T), types: {T: tool}, implies: sharp(T)}
  - {when: not on(I), implies: idle(I)}
  - {when: not cold(I), denies: idle(I)}
"""


def test_what_a_step_adds_is_closed_under_deduction() -> None:
    posed = problem(
        "on(saw), warm(saw), warm(bolt), not cold(saw), sharp(saw)", ("cold(saw)",), CLOSURE,
        statics=("next(bolt, saw)",),
    )  # fmt: skip
    assert wrong(posed, (step(1, "start(bolt)"),)) == []


def test_the_end_of_an_atom_has_consequences_only_if_it_was_true() -> None:
    assert wrong(problem("idle(bolt)", ("on(bolt)",), CLOSURE), (step(1, "stop(bolt)"),)) == []
    assert wrong(problem("not idle(bolt)", (), CLOSURE), (step(1, "stop(bolt)"),)) == []
    assert (
        wrong(
            problem("not idle(bolt)", ("cold(bolt)", "idle(bolt)"), CLOSURE),
            (step(1, "start(bolt)"),),
        )
        == []
    )
    assert wrong(problem("idle(bolt)", ("idle(bolt)",), CLOSURE), (step(1, "start(bolt)"),)) == []


STRATA = """domain: layers
types: {item: object}
objects: {item: [a, b, c]}
statics: {"joined(item, item)": {}}
derived: {linked(item): {}, apart(item): {}, whole: {}}
fluents: {first(item): {}, tried: {}}
operators:
  begin(I): {adds: first(I)}
  end: {preconditions: whole, adds: tried}
include: [rules.lp]
"""
RULES = """linked(I) :- first(I).
linked(J) :- linked(I), joined(I, J).
apart(I) :- item(I), not linked(I).
whole :- not apart(a), not apart(b), not apart(c).
"""


@pytest.mark.parametrize(
    ("joined", "whole"), [(("joined(a, b)", "joined(b, c)"), True), (("joined(a, b)",), False)]
)
def test_derived_predicates_are_closed_before_what_they_leave_out_is_read(
    joined: tuple[str, ...], whole: bool
) -> None:
    """`whole` depends on `apart`, which depends on the absence of what is `linked` by a
    recursive rule.
    """
    posed = problem("tried", (), STRATA, statics=joined, rules=RULES)
    found = wrong(posed, (step(1, "begin(a)"), step(2, "end", 1)))
    assert found == ([] if whole else ["K501: step 2 end: whole does not hold when it starts"])


LADDER = """shown(I) :- first(I).
told(I) :- shown(I).
heard :- told(I), joined(I, J).
"""


def test_what_follows_from_derived_atoms_alone_is_derived() -> None:
    text = STRATA.replace("linked(item): {}", "shown(item): {}, told(item): {}, heard: {}")
    posed = problem(
        "tried",
        (),
        text.replace(", apart(item): {}, whole: {}", "").replace("whole", "heard"),
        statics=("joined(b, c)",),
        rules=LADDER,
    )
    told = Semantics(posed)
    for first, heard in (("a", False), ("b", True)):
        facts = told.facts([atom(f"first({first})")])
        assert {str(each) for each in facts.named("told")} == {f"told({first})"}
        assert (atom("heard") in facts) == heard


def test_what_a_derived_condition_rests_on_is_watched() -> None:
    posed = problem("tried", (), STRATA, statics=("joined(a, b)", "joined(b, c)"), rules=RULES)
    begun = (step(1, "begin(a)"), step(2, "begin(c)"), step(3, "end", 1))
    assert wrong(posed, begun) == [
        "K503: steps 2 and 3 are unordered, but begin(c) changes first(_), which end depends on"
    ]
    linked = (link(1, "first(a)", 3),)
    assert wrong(posed, begun, linked) == []


def test_another_problem_shares_what_is_known_only_if_its_facts_are_the_same() -> None:
    one = problem("sent(b1)", (), COUNTING, statics=("heavy(b2)",))
    own = Semantics(one)
    state = frozenset({Function("sent", (Function("b1"),))})
    other = own.about(dataclasses.replace(one, initial=()), state)
    assert other is not None
    assert other.initial() == state
    assert other.statics is own.statics
    assert own.about(dataclasses.replace(one, statics=())) is None
    assert own.about(dataclasses.replace(one, domain=dataclasses.replace(one.domain))) is None


OVEN = """domain: oven
types: {item: object}
objects: {item: [bolt, nut]}
fluents: {"in(item)": {}, "hot(item)": {}, on: {}, loud: {}, full: {}, lit: {}}
operators:
  bake:
    effects:
      - {when: in(I), adds: hot(I)}
      - {when: on, adds: loud}
  insert(Item): {adds: in(Item)}
deductive_operators:
  - {when: in(bolt), implies: full}
  - {when: not in(bolt), denies: full}
  - {when: in(nut), implies: lit}
"""


@pytest.mark.parametrize(
    ("initial", "goals", "reached"),
    [
        (("in(bolt)",), "hot(bolt)", True),
        (("in(bolt)",), "hot(nut)", False),
        (("in(bolt)", "in(nut)"), "hot(bolt), hot(nut)", True),
        (("in(bolt)",), "loud", False),
        (("on",), "loud", True),
        (("on",), "hot(bolt)", False),
        ((), "loud", False),
    ],
)
def test_a_conditional_effect_happens_for_whatever_its_condition_holds(
    initial: tuple[str, ...], goals: str, reached: bool
) -> None:
    found = wrong(problem(goals, initial, OVEN), (step(1, "bake"),))
    assert [each[:4] for each in found] == ([] if reached else ["K502"] * (goals.count(",") + 1))


@pytest.mark.parametrize(
    ("item", "goals", "reached"),
    [("bolt", "full", True), ("bolt", "lit", False), ("nut", "lit", True)],
)
def test_an_operator_deduces_from_the_atoms_that_match_its_trigger_alone(
    item: str, goals: str, reached: bool
) -> None:
    found = wrong(problem(goals, (), OVEN), (step(1, f"insert({item})"),))
    assert [each[:4] for each in found] == ([] if reached else ["K502"])


def test_the_meaning_of_a_domain_serves_problems_with_the_same_facts_and_objects_alone() -> None:
    posed = problem("tidy", (), DEFAULTS, statics=("home(bolt, table)", "home(nut, bin)"))
    own = Semantics(posed)
    for statics in (posed.statics, tuple(list(posed.statics))):
        shared = own.about(dataclasses.replace(posed, statics=statics))
        assert shared is not None
        assert shared.statics is own.statics
    for statics in (posed.statics[:1], (*posed.statics, posed.statics[0]), posed.statics[1:]):
        assert own.about(dataclasses.replace(posed, statics=statics)) is None
    other = problem("tidy", (), DEFAULTS, objects="item: [screw]")
    assert own.about(other) is None
    assert own.about(dataclasses.replace(posed, domain=other.domain)) is None


STACKED = """domain: stacked
include: [rules.lp]
types: {item: object, place: object}
objects: {item: [bolt, nut, washer], place: [table, bin]}
fluents: {"at(item, place)": {}, counted: {}}
derived: {level(int): {}, free(place): {}, topped: {}}
operators:
  drop(I, P): {adds: "at(I, P)"}
  lift(I, P): {preconditions: "at(I, P)", deletes: "at(I, P)"}
  count(P): {preconditions: free(P), adds: counted}
"""
LEVELS = """
level(N) :- N = #count { I : at(I, table) }.
level(N - 1) :- level(N), N > 0.
topped :- level(3).
free(P) :- place(P), not at(_, P).
"""


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_what_follows_from_a_count_follows_further(count: int) -> None:
    """The numbers are met while the state is evaluated: rules that use them are instantiated
    then, and fire at once.
    """
    posed = problem("topped", (), STACKED, rules=LEVELS)
    items = ("bolt", "nut", "washer")
    told = Semantics(posed)
    for many in (count, 3, count):
        found = told.facts([atom(f"at({each}, table)") for each in items[:many]])
        assert {str(each) for each in found.named("level")} == {
            f"level({n})" for n in range(many + 1)
        }
        assert (atom("topped") in found) == (many == 3)
        free = {"free(bin)"} | ({"free(table)"} if not many else set())
        assert {str(each) for each in found.named("free")} == free


def test_what_is_free_of_everything_is_not_counted_beside_a_drop() -> None:
    posed = problem("counted", (), STACKED, rules=LEVELS)
    assert wrong(posed, (step(1, "count(bin)"), step(2, "drop(nut, table)"))) == []
    assert wrong(posed, (step(1, "count(bin)"), step(2, "drop(nut, bin)", 1))) == []
    assert wrong(posed, (step(1, "count(bin)"), step(2, "drop(nut, bin)"))) != []


SIGNALS = """domain: signals
types: {lamp: object}
objects: {lamp: [red, green]}
statics: {spare(lamp): {}}
fluents: {power: {}, dark(lamp): {}, done: {}}
events: {blinked(lamp): {}}
operators:
  blink(L):
    adds: blinked(L)
    effects:
      - {when: power, adds: blinked(L)}
      - {when: not dark(L), adds: blinked(L)}
  cut: {preconditions: power, deletes: power}
deductive_operators:
  - {when: not power, where: spare(L), implies: dark(L)}
"""


def test_an_event_that_conditions_repeat_happens_once() -> None:
    once = ("{name: red, stages: blinked(red)}",)
    twice = ("{name: red, stages: 'blinked(red), blinked(red)'}",)
    for workflow, blinks, right in ((once, 1, True), (twice, 1, False), (twice, 2, True)):
        posed = problem("", ("power",), SIGNALS, workflow)
        steps = tuple(step(n, "blink(red)", *range(1, n)) for n in range(1, blinks + 1))
        assert (wrong(posed, steps) == []) == right


@pytest.mark.parametrize("spare", [False, True])
def test_an_end_has_consequences_only_where_something_follows(spare: bool) -> None:
    posed = problem("done", ("power",), SIGNALS, statics=("spare(red)",) if spare else ())
    change = Semantics(posed).deduce(
        [], [Denial(atom("power"), deduced=False)], frozenset({atom("power")})
    )
    assert change.adds == ({atom("dark(red)")} if spare else set())
    assert change.triggered == ({atom("power")} if spare else set())


def test_a_step_changes_what_a_pattern_stands_for_whichever_argument_is_open() -> None:
    posed = problem("lit", (), CELL)
    drop = next(each for each in posed.domain.operators if each.name == "drop")
    told = ExecutedStep(
        step(1, "drop(bolt, bin)"),
        drop,
        {},
        CheckedChange(frozenset({atom("at(bolt, bin)")}), frozenset(), ()),
    )
    bolt, table, bin_ = Function("bolt"), Function("table"), Function("bin")
    for pattern, changed in (
        ((ANYTHING, bin_), True),
        ((bolt, ANYTHING), True),
        ((ANYTHING, ANYTHING), True),
        ((ANYTHING, table), False),
        ((Function("nut"), ANYTHING), False),
    ):
        assert told.changes(Function("at", pattern)) == changed
