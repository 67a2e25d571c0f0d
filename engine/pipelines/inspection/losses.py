"""The measurements that are still possible when tools or other resources are lost."""

from collections.abc import Collection, Sequence
from dataclasses import replace

from cellwright.engine.pipelines.inspection import Partition, partition
from cellwright.kb.model.domain import Operator
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Function, Term, Variable


def parted(problem: Problem, lost: Collection[str]) -> Partition:
    """The partition of the measurements when some resources are lost. Raises `InvalidInput`.

    If the domain declares `unavailable(tool)`, its rules may choose another tool. A measurement that is still assigned to
    an unusable tool is impossible.
    """
    gone = unusable(problem, lost)
    parts = partition(bereft(problem, gone))
    refused = {
        name: f"{tool} is lost" for tool, names in parts.groups.items() if tool in gone for name in names
    }
    groups = {tool: names for tool, names in parts.groups.items() if tool not in gone}
    return replace(parts, groups=groups, impossible={**parts.impossible, **refused})


def bereft(problem: Problem, gone: Collection[str]) -> Problem:
    """The problem with the fact that a tool is unavailable for each tool that is gone, if its domain declares such facts."""
    unavailable = problem.domain.conventions.unavailable
    declared = problem.domain.predicates.get(unavailable)
    if declared is None or len(declared.arguments) != 1:
        return problem
    tools = sorted(_of_type(problem, declared.arguments[0]).intersection(gone))
    facts = (Function(unavailable, (Function(tool),)) for tool in tools)
    return replace(problem, statics=(*problem.statics, *facts))


def unusable(problem: Problem, lost: Collection[str]) -> frozenset[str]:
    """The lost resources, and every object that can only measure together with a lost one."""
    if not lost:
        return frozenset()
    measured = problem.domain.conventions.measured
    choices = [
        [_candidates(operator, each, problem) for each in operator.resources]
        for operator in problem.domain.operators
        if any(effect.adds and effect.atom.name == measured for effect in operator.effects)
    ]
    names = {name for sets in choices for each in sets for name in each}
    able = {name for name in names if any(_possible(name, sets, lost) for sets in choices)}
    return frozenset({*lost, *(names - able)})


def _possible(name: str, choices: Sequence[frozenset[str]], lost: Collection[str]) -> bool:
    """Whether an object can be a resource of an operator while none of the operator's resources is lost."""
    if name in lost or not any(name in each for each in choices):
        return False
    return all(name in each or each - set(lost) for each in choices)


def _candidates(operator: Operator, resource: Term, problem: Problem) -> frozenset[str]:
    """The objects that a resource of an operator, which may be a variable, can be."""
    if not isinstance(resource, Variable):
        return frozenset({str(resource)})
    return _of_type(problem, next(each.type for each in operator.parameters if each.variable == resource))


def _of_type(problem: Problem, wanted: str) -> frozenset[str]:
    objects = {**problem.domain.objects, **problem.objects}
    return frozenset(name for name, type_ in objects.items() if problem.domain.is_subtype(type_, wanted))
