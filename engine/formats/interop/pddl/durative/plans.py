"""Reads and writes plans with times in the format of the planning competitions: `0.000: (move a b)
[5.000]`.
"""

import json
import re
from fractions import Fraction
from pathlib import Path

from cellwright.engine.formats.interop.pddl.durative import TemporalTask
from cellwright.engine.formats.interop.pddl.task_files import PLAN, require_file
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, nearest_hint
from cellwright.kb.files import File, read_file
from cellwright.kb.model.durative import TimedPlan, TimedStep, decimals
from cellwright.kb.terms import Function

_LINE = re.compile(
    r"^\s*(?P<start>[0-9]+(?:\.[0-9]*)?)\s*:\s*\(?(?P<words>[^()\[\];]+)\)?\s*"
    r"(?:\[\s*(?:d:\s*)?(?P<length>[0-9]+(?:\.[0-9]*)?)\s*(?:;[^\]]*)?\])?\s*(?:;.*)?$",
    re.IGNORECASE,
)


def write_timed_plan(task: TemporalTask, plan: TimedPlan) -> str:
    """The steps with their starts and durations, and the makespan."""
    instantaneous = {action.name for action in task.problem.actions if action.instantaneous}
    lines = []
    for step in plan.steps:
        length = "" if step.action.name in instantaneous else f" [{decimals(step.duration)}]"
        lines.append(
            f"{decimals(step.start)}: ({' '.join(timed_words(task, step.action))}){length}"
        )
    return "\n".join([*lines, f"; makespan = {decimals(plan.makespan)}"]) + "\n"


def timed_words(task: TemporalTask, action: Function) -> list[str]:
    """The name and the objects of an instance, as the PDDL files write them."""
    objects = (task.names.original("object", str(argument)) for argument in action.arguments)
    return [task.names.original("operator", action.name), *objects]


def read_timed_plan(task: TemporalTask, path: Path) -> TimedPlan:
    """The plan in a file. Raises `InvalidInput` if a line is not an action of the task with its
    time.
    """
    file = read_file(path)
    require_file(file, PLAN)
    if file.text.lstrip().startswith("{"):
        file = File.of(file.path, _lines_of_json(file))
    wrong: list[Diagnostic] = []
    steps: list[TimedStep] = []
    offset = 0
    for line in file.text.splitlines(keepends=True):
        if line.split(";", 1)[0].strip():
            step = _step(task, line.rstrip("\r\n"), file, offset, wrong)
            steps += [step] if step else []
        offset += len(line)
    if wrong:
        raise InvalidInput(wrong)
    return TimedPlan(tuple(sorted(steps, key=lambda step: step.start)))


def _lines_of_json(file: File) -> str:
    """The lines of a plan in the JSON that `plan` writes. Raises `InvalidInput` for other JSON."""
    try:
        content = json.loads(file.text, parse_float=str, parse_int=str)
        steps = content.get("data", content)["steps"]
        return "".join(
            f"{step['start']}: {step['action']} [{step['duration']}]\n" for step in steps
        )
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        hint = "plan --pddl --format json writes one"
        raise InvalidInput(
            [Diagnostic(file.at(0), "K402", "this is no plan with times", hint)]
        ) from error


def _step(
    task: TemporalTask, line: str, file: File, offset: int, wrong: list[Diagnostic]
) -> TimedStep | None:
    read = _LINE.match(line)
    if read is None:
        hint = "write 0.000: (move a b) [5.000]"
        wrong.append(
            Diagnostic(
                file.at(offset),
                "K801",
                "a step with times is a time, an action and a duration",
                hint,
            )
        )
        return None
    name, *objects = read["words"].lower().split()
    actions = {
        task.names.original("operator", action.name): action for action in task.problem.actions
    }
    action = actions.get(name)
    if action is None:
        wrong.append(
            Diagnostic(
                file.at(offset),
                "K101",
                f"unknown action '{name}'",
                nearest_hint(name, list(actions)),
            )
        )
        return None
    if len(action.parameters) != len(objects):
        said = f"{name} takes {len(action.parameters)} arguments, not {len(objects)}"
        wrong.append(Diagnostic(file.at(offset), "K102", said))
        return None
    if read["length"] is None and not action.instantaneous:
        hint = "write it after the action: [5.000]"
        wrong.append(Diagnostic(file.at(offset), "K801", f"{name} lacks its duration", hint))
        return None
    arguments = tuple(Function(task.names.of("object", word)) for word in objects)
    start, length = Fraction(read["start"]), Fraction(read["length"] or 0)
    return TimedStep(start, Function(action.name, arguments), length)
