"""Which arms can make which measurements with which tool, also when tools or arms are lost.

An arm needs a tool that the rules choose for the measurement, and has to reach it. A tool is held
by one arm at a time. So a tool that no fact gives to an arm goes to one of them for the whole tour.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

from cellwright.engine.model.part_measurements import is_shared, measuring_arms, names_in_goal
from cellwright.engine.pipelines.inspection.tool_tours import ToolPartition, partition_by_tool
from cellwright.kb.asp.static_facts import evaluate_statics
from cellwright.kb.loader.cell import load_cell
from cellwright.kb.model.cell_model import Cell
from cellwright.kb.model.conditions import Literal, goal_parts, literals_in
from cellwright.kb.model.domain_model import Operator
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.targets import CELL_FILE
from cellwright.kb.terms import Function, Term, Variable

TOOL_SEPARATOR = " or "  # between the names of tools
MAX_TOOL_ASSIGNMENTS = 64  # to give tools to arms that are compared

# for each arm the measurements that it can make, each with its tool
Able = Mapping[str, Mapping[str, str]]


@dataclass(frozen=True, slots=True)
class ArmOffers:
    """What arms can make, for each way to give free tools to arms; and what no arm can, with
    the reason.
    """

    ways: tuple[Able, ...]
    impossible: Mapping[str, str]


def arm_offers(problem: Problem, parts: ToolPartition, gone: Collection[str] = ()) -> ArmOffers:
    """What the arms of a cell can make of the measurements that some tool takes, without tools and
    arms that are gone.

    Raises `InvalidInput` for a bad cell.
    """
    names = [name for own in parts.groups.values() for name in own]
    chosen, owners = choices_of(problem), owners_of(problem)
    reached, why = _arm_reach(problem, names, chosen)
    wanted_arms, arms = (
        _wanted_arms(problem, names),
        tuple(arm for arm in measuring_arms(problem) if arm not in gone),
    )
    tools = {name: [tool for tool in own if tool not in gone] for name, own in chosen.items()}
    ways = []
    for holds in _tool_assignments(
        arms, sorted({tool for own in tools.values() for tool in own}), owners
    ):
        able: dict[str, dict[str, str]] = {arm: {} for arm in arms}
        for name in names:
            for tool in reversed(tools[name]):
                arm = holds.get(tool, "")
                if arm in able and arm in reached[name] and arm in wanted_arms.get(name, arms):
                    able[arm][name] = tool
        ways.append(able)
    most = max(len({name for own in assignment.values() for name in own}) for assignment in ways)
    best = tuple(
        assignment
        for assignment in ways
        if len({name for own in assignment.values() for name in own}) == most
    )
    used_tools = {name for own in best[0].values() for name in own}
    best = tuple(
        assignment
        for assignment in best
        if {name for own in assignment.values() for name in own} == used_tools
    )
    out = {
        name: why.get(name) or _unserved_reason(name, reached, chosen, gone)
        for name in names
        if name not in used_tools
    }
    return ArmOffers(best, out)


def partition_for_arms(problem: Problem) -> ToolPartition:
    """The measurements by tool; where several arms share them, by the tools of all arms that
    can make them. Raises `InvalidInput`.
    """
    parts = partition_by_tool(problem)
    return _by_arms(problem, parts) if is_shared(problem) else parts


def _by_arms(problem: Problem, parts: ToolPartition) -> ToolPartition:
    """The measurements by the tools of all arms that can make them; what no arm can is
    impossible, with the reason.
    """
    offered, tools = arm_offers(problem, parts), dict[str, set[str]]()
    for name, tool in (
        tool_of_name
        for assignment in offered.ways
        for own in assignment.values()
        for tool_of_name in own.items()
    ):
        tools.setdefault(name, set()).add(tool)
    groups = dict[str, list[str]]()
    for name in (name for own in parts.groups.values() for name in own if name in tools):
        groups.setdefault(TOOL_SEPARATOR.join(sorted(tools[name])), []).append(name)
    grouped_names = {tools: tuple(groups[tools]) for tools in sorted(groups)}
    return replace(
        parts, groups=grouped_names, impossible={**parts.impossible, **offered.impossible}
    )


def choices_of(problem: Problem) -> dict[str, list[str]]:
    """The tools that the rules choose for each measurement."""
    tools_by_name = dict[str, list[str]]()
    for tool, name in sorted(
        evaluate_statics(problem).atoms(problem.domain.conventions.chosen, 2), key=str
    ):
        tools_by_name.setdefault(str(name), []).append(str(tool))
    return tools_by_name


def owners_of(problem: Problem) -> dict[str, frozenset[str]]:
    """The arms that each tool is for, as facts say."""
    owners = dict[str, frozenset[str]]()
    for tool, arm in evaluate_statics(problem).atoms(problem.domain.conventions.equips, 2):
        owners[str(tool)] = owners.get(str(tool), frozenset()) | {str(arm)}
    return owners


def _unserved_reason(
    name: str,
    reached: Mapping[str, frozenset[str]],
    chosen: Mapping[str, list[str]],
    gone: Collection[str],
) -> str:
    """Why no arm makes a measurement."""
    lost = [lost_name for lost_name in (*sorted(reached[name]), *chosen[name]) if lost_name in gone]
    if lost:
        return f"{' and '.join(lost)} {'is' if len(lost) == 1 else 'are'} lost"
    able = sorted(reached[name])
    return (
        f"only {' and '.join(able)} would reach it, without a tool for it"
        if able
        else "no arm reaches it"
    )


def _tool_assignments(
    arms: tuple[str, ...], tools: list[str], owners: Mapping[str, frozenset[str]]
) -> Iterator[Mapping[str, str]]:
    """The arm that holds each tool, in every way; of too many ways, the first."""
    holders_of_tool = {
        tool: sorted(owners.get(tool, frozenset(arms)).intersection(arms)) for tool in tools
    }
    tools = [tool for tool in tools if holders_of_tool[tool]]
    choices = [holders_of_tool[tool] for tool in tools]
    for _, assignment in zip(range(MAX_TOOL_ASSIGNMENTS), product(*choices), strict=False):
        yield dict(zip(tools, assignment, strict=True))


def _wanted_arms(problem: Problem, names: list[str]) -> dict[str, frozenset[str]]:
    """The arms that goals name, by the measurement."""
    measured, arms, names_known = (
        problem.domain.conventions.measured,
        measuring_arms(problem),
        set(names),
    )
    arms_by_name = dict[str, frozenset[str]]()
    stages = (Literal(stage) for chain in problem.chains for stage in chain.stages)
    asked = (literal for goal in goal_parts(problem.goal) for literal in literals_in(goal))
    for literal in (*asked, *stages):
        if literal.atom.name == measured and str(literal.atom.arguments[1]) in arms:
            for name in names_in_goal(literal, names_known):
                arms_by_name[name] = frozenset({str(literal.atom.arguments[1])})
    return arms_by_name


def _arm_reach(
    problem: Problem, names: list[str], tools: Mapping[str, list[str]]
) -> tuple[dict[str, frozenset[str]], dict[str, str]]:
    """The arms that reach each measurement, as facts say, else as the cell says; why none does,
    where the cell says so.
    """
    words, arms = problem.domain.conventions, measuring_arms(problem)
    told_arms = dict[str, set[str]]()
    for arm, name in evaluate_statics(problem).atoms(words.within_reach, 2):
        told_arms.setdefault(str(name), set()).add(str(arm))
    reached = {name: frozenset(told_arms[name]) for name in names if name in told_arms}
    open_ = [name for name in names if name not in told_arms]
    cell = cell_beside(problem) if open_ else None
    if cell is None or not all(arm in cell.arms for arm in arms):
        return {name: reached.get(name, frozenset(arms)) for name in names}, {}
    from cellwright.engine.pipelines.inspection.measurement_places import (
        unreached_reasons,  # geometry is slow to load
    )

    answers = unreached_reasons(problem, cell, open_, tools, owners_of(problem))
    why = dict[str, str]()
    for open_name in open_:
        own = answers.get(open_name, dict.fromkeys(arms, ""))
        reached[open_name] = frozenset(arm for arm, reason in own.items() if not reason)
        if not reached[open_name]:
            why[open_name] = "; ".join(f"{arm}: {reason}" for arm, reason in own.items())
    return reached, why


def cell_beside(problem: Problem) -> Cell | None:
    """The cell beside the domain of a problem; None if there is none. Raises `InvalidInput`."""
    path = Path(problem.domain.path).with_name(CELL_FILE) if problem.domain.path else None
    return load_cell(path) if path is not None and path.is_file() else None


def by_arm(problem: Problem, name: str, tool: str, arm: str) -> Literal:
    """The goal that an arm makes a measurement with a tool."""
    words = problem.domain.conventions
    place = Function(words.meas, (Function(name),))
    return Literal(Function(words.measured, (Function(tool), Function(arm), place)))


def partition_after_loss(problem: Problem, lost: Collection[str]) -> ToolPartition:
    """The partition of the measurements when some resources are lost. Raises `InvalidInput`.

    If the domain declares `unavailable(tool)`, its rules may choose another tool. A measurement
    that is still assigned to an unusable tool is impossible.
    """
    gone = unusable_resources(problem, lost)
    parts = partition_by_tool(without_tools(problem, gone))
    refused = {
        name: f"{tool} is lost"
        for tool, names in parts.groups.items()
        if tool in gone
        for name in names
    }
    groups = {tool: names for tool, names in parts.groups.items() if tool not in gone}
    return replace(parts, groups=groups, impossible={**parts.impossible, **refused})


def without_tools(problem: Problem, gone: Collection[str]) -> Problem:
    """The problem with the fact that a tool is unavailable for each tool that is gone, if its
    domain declares such facts.
    """
    unavailable = problem.domain.conventions.unavailable
    declared = problem.domain.predicates.get(unavailable)
    if declared is None or len(declared.arguments) != 1:
        return problem
    tools = sorted(_of_type(problem, declared.arguments[0]).intersection(gone))
    facts = (Function(unavailable, (Function(tool),)) for tool in tools)
    return replace(problem, statics=(*problem.statics, *facts))


def unusable_resources(problem: Problem, lost: Collection[str]) -> frozenset[str]:
    """The lost resources, and every object that can only measure together with a lost one."""
    if not lost:
        return frozenset()
    measured = problem.domain.conventions.measured
    choices = [
        [_resource_candidates(operator, resource, problem) for resource in operator.resources]
        for operator in problem.domain.operators
        if any(effect.adds and effect.atom.name == measured for effect in operator.effects)
    ]
    names = {name for sets in choices for candidates in sets for name in candidates}
    able = {name for name in names if any(_is_possible(name, sets, lost) for sets in choices)}
    return frozenset({*lost, *(names - able)})


def _is_possible(name: str, choices: Sequence[frozenset[str]], lost: Collection[str]) -> bool:
    """Whether an object can be a resource of an operator while none of the operator's resources
    is lost.
    """
    if name in lost or not any(name in candidates for candidates in choices):
        return False
    return all(name in candidates or candidates - set(lost) for candidates in choices)


def _resource_candidates(operator: Operator, resource: Term, problem: Problem) -> frozenset[str]:
    """The objects that a resource of an operator, which may be a variable, can be."""
    if not isinstance(resource, Variable):
        return frozenset({str(resource)})
    return _of_type(
        problem,
        next(parameter.type for parameter in operator.parameters if parameter.variable == resource),
    )


def _of_type(problem: Problem, wanted_type: str) -> frozenset[str]:
    objects = {**problem.domain.objects, **problem.objects}
    return frozenset(
        name for name, type_ in objects.items() if problem.domain.is_subtype(type_, wanted_type)
    )
