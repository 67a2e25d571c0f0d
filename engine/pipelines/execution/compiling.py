"""From a timetable to the program of the executive, and what each of its steps will change in the world model."""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property, partial

from cellwright.engine.model.stays import Stay
from cellwright.engine.stages.execution import Activity, Dwell, Program
from cellwright.engine.stages.macros.lifted.execution import changes_of
from cellwright.engine.stages.macros.lifted.situation import Situation
from cellwright.engine.stages.macros.lifted.world import CellDomain, StepChange
from cellwright.engine.stages.scheduling.blocks import Unstructured, arm_of, mentions
from cellwright.kb.model.conditions import Literal, goal_parts
from cellwright.kb.model.domain import Command, Domain, Operator
from cellwright.kb.model.plan import Plan, Step, StepId
from cellwright.kb.model.problem import Problem
from cellwright.kb.model.workflow import reaches
from cellwright.kb.syntax import SECONDS
from cellwright.kb.terms import Atom, Function, Term, parts_of, substitute

PATIENCE = 2  # a reply may take so many times the forecast
GRACE_MS = 30_000  # and so much longer
PERSON = "person"  # the stream of steps for a person


@dataclass(frozen=True)
class Compiled:
    """A program, the plan behind it, and what each step changes, in whatever of the plan's orders they are done.

    Steps that interfere are ordered, so what one of them changes does not depend on the others' order. `planned` gives the plan:
    a run that goes on from its journal reads it only when something needs it.
    """

    program: Program
    planned: Callable[[], Plan]
    changes: Mapping[int, StepChange]
    expects: Mapping[int, Term] = field(default_factory=dict)
    results: Mapping[int, Term] = field(default_factory=dict)

    @cached_property
    def plan(self) -> Plan:
        """The plan behind the program."""
        return self.planned()


def unit_ms(domain: Domain) -> Fraction:
    """The milliseconds of a domain's unit of time."""
    return Fraction(SECONDS[domain.time_unit]) * 1000


def compiled(
    problem: Problem,
    plan: Plan,
    starts: Mapping[StepId, int],
    begin_ms: int = 0,
    stays: Iterable[Stay] = (),
    timed: bool = False,
    situation: Situation | None = None,
) -> Compiled:
    """The program of a plan from the problem's initial state on. Forecast starts count from `begin_ms`."""
    unit = unit_ms(problem.domain)
    here = situation or situation_of(problem)
    ordered = tuple(plan.steps)
    changes = {int(s.id): c for s, c in zip(ordered, changes_of(here, ordered), strict=True)}
    rests = resting(problem, ordered, changes, here)
    operators = {each.name: each for each in problem.domain.operators}
    hands = hands_of(problem, ordered)
    activities, expects, results = {}, {}, {}
    for step in sorted(ordered, key=lambda each: starts[each.id]):
        number, operator = int(step.id), operators.get(step.operator.name)
        command = _command(operator, step)
        expects[number] = command.reply
        if command.result is not None:
            results[number] = command.result
        begins = begin_ms + int(starts[step.id] * unit)
        made = _activity(step, operator, command, begins, int(step.duration * unit))
        process = bool(hands) and not hands.intersection(made.resources)
        activities[number] = replace(made, rests=number in rests, process=process)
    dwells = tuple(
        dict.fromkeys(Dwell(int(s.source), int(s.target), int(s.most * unit), s.since_ms) for s in stays)
    )
    program = Program(activities, dwells, timed, hands=hands)
    return Compiled(program, partial(_known, plan), changes, expects, results)


def _known(plan: Plan) -> Plan:
    """A plan that need not be read. It has a name so that a program can be sent to another process."""
    return plan


def _activity(
    step: Step, operator: Operator | None, command: Command, begins_ms: int, lasts_ms: int
) -> Activity:
    """What the executive knows of a step by itself."""
    stream = stream_of(command.stream, step)
    looks, watches = looks_of(operator, step)
    return Activity(
        int(step.id),
        str(step.operator),
        stream,
        lasts_ms,
        tuple(map(int, step.after)),
        tuple(map(str, step.resources)),
        begins_ms,
        PATIENCE * lasts_ms + GRACE_MS,
        _says(command.stream, stream),
        str(command.reply),
        asks=stream.partition("(")[0] == PERSON,
        looks=looks,
        watches=watches,
    )


def alone(domain: Domain, step: Step) -> tuple[Activity, Term]:
    """A step that belongs to no program, as an activity, and the pattern of a normal reply to it."""
    operator = next((each for each in domain.operators if each.name == step.operator.name), None)
    command = _command(operator, step)
    return _activity(step, operator, command, 0, int(step.duration * unit_ms(domain))), command.reply


def queued(compiled: Compiled, lookahead: Callable[[str], int]) -> Compiled:
    """The program with the queues that devices have. `lookahead` tells how many commands a stream takes at once."""
    program = compiled.program
    streams = {a.stream for a in program.activities.values() if not a.process}
    depths = {stream: lookahead(stream) for stream in sorted(streams)}
    queues = {stream: depth for stream, depth in depths.items() if depth > 1}
    return replace(compiled, program=replace(program, lookahead=queues))


def situation_of(problem: Problem, state: Collection[Atom] | None = None) -> Situation:
    """The situation in which a problem begins."""
    from cellwright.engine.pipelines.gate import PlanGate

    facts = PlanGate().semantics(problem).initial() if state is None else state
    return Situation.of(CellDomain(problem), facts)


def hands_of(problem: Problem, steps: Sequence[Step]) -> frozenset[str]:
    """The resources that work as hands: those of the type of the one that most steps hold."""
    try:
        arm = str(arm_of(steps))
    except Unstructured:
        return frozenset()
    types = {**problem.domain.objects, **problem.objects}
    held = {str(resource) for step in steps for resource in step.resources}
    return frozenset({arm} | {each for each in held if each in types and types[each] == types.get(arm)})


def full_hands(problem: Problem, steps: Sequence[Step], state: Collection[Atom]) -> frozenset[str]:
    """The hands of a plan that hold one of its things in a state."""
    grip = _Grip.of(problem, steps)
    return grip.full(grip.held(state))


def resting(
    problem: Problem, steps: Sequence[Step], changes: Mapping[int, StepChange], here: Situation
) -> frozenset[int]:
    """The steps after which none of their hands holds anything, and those that reach a goal."""
    grip = _Grip.of(problem, steps)
    goals = [part.atom for part in goal_parts(problem.goal) if isinstance(part, Literal) and part.positive]
    goals += [part for chain in problem.chains for stage in chain.stages for part in parts_of(stage)]
    holding = grip.held(here.state)
    found = set()
    for step in steps:
        change = changes[int(step.id)]
        holding = (holding - set(change.ends)) | grip.held(change.adds)
        added = (*change.adds, *change.events)
        reached = any(reaches(atom, goal) for atom in added for goal in goals if atom.name == goal.name)
        if reached or grip.full(holding).isdisjoint(map(str, step.resources)):
            found.add(int(step.id))
    return frozenset(found)


@dataclass(frozen=True, slots=True)
class _Grip:
    """The hands of a plan, and the things that they can hold: whatever else its steps hold."""

    hands: frozenset[Term]
    things: frozenset[Term]

    @classmethod
    def of(cls, problem: Problem, steps: Sequence[Step]) -> "_Grip":
        """The hands and the things of a plan."""
        hands = frozenset(Function(name) for name in hands_of(problem, steps))
        return cls(hands, frozenset(each for step in steps for each in step.resources) - hands)

    def held(self, atoms: Iterable[Atom]) -> frozenset[Atom]:
        """Those of the facts that say that a thing is in a hand."""
        return frozenset(
            atom
            for atom in atoms
            if any(mentions(atom, hand) for hand in self.hands)
            and any(mentions(atom, each) for each in self.things)
        )

    def full(self, holding: Collection[Atom]) -> frozenset[str]:
        """The hands that these facts are about."""
        return frozenset(str(hand) for hand in self.hands if any(mentions(atom, hand) for atom in holding))


def stream_of(said: Term, step: Step) -> str:
    """The stream of a command: its name, with the arguments that the step holds, which say which device it is.

    What else is in brackets is what the device is told: `path_planner(Arm)` is a device for each arm, `arm(open_drawer)` is not.
    """
    if not isinstance(said, Function):
        return str(said)
    devices = tuple(each for each in said.arguments if each in step.resources)
    return str(Function(said.name, devices))


def looks_of(operator: Operator | None, step: Step) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The facts that a step's device looks at before it begins, and those that it watches then."""
    if operator is None or not operator.online:
        return (), ()
    known = dict(zip(operator.variables, step.operator.arguments, strict=True))
    facts = [(str(substitute(each.fact, known)), each.during) for each in operator.online]
    return tuple(fact for fact, _ in facts), tuple(fact for fact, during in facts if during)


def _says(said: Term, stream: str) -> str:
    """What the device is told beside its name."""
    if not isinstance(said, Function):
        return ""
    return ", ".join(str(each) for each in said.arguments if str(each) not in stream)


def _command(operator: Operator | None, step: Step) -> Command:
    """The command of a step; where the domain declares none, its first resource is the device, and the step what it is told."""
    if operator is None or operator.command is None:
        device = step.resources[0] if step.resources else Function("cell")
        return Command(Function(str(device), (step.operator,)), Function("done"))
    known = dict(zip(operator.variables, step.operator.arguments, strict=True))
    said = operator.command
    result = substitute(said.result, known) if said.result is not None else None
    return replace(
        said, stream=substitute(said.stream, known), reply=substitute(said.reply, known), result=result
    )
