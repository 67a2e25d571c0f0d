"""Takes a run up where its journal ends: its course is restored, and the driver tells what became of commands under way."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from cellwright.engine.model.execution import Command, CommandKind, Fate, Phase, Reply, Report
from cellwright.engine.model.number_set import NumberSet
from cellwright.engine.pipelines.execution.compiling import Compiled, queued
from cellwright.engine.pipelines.execution.course import Course
from cellwright.engine.pipelines.execution.records import compiled_of
from cellwright.engine.pipelines.execution.resuming import Content, Past
from cellwright.engine.ports import Driver, Simulated
from cellwright.engine.stages import execution as executive
from cellwright.engine.stages.execution import Running, Standing, standing_of
from cellwright.kb.cycles import no_search_for_cycles


def settle(course: Course, past: Past) -> None:
    """Take in what has ended meanwhile, send what never came, and wait on for what goes on.

    The clock is brought to where the journal ends first. Failures are taken in before anything else, so that nothing begins.
    """
    heard: list[Reply] = []
    while course.driver.now_ms() < past.at_ms:
        came = course.driver.receive(past.at_ms)
        heard += [each for each in came if isinstance(each, Reply)]
        if not came and course.driver.tick_ms is None:
            break
    course.standing = replace(course.standing, now_ms=course.driver.now_ms())
    numbers = sorted(past.under_way())
    reports = course.driver.report(numbers)
    ended = {
        each.number: each.reply for each in reports if each.fate is Fate.ENDED and each.reply is not None
    }
    ended |= {each.number: each for each in heard if each.number in course.standing.running}
    _send_again(course, past, reports)
    for reply in sorted(ended.values(), key=lambda each: (_is_normal(course, each), each.at_ms, each.number)):
        course.hear(reply)
    course.flush()


def _is_normal(course: Course, reply: Reply) -> bool:
    running = course.standing.running.get(reply.number)
    return running is not None and course.replies.is_normal(running.activity, reply.text)


def _send_again(course: Course, past: Past, reports: Sequence[Report]) -> None:
    """Send the commands that the driver has never received; those that it has dropped can begin anew."""
    under_way = past.under_way()
    lost = [each.number for each in reports if each.fate is Fate.UNKNOWN]
    course.outbox += [_command(under_way[number][0]) for number in lost]
    dropped = {each.number for each in reports if each.fate is Fate.DROPPED}
    if dropped:
        standing = course.standing
        running = {n: each for n, each in standing.running.items() if n not in dropped}
        course.standing = executive.standing_of(
            course.compiled.program,
            standing.now_ms,
            standing.number,
            standing.phase,
            past.done,
            running,
            past.done,
            standing.unrested,
        )


def _command(entry: Content) -> Command:
    return Command(
        entry["command"],
        CommandKind(entry["command_kind"]),
        entry["stream"],
        entry["action"],
        entry["says"],
        entry["expects"],
        tuple(entry["choices"]),
        entry["lasts_ms"],
        entry["timeout_ms"],
        entry["about"],
        entry["asks"],
        tuple(entry.get("looks", ())),
        tuple(entry.get("watches", ())),
    )


def taken_up(past: Past, lookahead: Callable[[str], int], now_ms: int) -> tuple[Compiled, Standing]:
    """The last program of a run, and where it stood. `lookahead` tells how many commands a stream takes at once."""
    assert past.plan is not None
    with no_search_for_cycles():
        compiled = queued(compiled_of(past.plan), lookahead)
        return compiled, standing_again(compiled, past, now_ms)


def standing_again(compiled: Compiled, past: Past, now_ms: int) -> Standing:
    """Where the last plan of a run stood when its journal ended: what was done, and what was under way."""
    running = {number: Running(entry["step"], at_ms) for number, (entry, at_ms) in past.under_way().items()}
    phase, number, unrested = Phase.RUNNING, past.next_number, frozenset(past.unrested)
    return standing_of(compiled.program, now_ms, number, phase, past.done, running, past.done, unrested)


def restore(course: Course, past: Past) -> None:
    """Give a course what the journal of its run holds: the plan's number, commands without a reply, steps that are done."""
    course.written = past.written()
    course.entire = past.entire
    course.sent = {number: (dict(entry), at_ms) for number, (entry, at_ms) in past.sent.items()}
    course.noted, course.since = course.recorder.last, dict(past.since)
    course.accuracy = past.accuracy
    course.done, course.history = NumberSet(past.done), past.history


def left_out(driver: Driver) -> tuple[str, ...]:
    """The faults that were ordered for a simulated cell, and for which there were too few steps."""
    left = driver.not_come() if isinstance(driver, Simulated) else ()
    return tuple(f"{each} did not come up: there were fewer such steps" for each in left)
