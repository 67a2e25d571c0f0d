"""Which arms of a cell can make which measurements, and with which tool: as goals, facts and the cell say.

An arm needs a tool that the rules choose for the measurement, and has to reach it. A tool is held by one arm at a time. So a tool that
no fact gives to an arm goes to one of them for the whole tour.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

from cellwright.engine.model.measurements import arms_of, is_shared, named
from cellwright.engine.pipelines.inspection import Partition, partition
from cellwright.kb.asp.statics import evaluated
from cellwright.kb.loader.cell import load_cell
from cellwright.kb.model.cell import Cell
from cellwright.kb.model.conditions import Literal, goal_parts, literals
from cellwright.kb.model.problem import Problem
from cellwright.kb.targets import CELL_FILE
from cellwright.kb.terms import Function

OR = " or "  # between the names of tools
MOST_WAYS = 64  # to give tools to arms that are compared

Able = Mapping[str, Mapping[str, str]]  # for each arm the measurements that it can make, each with its tool


@dataclass(frozen=True, slots=True)
class Offers:
    """What arms can make, for each way to give free tools to arms; and what no arm can, with the reason."""

    ways: tuple[Able, ...]
    impossible: Mapping[str, str]


def offers(problem: Problem, parts: Partition, gone: Collection[str] = ()) -> Offers:
    """What the arms of a cell can make of the measurements that some tool takes, without tools and arms that are gone.

    Raises `InvalidInput` for a bad cell.
    """
    names = [name for own in parts.groups.values() for name in own]
    chosen, owners = choices_of(problem), owners_of(problem)
    reached, why = _reach(problem, names, chosen)
    wanted, arms = _wanted_arms(problem, names), tuple(arm for arm in arms_of(problem) if arm not in gone)
    tools = {name: [tool for tool in own if tool not in gone] for name, own in chosen.items()}
    ways = []
    for holds in _holders(arms, sorted({tool for own in tools.values() for tool in own}), owners):
        able: dict[str, dict[str, str]] = {arm: {} for arm in arms}
        for name in names:
            for tool in reversed(tools[name]):
                arm = holds.get(tool, "")
                if arm in able and arm in reached[name] and arm in wanted.get(name, arms):
                    able[arm][name] = tool
        ways.append(able)
    most = max(len({name for own in way.values() for name in own}) for way in ways)
    best = tuple(way for way in ways if len({name for own in way.values() for name in own}) == most)
    made = {name for own in best[0].values() for name in own}
    best = tuple(way for way in best if {name for own in way.values() for name in own} == made)
    out = {
        name: why.get(name) or _unserved(name, reached, chosen, gone) for name in names if name not in made
    }
    return Offers(best, out)


def divided(problem: Problem) -> Partition:
    """The measurements by tool; where several arms share them, by the tools of all arms that can make them. Raises `InvalidInput`."""
    parts = partition(problem)
    return _by_arms(problem, parts) if is_shared(problem) else parts


def _by_arms(problem: Problem, parts: Partition) -> Partition:
    """The measurements by the tools of all arms that can make them; what no arm can is impossible, with the reason."""
    found, tools = offers(problem, parts), dict[str, set[str]]()
    for name, tool in (each for way in found.ways for own in way.values() for each in own.items()):
        tools.setdefault(name, set()).add(tool)
    groups = dict[str, list[str]]()
    for name in (name for own in parts.groups.values() for name in own if name in tools):
        groups.setdefault(OR.join(sorted(tools[name])), []).append(name)
    said = {tools: tuple(groups[tools]) for tools in sorted(groups)}
    return replace(parts, groups=said, impossible={**parts.impossible, **found.impossible})


def choices_of(problem: Problem) -> dict[str, list[str]]:
    """The tools that the rules choose for each measurement."""
    found = dict[str, list[str]]()
    for tool, name in sorted(evaluated(problem).atoms(problem.domain.conventions.chosen, 2), key=str):
        found.setdefault(str(name), []).append(str(tool))
    return found


def owners_of(problem: Problem) -> dict[str, frozenset[str]]:
    """The arms that each tool is for, as facts say."""
    found = dict[str, frozenset[str]]()
    for tool, arm in evaluated(problem).atoms(problem.domain.conventions.equips, 2):
        found[str(tool)] = found.get(str(tool), frozenset()) | {str(arm)}
    return found


def _unserved(
    name: str, reached: Mapping[str, frozenset[str]], chosen: Mapping[str, list[str]], gone: Collection[str]
) -> str:
    """Why no arm makes a measurement."""
    lost = [each for each in (*sorted(reached[name]), *chosen[name]) if each in gone]
    if lost:
        return f"{' and '.join(lost)} {'is' if len(lost) == 1 else 'are'} lost"
    able = sorted(reached[name])
    return f"only {' and '.join(able)} would reach it, without a tool for it" if able else "no arm reaches it"


def _holders(
    arms: tuple[str, ...], tools: list[str], owners: Mapping[str, frozenset[str]]
) -> Iterator[Mapping[str, str]]:
    """The arm that holds each tool, in every way; of too many ways, the first."""
    held = {tool: sorted(owners.get(tool, frozenset(arms)).intersection(arms)) for tool in tools}
    tools = [tool for tool in tools if held[tool]]
    choices = [held[tool] for tool in tools]
    for _, way in zip(range(MOST_WAYS), product(*choices), strict=False):
        yield dict(zip(tools, way, strict=True))


def _wanted_arms(problem: Problem, names: list[str]) -> dict[str, frozenset[str]]:
    """The arms that goals name, by the measurement."""
    measured, arms, known = problem.domain.conventions.measured, arms_of(problem), set(names)
    found = dict[str, frozenset[str]]()
    stages = (Literal(stage) for chain in problem.chains for stage in chain.stages)
    asked = (literal for goal in goal_parts(problem.goal) for literal in literals(goal))
    for literal in (*asked, *stages):
        if literal.atom.name == measured and str(literal.atom.arguments[1]) in arms:
            for name in named(literal, known):
                found[name] = frozenset({str(literal.atom.arguments[1])})
    return found


def _reach(
    problem: Problem, names: list[str], tools: Mapping[str, list[str]]
) -> tuple[dict[str, frozenset[str]], dict[str, str]]:
    """The arms that reach each measurement, as facts say, else as the cell says; why none does, where the cell says so."""
    words, arms = problem.domain.conventions, arms_of(problem)
    told = dict[str, set[str]]()
    for arm, name in evaluated(problem).atoms(words.within_reach, 2):
        told.setdefault(str(name), set()).add(str(arm))
    found = {name: frozenset(told[name]) for name in names if name in told}
    open_ = [name for name in names if name not in told]
    cell = cell_beside(problem) if open_ else None
    if cell is None or not all(arm in cell.arms for arm in arms):
        return {name: found.get(name, frozenset(arms)) for name in names}, {}
    from cellwright.engine.pipelines.inspection.reach import reached_by  # geometry is slow to load

    answers = reached_by(problem, cell, open_, tools, owners_of(problem))
    why = dict[str, str]()
    for each in open_:
        own = answers.get(each, dict.fromkeys(arms, ""))
        found[each] = frozenset(arm for arm, reason in own.items() if not reason)
        if not found[each]:
            why[each] = "; ".join(f"{arm}: {reason}" for arm, reason in own.items())
    return found, why


def cell_beside(problem: Problem) -> Cell | None:
    """The cell beside the domain of a problem; None if there is none. Raises `InvalidInput`."""
    path = Path(problem.domain.path).with_name(CELL_FILE) if problem.domain.path else None
    return load_cell(path) if path is not None and path.is_file() else None


def by_arm(problem: Problem, name: str, tool: str, arm: str) -> Literal:
    """The goal that an arm makes a measurement with a tool."""
    words = problem.domain.conventions
    place = Function(words.meas, (Function(name),))
    return Literal(Function(words.measured, (Function(tool), Function(arm), place)))
