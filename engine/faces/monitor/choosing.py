"""What is chosen on a page, a step, a fact, an object or a command, and what belongs to it in every view."""

import re
from collections.abc import Iterable
from typing import Any

from cellwright.engine.faces.monitor.following import Watched
from cellwright.engine.formats.report.standing import begins
from cellwright.engine.model.wording import counted


def related(run: Watched, choice: str) -> frozenset[str]:
    """The texts that belong to a choice: itself; of a step, what it brings and ends; of a fact, the steps that bring or end it."""
    if not choice:
        return frozenset()
    found = {choice}
    for each in run.plan.get("steps", ()):
        facts = {*each.get("adds", ()), *each.get("ends", ()), *each.get("events", ())}
        if each["step"] == choice:
            found |= facts
        elif choice in facts:
            found.add(each["step"])
    return frozenset(found)


def mentions(texts: Iterable[str], cells: Iterable[str]) -> bool:
    """Whether some cell of a row is one of the texts, or names it."""
    patterns = [re.compile(rf"(?<!\w){re.escape(each)}(?!\w)") for each in texts]
    return any(pattern.search(cell) for cell in cells for pattern in patterns)


def steps_of(run: Watched, choice: str) -> frozenset[str]:
    """The steps of the plan, and those before it, that belong to a choice."""
    texts = related(run, choice)
    known = {each.step for each in (*run.past, *run.bars.values())}
    return (
        frozenset(each for each in known if each in texts or mentions([choice], [each]))
        if choice
        else frozenset()
    )


def told_of(run: Watched, choice: str) -> list[str]:
    """What a page tells of a choice: of a step, what it waits for and brings; of a fact, since when; of an object, what was done to it."""
    if not choice:
        return []
    if (lines := _of_step(run, choice)) is not None:
        return lines
    lines = []
    if choice in run.holds:
        number = run.holds[choice]
        lines.append(f"holds since record {number}" if number else "held at the start")
    lines += [f"goal: {goal}, {stands}" for goal, stands in run.goals.items() if mentions([choice], [goal])]
    lines += [
        _of_finding(each) for each in run.findings if choice in (each.get("action"), each.get("exception"))
    ]
    steps = sorted(steps_of(run, choice))
    lines += [f"in {counted(len(steps), 'step')} of the plan: {', '.join(steps[:6])}"] if steps else []
    done = [each["action"] for each in run.histories if mentions([choice], [each["action"], *each["adds"]])]
    lines += [f"done: {', '.join(done[-6:])}"] if done else []
    return lines or ["nothing of this name is in the plan, the world or the diagnosis"]


def step_about(run: Watched, choice: str) -> int | None:
    """The id of the step of the plan that is chosen, or that brings the fact that is chosen; None if there is none."""
    steps = run.plan.get("steps", ()) if choice else ()
    brings = (each for each in steps if choice in (*each.get("adds", ()), *each.get("events", ())))
    found = next((each for each in steps if each["step"] == choice), None) or next(brings, None)
    return None if found is None else int(found["id"])


def _of_finding(each: dict[str, Any]) -> str:
    """What a test or a repair was for, and what came of it; how an exception showed, or what was its cause."""
    outcome = (
        each.get("outcome") or each.get("reply") or ", ".join(name for name, _ in each.get("causes", ()))
    )
    return f"{each['kind']} of {each['exception']}: {outcome}"


def _of_step(run: Watched, step: str) -> list[str] | None:
    steps = {each["id"]: each for each in run.plan.get("steps", ())}
    found = next((each for each in steps.values() if each["step"] == step), None)
    if found is None:
        return None
    after = [steps[each]["step"] for each in found.get("after", ()) if each in steps]
    before = [each["step"] for each in steps.values() if found["id"] in each.get("after", ())]
    bar = run.bars.get(found["id"])
    stands = f", {bar.standing}" if bar is not None else ""
    stands += f", begins {begins(ahead[found['id']])}" if found["id"] in (ahead := run.ahead()) else ""
    lines = [f"step {found['id']}{stands}", f"device: {found['stream']}, says: {found.get('says', '')}"]
    lines += [f"waits for: {', '.join(after) or 'nothing'}", f"goes before: {', '.join(before) or 'nothing'}"]
    brings = [*found.get("adds", ()), *found.get("events", ())]
    lines += [f"brings: {', '.join(brings) or 'nothing'}"]
    return [*lines, f"holds: {', '.join(found.get('resources', ())) or 'nothing'}"]
