"""`cellwright run` and `cellwright resume`: carry out a plan in a cell, real or simulated, to the end."""

import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from engine.faces.cli.answers import Answer, Form, give
from engine.faces.cli.exits import FINDINGS, STOPPED, exit_code
from engine.faces.cli.options import Command, Expansions, Format, Goals, Seed, Target, number
from engine.faces.cli.watch import current

if TYPE_CHECKING:
    from engine.model.execution import Finish, Record
    from engine.pipelines.execution.recorder import Watcher
    from engine.pipelines.moves.planning import Moving
    from engine.stages.planning import Limits
    from kb.model.problem import Problem

DriverName = Annotated[str, typer.Option("--driver", help="who carries out the commands: sim, or a plug-in")]
Store = Annotated[
    str,
    typer.Option(
        "--store",
        envvar="CELLWRIGHT_STORE",
        help="where the journal is kept: a file, or postgresql://USER@HOST/DATABASE",
    ),
]
Name = Annotated[
    str, typer.Option("--name", help="the name of the run; if not given, that of the problem and a number")
]
Factor = Annotated[
    float,
    typer.Option(
        min=0,
        callback=number,
        help="the share of real time that simulated time takes: 0 at once, 1 in real time",
    ),
]
Faults = Annotated[
    list[str] | None,
    typer.Option(
        "--fault",
        help="simulate a fault: STEP=CAUSE, STEP being a number, an operator or a whole step; may be repeated",
    ),
]
Options = Annotated[
    list[str] | None,
    typer.Option(
        "--option", help="an option of the driver: NAME=VALUE (sim: spread=0.2, lookahead=4, log=FILE)"
    ),
]
Approve = Annotated[bool, typer.Option("--approve", help="show the plan and ask before anything moves")]
Events = Annotated[
    str, typer.Option("--events", help="write each event as a line of JSON to this file; - is the output")
]
Watch = Annotated[
    bool,
    typer.Option(
        "--watch",
        help="show how the run goes: on a terminal with --factor a live display with keys, else plain lines",
    ),
]
Motion = Annotated[
    bool,
    typer.Option(
        "--motion", help="plan with the motion of the arm in every step, and the time that it takes"
    ),
]


def run(
    target: Target,
    driver: DriverName = "sim",
    store: Store = "",
    name: Name = "",
    goals: Goals = "",
    command: Command = "",
    factor: Factor = 0.0,
    fault: Faults = None,
    option: Options = None,
    approve: Approve = False,
    events: Events = "",
    watch: Watch = False,
    motion: Motion = False,
    expansions: Expansions = 1_000_000,
    seed: Seed = 0,
    format: Format = Form.TEXT,
) -> None:
    """Plan TARGET, carry the plan out, handle what goes wrong, and go on until the goals are reached."""
    asked = Asked(target, goals, command, driver, store, name, factor, seed, approve, expansions, motion)
    if events == "-" and format is Form.JSON:
        raise typer.BadParameter("--events - writes lines of JSON to the output: leave out --format json")
    give(lambda: _run(asked, fault or [], option or [], events, watch), format)


@dataclass(frozen=True, slots=True)
class Asked:
    """What is to be run, as it was typed."""

    target: str
    goals: str
    command: str
    driver: str
    store: str
    name: str
    factor: float
    seed: int
    approve: bool
    expansions: int
    motion: bool


def default_store() -> str:
    """The journal of those who name none: in the folder for the state of programs."""
    import os

    folder = Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state") / "cellwright"
    folder.mkdir(parents=True, exist_ok=True)
    return str(folder / "runs.db")


def _run(asked: Asked, faults: Sequence[str], options: Sequence[str], events: str, shown: bool) -> Answer:
    from engine.pipelines.execution import Wanted, begin, named
    from engine.pipelines.planning import problem_of
    from engine.stages.planning import Limits

    problem = problem_of(asked.target, asked.goals, asked.command)
    store = asked.store or default_store()
    given = options_of(options) | ({"fault": "; ".join(faults)} if faults else {})
    wanted = Wanted(
        asked.target, asked.goals, asked.command, asked.driver, store, asked.name, asked.seed, asked.factor, given,
        asked.approve,
    )  # fmt: skip
    wanted = named(wanted, problem)
    if shown:
        from engine.faces.cli.terminal import say
        from engine.formats.report.narration import understood

        say("\n".join(understood(problem)) + "\n")
    limits, table = Limits(asked.expansions, seed=asked.seed), None
    if asked.motion:
        moving = _moving(asked, problem, limits, wanted.store)
        if moving.run.timetable is None:
            return answer_of(moving.run.outcome, wanted.store, events == "-")
        problem, table = moving.problem, moving.run.timetable
    with Watching(wanted.run, wanted.store, events, asked.approve, shown, asked.factor) as watch:
        ending = begin(wanted, problem, watch.channel, watch.watchers, limits, table=table)
    return answer_of(ending, wanted.store, events == "-")


def _moving(asked: Asked, problem: "Problem", limits: "Limits", store: str) -> "Moving":
    """The plan in which every step moves. The poses of measurements are kept in the store."""
    from engine.pipelines import objective
    from engine.pipelines.poses.planning import plan_with_poses
    from engine.plugins import geometry_backend
    from kb.loader.cell import cell_of

    cell, backend = cell_of(asked.target), geometry_backend()
    return plan_with_poses(
        problem, cell, backend, lambda each: objective.plan(each, limits), asked.seed, store
    ).moving


def options_of(given: Sequence[str]) -> dict[str, str]:
    """The options of a driver from NAME=VALUE."""
    found = {}
    for each in given:
        name, equals, value = each.partition("=")
        if not equals:
            raise typer.BadParameter(f"--option {each}: write NAME=VALUE")
        found[name.strip()] = value.strip()
    return found


class Watching:
    """What watches a run from this process: its events, and the orders of the terminal (Ctrl-C) and of the socket."""

    def __init__(
        self, run: str, store: str, events: str, approve: bool, shown: bool = False, factor: float = 0.0
    ) -> None:
        from engine.pipelines.execution.channel import Channel

        self.channel: Channel = Channel(run, store)
        self._events, self._approve, self._run = events, approve, run
        self._state: dict[str, Any] = {"run": run, "phase": "ready", "at_ms": 0}
        self._out: Any = None
        self._before: Any = None
        self._presses = 0
        self._shown, self._factor = shown, factor
        self._display = ExitStack()
        self._look: list[Watcher] = []

    @property
    def watchers(self) -> "Sequence[Watcher]":
        """What is shown each record once it is on the disk."""
        return [self._follow, *self._look]

    def __enter__(self) -> "Watching":
        import signal

        self.channel.__enter__()
        self.channel.tells(lambda: self._state)
        if self._events:
            self._out = sys.stdout if self._events == "-" else Path(self._events).open("w", encoding="utf-8")
        self._before = signal.signal(signal.SIGINT, self._pressed)
        if watch := current():
            watch.waiting, watch.time_is_up = True, self._stop
        if self._shown:
            from engine.faces.cli.watching import watched

            self._look.append(self._display.enter_context(watched(self._run, self._tell, self._factor)))
        return self

    def _tell(self, order: str) -> None:
        from engine.model.execution import Order
        from engine.pipelines.execution import Given

        self.channel.give(Given(Order(order), "", "terminal"))

    def __exit__(self, *error: object) -> None:
        import signal

        self._display.close()
        signal.signal(signal.SIGINT, self._before)
        if watch := current():
            watch.waiting = False
        if self._out is not None and self._events != "-":
            self._out.close()
        self.channel.__exit__(None, None, None)

    def _stop(self) -> None:
        from engine.model.execution import Order
        from engine.pipelines.execution import Given

        self.channel.give(Given(Order.STOP, "", "time limit"))

    def _pressed(self, *_: object) -> None:
        """The first Ctrl-C interrupts, the second stops."""
        from engine.model.execution import Order
        from engine.pipelines.execution import Given

        self._presses += 1
        self.channel.give(Given(Order.INTERRUPT if self._presses == 1 else Order.STOP, "", "terminal"))
        said = "pauses at the end of the current goal; Ctrl-C again stops at once; "
        sys.stderr.write(
            f"\n{said}go on with: cellwright continue {self._run}\n" if self._presses == 1 else "\nstops\n"
        )

    def _follow(self, record: "Record") -> None:
        from engine.model.execution import RecordKind

        self._state["at_ms"] = record.at_ms
        if record.kind is RecordKind.PHASE:
            self._state["phase"] = record.content["phase"]
        if record.kind is RecordKind.PLAN:
            self._state["phase"] = "running"
            if self._approve and record.content["why"] == "first":
                self._ask(record)
        if self._out is not None:
            import json

            from kb.diagnostics import escaped

            self._out.write(escaped(json.dumps(record.entry(self._run), ensure_ascii=False)) + "\n")
            self._out.flush()

    def _ask(self, record: "Record") -> None:
        """Show the plan, and ask the person at the terminal; without one, somebody else has to approve it."""
        from engine.faces.cli.terminal import say
        from engine.model.execution import Order
        from engine.pipelines.execution import Given

        for step in record.content["steps"]:
            start, lasts = step.get("start_ms", 0) / 1000, step.get("lasts_ms", 0) / 1000
            say(f"{start:>10.1f} s {lasts:>8.1f} s  {step['stream']:<16} {step['step']}\n")
        if not sys.stdin.isatty():
            sys.stderr.write(f"waits for: cellwright approve {self._run}\n")
            return
        sys.stderr.write("carry this out? [y/n] ")
        sys.stderr.flush()
        said = sys.stdin.readline().strip().lower()
        self.channel.give(Given(Order.APPROVE if said in ("y", "yes") else Order.ABORT, "", "terminal"))


def answer_of(ending: "Finish | Any", store: str, quiet: bool) -> Answer:
    """What is printed at the end of a run."""
    from engine.formats.report import execution as report
    from engine.formats.report.json import status
    from engine.pipelines.execution import Finish

    if not isinstance(ending, Finish):
        from rich.text import Text

        said = Text(f"No plan: {ending.reason}.")
        return Answer(status(ending), {"reason": ending.reason}, lambda: said, exit_code(ending))
    code = {"reached": 0, "partly": FINDINGS}.get(ending.outcome, STOPPED)
    text = None if quiet else lambda: report.text(ending, store)
    return Answer(ending.outcome, report.entry(ending), text, code)
