"""Goals about measurements that no arm can take are given up, each with its reason; the rest is planned."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

from cellwright.engine.model.measurements import named
from cellwright.engine.pipelines.attainment import GivenUp
from cellwright.kb.model.conditions import TRUE, And, Condition, Literal, goal_parts, literals
from cellwright.kb.model.problem import Chain, Problem


def within_reach(problem: Problem, lost: Mapping[str, str]) -> tuple[Problem, tuple[GivenUp, ...]]:
    """The problem without its goals about lost measurements, of which is said why, and those goals.

    A workflow ends before the first stage about one of them; none waits for one that is cut. Where nothing would be left, the
    problem stays as it is.
    """
    if not lost:
        return problem, ()
    kept, chains, given_up = _divided(problem, lost)
    if not kept and not chains:
        return problem, ()
    return replace(problem, goal=And(kept) if kept else TRUE, chains=chains), given_up


def all_lost(problem: Problem, lost: Mapping[str, str]) -> tuple[GivenUp, ...]:
    """The goals about lost measurements of a problem for which there is no plan, each with its reason."""
    return _divided(problem, lost)[2]


def _divided(
    problem: Problem, lost: Mapping[str, str]
) -> tuple[tuple[Condition, ...], tuple[Chain, ...], tuple[GivenUp, ...]]:
    """The parts of the goal and the chains that are kept, and what is given up."""
    parts = goal_parts(problem.goal)
    kept = tuple(part for part in parts if not _about(part, lost))
    given_up = [GivenUp(str(part), _why(part, lost)) for part in parts if _about(part, lost)]
    chains = list[Chain]()
    for chain in problem.chains:
        cuts = (n for n, stage in enumerate(chain.stages) if _about(Literal(stage), lost))
        cut = next(cuts, len(chain.stages))
        given_up += _cut(chain, cut, lost)
        chains += [replace(chain, stages=chain.stages[:cut])] if cut else []
    whole = {chain.name for chain in chains if chain in problem.chains}
    chains = [replace(chain, after=tuple(name for name in chain.after if name in whole)) for chain in chains]
    return kept, tuple(chains), tuple(given_up)


def _about(goal: Condition, lost: Mapping[str, str]) -> bool:
    """Whether a goal asks for nothing but facts about lost measurements."""
    asked = list(literals(goal))
    return bool(asked) and all(each.positive and named(each, lost) for each in asked)


def _why(goal: Condition, lost: Mapping[str, str]) -> str:
    return "; ".join(lost[name] for name in sorted(named(goal, lost)))


def _cut(chain: Chain, cut: int, lost: Mapping[str, str]) -> Iterator[GivenUp]:
    """The stages of a chain from the first one on that cannot be reached."""
    for n, stage in enumerate(chain.stages[cut:]):
        why = f"it comes after {chain.stages[cut]}" if n else _why(Literal(stage), lost)
        yield GivenUp(f"{stage} of {chain.name}", why)
