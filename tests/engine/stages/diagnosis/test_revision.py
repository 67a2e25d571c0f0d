"""What a belief says of the world model: doubts, what is withdrawn and asserted, what is
restored and lost.
"""

from dataclasses import replace

import pytest

from cellwright.engine.model.troubleshooting import CaseDiagnosis, CaseHypothesis
from cellwright.engine.stages.diagnosis.belief_revision import (
    assertion_certainties,
    bind_atoms,
    binding_of,
    presupposed_facts,
    world_revision,
)
from cellwright.kb.model.conditions import ALWAYS_TRUE, And, Comparison, Literal, Parameter
from cellwright.kb.model.domain_model import Domain, Operator
from cellwright.kb.model.fault_model import Cause, FaultModel, Interruption, Repair
from cellwright.kb.terms import ANYTHING, Atom, Function, Variable

ITEM, P = Variable("I"), Variable("P")
X, Y = Variable("X"), Variable("Y")
BOLT, BIN, RACK = Function("bolt"), Function("bin"), Function("rack")


def at(item: object, place: object) -> Atom:
    return Function("at", (item, place))  # type: ignore[arg-type]


def held(item: object) -> Atom:
    return Function("held", (item,))  # type: ignore[arg-type]


MODEL = FaultModel(
    "shelf",
    {
        "missing": Interruption(
            "missing",
            "",
            dict.fromkeys(("fell", "slipped", "dark"), 1.0),
            Function("take", (ITEM, P)),
        ),
        "halt": Interruption("halt", "", {"dark": 1.0}),
    },
    {
        "fell": Cause(
            "fell",
            "it fell",
            doubts=(at(ITEM, P), held(ITEM)),
            adds=(at(ITEM, Function("floor")),),
            denies=(at(ITEM, P),),
            loses=(ITEM,),
        ),
        "slipped": Cause(
            "slipped", "it slipped", doubts=(held(ITEM),), denies=(held(ITEM), at(ITEM, ANYTHING))
        ),
        "dark": Cause("dark", "no light", doubts=(Function("lit"),), denies=(Function("lit"),)),
    },
    {},
    {
        "pick_up": Repair(
            "pick_up",
            "picked up",
            1,
            {"fell": 1.0},
            adds=(at(ITEM, P),),
            denies=(at(ITEM, Function("floor")),),
        ),
        "switch_on": Repair("switch_on", "switched on", 1, {"dark": 1.0}, adds=(Function("lit"),)),
    },
)
BINDING = {ITEM: BOLT, P: BIN}


def made(*hypotheses: tuple[str, ...], isolated: bool | None = None) -> CaseDiagnosis:
    """A diagnosis that leaves these sets of causes, equally probable."""
    belief = tuple((CaseHypothesis(causes), 1 / len(hypotheses)) for causes in hypotheses)
    return CaseDiagnosis(
        "missing", (), belief, 0.0, len(hypotheses) == 1 if isolated is None else isolated
    )


def names(pairs: tuple[tuple[Atom, str], ...]) -> dict[str, str]:
    return {str(atom): why for atom, why in pairs}


@pytest.mark.parametrize(
    ("exception", "step", "found"),
    [
        ("missing", Function("take", (BOLT, BIN)), BINDING),
        ("missing", Function("give", (BOLT, BIN)), {}),
        ("missing", None, {}),
        ("halt", Function("take", (BOLT, BIN)), {}),
    ],
)
def test_the_interrupted_step_binds_the_variables_of_its_operator(
    exception: str, step: Function | None, found: dict[Variable, Function]
) -> None:
    assert binding_of(MODEL, exception, step) == found


def test_an_assertion_is_as_certain_as_no_cause_is_that_doubts_it() -> None:
    belief = [
        (CaseHypothesis(("fell",)), 0.5),
        (CaseHypothesis(("slipped", "dark")), 0.3),
        (CaseHypothesis(("dark",)), 0.2),
    ]
    assert assertion_certainties(MODEL, belief, BINDING) == pytest.approx(
        {at(BOLT, BIN): 0.5, held(BOLT): 0.2, Function("lit"): 0.5}
    )


def test_an_assertion_that_two_causes_of_one_hypothesis_doubt_is_doubted_once() -> None:
    assert assertion_certainties(MODEL, [(CaseHypothesis(("fell", "slipped")), 0.4)], BINDING)[
        held(BOLT)
    ] == pytest.approx(0.6)
    assert (
        assertion_certainties(
            MODEL, [(CaseHypothesis(("fell",)), 0.6), (CaseHypothesis(("fell",)), 0.6)], BINDING
        )[held(BOLT)]
        == 0.0
    )


def test_the_cause_that_was_found_withdraws_asserts_and_loses() -> None:
    found = world_revision(MODEL, made(("fell",)), BINDING)
    assert names(found.withdrawn) == {"at(bolt, bin)": "fell: it fell"}
    assert names(found.asserted) == {"at(bolt, floor)": "fell: it fell"}
    assert found.lost == ("bolt",)
    # held is doubted by what was found
    assert names(found.restored) == {"lit": "dark is ruled out"}


def test_two_causes_withdraw_what_each_of_them_does() -> None:
    found = world_revision(MODEL, made(("fell", "dark")), BINDING)
    assert set(names(found.withdrawn)) == {"at(bolt, bin)", "lit"}
    assert names(found.restored) == {}


def test_what_is_not_isolated_withdraws_nothing() -> None:
    found = world_revision(MODEL, made(("slipped",), ("dark",)), BINDING)
    assert (found.withdrawn, found.asserted, found.lost) == ((), (), ())
    assert names(found.restored) == {"at(bolt, bin)": "fell is ruled out"}
    assert world_revision(MODEL, made(isolated=True), BINDING).withdrawn == ()


def test_a_repair_then_does_what_it_does_and_nothing_is_lost() -> None:
    found = world_revision(MODEL, made(("fell",)), BINDING, "pick_up")
    assert names(found.withdrawn) == {"at(bolt, floor)": "pick_up: picked up"}
    assert names(found.asserted)["at(bolt, bin)"] == "pick_up: picked up"
    assert found.lost == ()


def test_a_repair_may_lose_what_it_needed() -> None:
    lossy = replace(MODEL.repairs["pick_up"], loses=(P,))
    model = replace(MODEL, repairs={**MODEL.repairs, "pick_up": lossy})
    assert world_revision(model, made(("fell",)), BINDING, "pick_up").lost == ("bin",)


def test_what_a_person_has_put_right_is_not_lost() -> None:
    assert world_revision(MODEL, replace(made(("fell",)), cured="a person"), BINDING).lost == ()


def test_the_interrupted_step_presupposes_what_its_operator_needs_to_be_true() -> None:
    needs = And(
        (
            Literal(at(X, Y)),
            Literal(held(X), False),
            Comparison(X, "!=", Y),
            Literal(Function("lit")),
        )
    )
    take = Operator("take", (Parameter(X, "item"), Parameter(Y, "place")), needs, ())
    give = Operator("give", (), ALWAYS_TRUE, ())
    domain = Domain("shelf", operators=(give, take))
    assert presupposed_facts(domain, MODEL, "missing", BINDING) == (at(BOLT, BIN), Function("lit"))
    assert presupposed_facts(domain, MODEL, "missing", {}) == (at(ITEM, P), Function("lit"))
    assert presupposed_facts(domain, MODEL, "halt", {}) == ()  # it interrupts any operator
    assert presupposed_facts(Domain("shelf", operators=(give,)), MODEL, "missing", BINDING) == ()


def test_what_is_withdrawn_is_not_restored() -> None:
    found = world_revision(MODEL, made(("slipped",)), {})
    assert set(names(found.withdrawn)) == {"held(I)", "at(I, _)"}
    assert "held(I)" not in names(found.restored)


def test_patterns_are_bound() -> None:
    assert bind_atoms([at(ITEM, P)], {ITEM: BOLT}) == (at(BOLT, P),)
