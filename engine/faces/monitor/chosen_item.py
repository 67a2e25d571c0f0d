"""What is chosen on a page (step, fact, object, command) and what belongs to it in each view."""

import re
from collections.abc import Iterable
from typing import Any

from cellwright.engine.faces.monitor.run_follower import WatchedRun
from cellwright.engine.formats.report.runs.run_display import begin_text
from cellwright.engine.model.noun_wording import count_noun


def related_texts(run: WatchedRun, choice: str) -> frozenset[str]:
    """The texts that belong to a choice: itself; of a step, what it brings and ends; of a fact,
    the steps that bring or end it.
    """
    if not choice:
        return frozenset()
    texts = {choice}
    for step in run.plan.get("steps", ()):
        facts = {*step.get("adds", ()), *step.get("ends", ()), *step.get("events", ())}
        if step["step"] == choice:
            texts |= facts
        elif choice in facts:
            texts.add(step["step"])
    return frozenset(texts)


def names_any(texts: Iterable[str], cells: Iterable[str]) -> bool:
    """Whether some cell of a row is one of the texts, or names it."""
    patterns = [re.compile(rf"(?<!\w){re.escape(text)}(?!\w)") for text in texts]
    return any(pattern.search(cell) for cell in cells for pattern in patterns)


def steps_of(run: WatchedRun, choice: str) -> frozenset[str]:
    """The steps of the plan, and those before it, that belong to a choice."""
    texts = related_texts(run, choice)
    known = {plan_step.step for plan_step in (*run.past, *run.bars.values())}
    return (
        frozenset(step for step in known if step in texts or names_any([choice], [step]))
        if choice
        else frozenset()
    )


def told_of(run: WatchedRun, choice: str) -> list[str]:
    """What a page tells of a choice: of a step, what it waits for and brings; of a fact, since
    when; of an object, what was done to it.
    """
    if not choice:
        return []
    if (lines := _of_step(run, choice)) is not None:
        return lines
    lines = []
    if choice in run.holds:
        number = run.holds[choice]
        lines.append(f"holds since record {number}" if number else "held at the start")
    lines += [
        f"goal: {goal}, {stands}"
        for goal, stands in run.goals.items()
        if names_any([choice], [goal])
    ]
    lines += [
        _of_finding(finding)
        for finding in run.findings
        if choice in (finding.get("action"), finding.get("exception"))
    ]
    steps = sorted(steps_of(run, choice))
    lines += (
        [f"in {count_noun(len(steps), 'step')} of the plan: {', '.join(steps[:6])}"]
        if steps
        else []
    )
    done = [
        history["action"]
        for history in run.histories
        if names_any([choice], [history["action"], *history["adds"]])
    ]
    lines += [f"done: {', '.join(done[-6:])}"] if done else []
    return lines or ["nothing of this name is in the plan, the world or the diagnosis"]


def step_about(run: WatchedRun, choice: str) -> int | None:
    """The id of the step of the plan that is chosen, or that brings the fact that is chosen;
    None if there is none.
    """
    steps = run.plan.get("steps", ()) if choice else ()
    brings = (step for step in steps if choice in (*step.get("adds", ()), *step.get("events", ())))
    chosen_step = next((step for step in steps if step["step"] == choice), None) or next(
        brings, None
    )
    return None if chosen_step is None else int(chosen_step["id"])


def _of_finding(each: dict[str, Any]) -> str:
    """What a test or a repair was for, and what came of it; how an exception showed, or what
    was its cause.
    """
    outcome = (
        each.get("outcome")
        or each.get("reply")
        or ", ".join(name for name, _ in each.get("causes", ()))
    )
    return f"{each['kind']} of {each['exception']}: {outcome}"


def _of_step(run: WatchedRun, step: str) -> list[str] | None:
    steps = {plan_step["id"]: plan_step for plan_step in run.plan.get("steps", ())}
    chosen_step = next(
        (plan_step for plan_step in steps.values() if plan_step["step"] == step), None
    )
    if chosen_step is None:
        return None
    after = [steps[number]["step"] for number in chosen_step.get("after", ()) if number in steps]
    before = [
        plan_step["step"]
        for plan_step in steps.values()
        if chosen_step["id"] in plan_step.get("after", ())
    ]
    bar = run.bars.get(chosen_step["id"])
    stands = f", {bar.standing}" if bar is not None else ""
    stands += (
        f", begins {begin_text(ahead[chosen_step['id']])}"
        if chosen_step["id"] in (ahead := run.ahead())
        else ""
    )
    lines = [
        f"step {chosen_step['id']}{stands}",
        f"device: {chosen_step['stream']}, says: {chosen_step.get('says', '')}",
    ]
    lines += [
        f"waits for: {', '.join(after) or 'nothing'}",
        f"goes before: {', '.join(before) or 'nothing'}",
    ]
    brings = [*chosen_step.get("adds", ()), *chosen_step.get("events", ())]
    lines += [f"brings: {', '.join(brings) or 'nothing'}"]
    return [*lines, f"holds: {', '.join(chosen_step.get('resources', ())) or 'nothing'}"]
