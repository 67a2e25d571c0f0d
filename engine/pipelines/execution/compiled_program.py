"""Program of the executive: compiled from a timetable, with what each step changes in the world."""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property, partial

from cellwright.engine.model.start_rules import NO_RULES, StartRules
from cellwright.engine.model.time_limits import Stay
from cellwright.engine.pipelines import planning
from cellwright.engine.stages.execution import Activity, ActivityProgram, Dwell
from cellwright.engine.stages.lifted.cell_domain import CellDomain, Situation, StepChange
from cellwright.engine.stages.lifted.lifted_execution import changes_of
from cellwright.engine.stages.scheduling.plan_blocks import (
    Unstructured,
    arm_resource,
    contains_term,
)
from cellwright.kb.model.conditions import Literal, goal_parts
from cellwright.kb.model.domain_model import Command, Domain, Operator
from cellwright.kb.model.operator_amounts import range_of_step
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem, reaches_stage
from cellwright.kb.syntax import SECONDS_PER_UNIT
from cellwright.kb.terms import Atom, Function, Term, stage_parts, substitute_term

TIMEOUT_FACTOR = 2  # a reply may take so many times the forecast
GRACE_MS = 30_000  # and so much longer
PERSON_STREAM = "person"  # the stream of steps for a person


@dataclass(frozen=True)
class CompiledProgram:
    """A program, the plan behind it, and what each step changes, in whatever of the plan's orders
    they are done.

    Steps that interfere are ordered, so what one of them changes does not depend on the others'
    order. `planned` gives the plan: a run that goes on from its journal reads it only when
    something needs it.
    """

    program: ActivityProgram
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
    return Fraction(SECONDS_PER_UNIT[domain.time_unit]) * 1000


def compile_plan(
    problem: Problem,
    plan: Plan,
    starts: Mapping[StepId, int],
    begin_ms: int = 0,
    stays: Iterable[Stay] = (),
    timed: bool = False,
    situation: Situation | None = None,
    rules: StartRules = NO_RULES,
) -> CompiledProgram:
    """The program of a plan from the problem's initial state on.

    Forecast starts count from `begin_ms`. With the `rules` of a policy, steps begin by these.
    """
    unit = unit_ms(problem.domain)
    start = situation or initial_situation(problem)
    ordered = tuple(plan.steps)
    changes = {int(s.id): c for s, c in zip(ordered, changes_of(start, ordered), strict=True)}
    rests = resting_steps(problem, ordered, changes, start)
    operators = {operator.name: operator for operator in problem.domain.operators}
    hands, longest = hands_of(problem, ordered), _longest_durations(problem, ordered)
    activities, expects, results = {}, {}, {}
    for step in sorted(ordered, key=lambda plan_step: starts[plan_step.id]):
        number, operator = int(step.id), operators.get(step.operator.name)
        command = _command_of(operator, step)
        expects[number] = command.reply
        if command.result is not None:
            results[number] = command.result
        begins = begin_ms + int(starts[step.id] * unit)
        activity = _activity_of(step, operator, command, begins, int(step.duration * unit))
        process = bool(hands) and not hands.intersection(activity.resources)
        activities[number] = replace(
            activity,
            rests=number in rests,
            process=process,
            rule=rules[number].scaled(unit, begin_ms) if number in rules else None,
        )
        if step.id in longest:
            activities[number] = _with_longest(activities[number], int(longest[step.id] * unit))
    dwells = tuple(
        dict.fromkeys(
            Dwell(int(s.source), int(s.target), int(s.most * unit), s.since_ms, s.thing, s.place)
            for s in stays
        )
    )
    program = ActivityProgram(activities, dwells, timed and not rules, hands=hands)
    return CompiledProgram(program, partial(_known_plan, plan), changes, expects, results)


def _longest_durations(problem: Problem, steps: Sequence[Step]) -> dict[StepId, int]:
    """How long steps may last that have ranges, in the domain's unit of time."""
    varying = {operator.name for operator in problem.domain.operators if operator.varies}
    if not varying:
        return {}
    amounts = planning.PlanGate().semantics(problem).amounts
    return {
        step.id: range_of_step(amounts, step).most
        for step in steps
        if step.operator.name in varying
    }


def _with_longest(activity: Activity, longest_ms: int) -> Activity:
    """An activity that may last so long, and counts as failed some time after that."""
    late_ms = TIMEOUT_FACTOR * max(longest_ms, activity.lasts_ms) + GRACE_MS
    return replace(activity, longest_ms=longest_ms, timeout_ms=late_ms)


def _known_plan(plan: Plan) -> Plan:
    """A plan that need not be read.

    It has a name so that a program can be sent to another process.
    """
    return plan


def _activity_of(
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
        TIMEOUT_FACTOR * lasts_ms + GRACE_MS,
        _device_text(command.stream, stream),
        str(command.reply),
        asks=stream.partition("(")[0] == PERSON_STREAM,
        looks=looks,
        watches=watches,
    )


def activity_alone(domain: Domain, step: Step) -> tuple[Activity, Term]:
    """A step that belongs to no program, as an activity, and the pattern of a normal reply to
    it.
    """
    operator = next(
        (candidate for candidate in domain.operators if candidate.name == step.operator.name), None
    )
    command = _command_of(operator, step)
    return _activity_of(
        step, operator, command, 0, int(step.duration * unit_ms(domain))
    ), command.reply


def with_queues(compiled: CompiledProgram, lookahead: Callable[[str], int]) -> CompiledProgram:
    """The program with the queues that devices have.

    `lookahead` tells how many commands a stream takes at once. A program that follows a policy
    sends each command when it may begin: a device that begins by itself knows no policy.
    """
    program = compiled.program
    if program.follows_rules:
        return compiled
    streams = {a.stream for a in program.activities.values() if not a.process}
    depths = {stream: lookahead(stream) for stream in sorted(streams)}
    queues = {stream: depth for stream, depth in depths.items() if depth > 1}
    return replace(compiled, program=replace(program, lookahead=queues))


def initial_situation(problem: Problem, state: Collection[Atom] | None = None) -> Situation:
    """The situation in which a problem begins."""
    facts = planning.PlanGate().semantics(problem).initial() if state is None else state
    return Situation.of(CellDomain(problem), facts)


def hands_of(problem: Problem, steps: Sequence[Step]) -> frozenset[str]:
    """The resources that work as hands: those of the type of the one that most steps hold."""
    try:
        arm = str(arm_resource(steps))
    except Unstructured:
        return frozenset()
    types = {**problem.domain.objects, **problem.objects}
    resources_held = {str(resource) for step in steps for resource in step.resources}
    return frozenset(
        {arm}
        | {
            resource
            for resource in resources_held
            if resource in types and types[resource] == types.get(arm)
        }
    )


def full_hands(problem: Problem, steps: Sequence[Step], state: Collection[Atom]) -> frozenset[str]:
    """The hands of a plan that hold one of its things in a state."""
    grip = _HandsOfPlan.of(problem, steps)
    return grip.full(grip.held(state))


def resting_steps(
    problem: Problem, steps: Sequence[Step], changes: Mapping[int, StepChange], here: Situation
) -> frozenset[int]:
    """The steps after which none of their hands holds anything, and those that reach a goal."""
    grip = _HandsOfPlan.of(problem, steps)
    goals = [
        part.atom
        for part in goal_parts(problem.goal)
        if isinstance(part, Literal) and part.positive
    ]
    goals += [
        part for chain in problem.chains for stage in chain.stages for part in stage_parts(stage)
    ]
    holding = grip.held(here.state)
    numbers = set()
    for step in steps:
        change = changes[int(step.id)]
        holding = (holding - set(change.ends)) | grip.held(change.adds)
        added = (*change.adds, *change.events)
        reached = any(
            reaches_stage(atom, goal) for atom in added for goal in goals if atom.name == goal.name
        )
        if reached or grip.full(holding).isdisjoint(map(str, step.resources)):
            numbers.add(int(step.id))
    return frozenset(numbers)


@dataclass(frozen=True, slots=True)
class _HandsOfPlan:
    """The hands of a plan, and the things that they can hold: whatever else its steps hold."""

    hands: frozenset[Term]
    things: frozenset[Term]

    @classmethod
    def of(cls, problem: Problem, steps: Sequence[Step]) -> "_HandsOfPlan":
        """The hands and the things of a plan."""
        hands = frozenset(Function(name) for name in hands_of(problem, steps))
        return cls(
            hands, frozenset(resource for step in steps for resource in step.resources) - hands
        )

    def held(self, atoms: Iterable[Atom]) -> frozenset[Atom]:
        """Those of the facts that say that a thing is in a hand."""
        return frozenset(
            atom
            for atom in atoms
            if any(contains_term(atom, hand) for hand in self.hands)
            and any(contains_term(atom, thing) for thing in self.things)
        )

    def full(self, holding: Collection[Atom]) -> frozenset[str]:
        """The hands that these facts are about."""
        return frozenset(
            str(hand) for hand in self.hands if any(contains_term(atom, hand) for atom in holding)
        )


def stream_of(stream_term: Term, step: Step) -> str:
    """The stream of a command: its name, with the arguments that the step holds, which say which
    device it is.

    What else is in brackets is what the device is told: `path_planner(Arm)` is a device for each
    arm, `arm(open_drawer)` is not.
    """
    if not isinstance(stream_term, Function):
        return str(stream_term)
    devices = tuple(argument for argument in stream_term.arguments if argument in step.resources)
    return str(Function(stream_term.name, devices))


def looks_of(operator: Operator | None, step: Step) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The facts that a step's device looks at before it begins, and those that it watches then."""
    if operator is None or not operator.online:
        return (), ()
    binding = dict(zip(operator.variables, step.operator.arguments, strict=True))
    facts = [
        (str(substitute_term(condition.fact, binding)), condition.during)
        for condition in operator.online
    ]
    return tuple(fact for fact, _ in facts), tuple(fact for fact, during in facts if during)


def _device_text(command_term: Term, stream: str) -> str:
    """What the device is told beside its name."""
    if not isinstance(command_term, Function):
        return ""
    return ", ".join(
        str(argument) for argument in command_term.arguments if str(argument) not in stream
    )


def _command_of(operator: Operator | None, step: Step) -> Command:
    """The command of a step; where the domain declares none, its first resource is the device,
    and the step what it is told.
    """
    if operator is None or operator.command is None:
        device = step.resources[0] if step.resources else Function("cell")
        return Command(Function(str(device), (step.operator,)), Function("done"))
    binding = dict(zip(operator.variables, step.operator.arguments, strict=True))
    command_term = operator.command
    result = (
        substitute_term(command_term.result, binding) if command_term.result is not None else None
    )
    return replace(
        command_term,
        stream=substitute_term(command_term.stream, binding),
        reply=substitute_term(command_term.reply, binding),
        result=result,
    )
