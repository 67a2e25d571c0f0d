"""Each check of fault bases: a small base that breaks this rule alone, and the same base that
keeps it.
"""

from dataclasses import replace
from pathlib import Path

import pytest

from cellwright.kb.check.fault_base_check import check_faults
from cellwright.kb.diagnostics import Source
from cellwright.kb.loader import load
from cellwright.kb.loader.fault_base import load_faults
from cellwright.kb.model.fault_model import Cause, FaultModel, FaultTest, Interruption, Repair

HERE = Source("faults.yaml", 1)


def cause(name: str, stops: bool = False) -> Cause:
    return Cause(name, name, stops=stops, where=HERE)


def shows(
    name: str, *causes: str, chance: float = 1.0, outcomes: tuple[str, ...] = ("usual", "odd")
) -> FaultTest:
    """A test whose last outcome shows under some causes, with a chance."""
    given = {each: {outcomes[0]: 1.0 - chance, outcomes[-1]: chance} for each in causes}
    return FaultTest(name, name, 1, outcomes, outcomes[0], given, where=HERE)


def base(
    causes: list[Cause], tests: list[FaultTest], repairs: list[Repair], *raised: str
) -> FaultModel:
    """A fault base of one exception with these causes."""
    counts = dict.fromkeys(raised or [each.name for each in causes], 1.0)
    return FaultModel(
        "press",
        {"halt": Interruption("halt", "it halts", counts, where=HERE)},
        {each.name: each for each in causes},
        {each.name: each for each in tests},
        {each.name: each for each in repairs},
    )


def mend(name: str, **cures: float) -> Repair:
    return Repair(name, name, 1, cures, where=HERE)


STUCK, EMPTY, WORN = cause("stuck"), cause("empty"), cause("worn")
SOUND = base(
    [STUCK, EMPTY], [shows("look", "empty")], [mend("shake", stuck=0.5), mend("refill", empty=1.0)]
)


def said(model: FaultModel) -> list[str]:
    return [f"{each.code}: {each.message}" for each in check_faults(model)]


def test_a_sound_base_has_no_findings() -> None:
    assert said(SOUND) == []


def test_a_cause_that_no_exception_has_is_pointed_at() -> None:
    lonely = base([STUCK, EMPTY], list(SOUND.tests.values()), list(SOUND.repairs.values()), "stuck")
    assert "K309: no exception has the cause 'empty'" in said(lonely)
    assert not any("'stuck'" in each for each in said(lonely) if "K309" in each)


def test_a_cause_that_another_exception_has_is_raised() -> None:
    exceptions = {
        "halt": Interruption("halt", "", {"stuck": 1.0}, where=HERE),
        "slow": Interruption("slow", "", {"empty": 1.0, "stuck": 1.0}, where=HERE),
    }
    assert said(replace(SOUND, exceptions=exceptions)) == []


@pytest.mark.parametrize(("chance", "repaired"), [(0.0, False), (0.01, True)])
def test_a_cause_that_nothing_repairs_is_pointed_at(chance: float, repaired: bool) -> None:
    tests, refill = list(SOUND.tests.values()), SOUND.repairs["refill"]
    model = base([STUCK, EMPTY], tests, [mend("shake", stuck=chance), refill])
    assert said(model) == ([] if repaired else ["K903: nothing repairs 'stuck'"])
    stopping = base([cause("stuck", stops=True), EMPTY], tests, [refill])
    assert said(stopping) == []


def test_a_test_that_tells_nothing_apart_is_pointed_at() -> None:
    everywhere = shows("listen", "stuck", "empty")
    idle = replace(SOUND, tests={**SOUND.tests, "listen": everywhere})
    assert said(idle) == ["K904: 'listen' tells no causes of any exception apart"]


def test_a_test_is_of_use_if_it_tells_causes_of_one_exception_apart() -> None:
    exceptions = {
        **SOUND.exceptions,
        "slow": Interruption("slow", "", {"worn": 1.0}, where=HERE),
        "loud": Interruption("loud", "", {"worn": 1.0, "stuck": 1.0}, where=HERE),
    }
    causes = {**SOUND.causes, "worn": WORN}
    tests = {**SOUND.tests, "listen": shows("listen", "worn")}
    repairs = {**SOUND.repairs, "swap": mend("swap", worn=1.0)}
    used = replace(SOUND, exceptions=exceptions, causes=causes, tests=tests, repairs=repairs)
    assert said(used) == []
    del exceptions["loud"]
    assert said(replace(used, exceptions=exceptions)) == [
        "K904: 'listen' tells no causes of any exception apart"
    ]


ALIKE = "K902: no test tells stuck and empty apart, and no repair serves them all"


@pytest.mark.parametrize(
    ("test", "repairs", "found"),
    [
        (shows("look", "empty"), [], []),
        (shows("look", "empty", chance=0.9), [], [ALIKE]),  # likely to tell is not sure to
        (shows("look", "empty", chance=0.9), [mend("both", stuck=0.1, empty=0.1)], []),
        (shows("look", "empty", chance=0.9), [mend("one", stuck=1.0)], [ALIKE]),
        (shows("look", "empty", chance=0.9), [mend("none", stuck=1.0, empty=0.0)], [ALIKE]),
    ],
)
def test_causes_that_no_test_tells_apart_need_a_repair_for_all(
    test: FaultTest, repairs: list[Repair], found: list[str]
) -> None:
    assert said(base([STUCK, EMPTY], [test], [*SOUND.repairs.values(), *repairs])) == found


def many(count: int) -> tuple[list[Cause], list[Repair]]:
    causes = [cause(f"f{number}") for number in range(count)]
    return causes, [Repair("all", "all", 1, {each.name: 1.0 for each in causes}, where=HERE)]


@pytest.mark.parametrize(
    ("count", "found"), [(500, []), (1001, ["K905: more than 1000 causes of one exception"])]
)
def test_an_exception_has_at_most_1000_causes(count: int, found: list[str]) -> None:
    causes, repairs = many(count)
    assert said(base(causes, [], repairs)) == found


def test_what_cannot_be_held_is_an_error_and_all_else_a_warning() -> None:
    causes, repairs = many(1001)
    assert [each.warning for each in check_faults(base(causes, [], repairs))] == [False]
    assert [
        each.warning
        for each in check_faults(base([STUCK, EMPTY], [], list(SOUND.repairs.values())))
    ] == [True]
    assert all(
        each.hint and each.where == HERE for each in check_faults(base(*many(63)[:1], [], []))
    )
    everything = base(
        [STUCK, EMPTY, WORN], [shows("listen", "stuck", "empty")], [], "stuck", "empty"
    )
    found = check_faults(everything)
    assert {each.code for each in found} == {"K309", "K903", "K904", "K902"}
    assert all(each.warning for each in found)


@pytest.mark.parametrize("domain", ["themse", "bulkhead", "screening", "elisa"])
def test_the_bundled_fault_bases_know_how_every_operator_can_fail(domain: str) -> None:
    folder = Path(__file__).parents[3] / "domains" / domain
    base, _ = load_faults(folder / "domain.yaml")
    about = {each.operator.name for each in base.exceptions.values() if each.operator is not None}
    known = load(folder / "domain.yaml").domain
    assert {each.name for each in known.operators} <= about
