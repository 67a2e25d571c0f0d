"""Grounding on trial: the answer is that of clingo, whatever other threads do meanwhile."""

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from cellwright.kb import stopping
from cellwright.kb.asp import trial_grounding
from cellwright.kb.asp.trial_grounding import can_be_grounded

ENDLESS = "n(0). n(X+1) :- n(X)."


@pytest.fixture(autouse=True)
def _begin_without_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trial_grounding, "MAX_TRIAL_S", 1)
    trial_grounding._end_idle()


def test_one_process_answers_many_questions() -> None:
    assert can_be_grounded("a(1..3).")
    (process,) = trial_grounding._idle
    assert can_be_grounded("b(X) :- a(X). a(1..9).")
    assert can_be_grounded("a(1..")  # the real grounding tells what is wrong
    assert trial_grounding._idle == [process]


def test_after_a_process_has_ended_another_one_answers() -> None:
    assert can_be_grounded("a.")
    (process,) = trial_grounding._idle
    process._process.kill()
    process._process.wait()
    assert can_be_grounded("a.")
    assert trial_grounding._idle != [process]


@pytest.mark.slow
def test_what_has_no_end_is_ended_by_its_processor_time() -> None:
    assert not can_be_grounded(ENDLESS)
    assert trial_grounding._idle == []


def test_what_does_not_answer_is_ended_by_the_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trial_grounding, "MAX_TRIAL_CLOCK_S", 0.1)
    assert not can_be_grounded(ENDLESS)
    assert trial_grounding._idle == []


def test_who_wants_no_answer_any_more_leaves_no_process() -> None:
    with stopping.asking_to_stop(lambda: True), pytest.raises(stopping.StoppedByCaller):
        can_be_grounded(ENDLESS)
    assert trial_grounding._idle == []


def test_threads_ask_at_the_same_time() -> None:
    barrier = threading.Barrier(4)

    def ask(number: int) -> bool:
        barrier.wait(60)
        return can_be_grounded(f"a(1..{number + 1}).")

    with ThreadPoolExecutor(4) as threads:
        assert all(threads.map(ask, range(8)))
    assert 1 <= len(trial_grounding._idle) <= 4
