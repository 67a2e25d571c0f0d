"""A long plan in columns: each column is a part of the plan, with what comes before as its start and the rest as its goal."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from math import ceil

from cellwright.kb.model.plan import GOAL, START, CausalLink, Plan, Step, StepId
from cellwright.kb.terms import Atom

HIGHEST = 24  # steps of a column

Way = tuple[StepId, Atom, StepId]


@dataclass(frozen=True, slots=True)
class Column:
    """Some steps that stand below each other. `texts` are the texts of its boxes, those of `START` and `GOAL` included.

    `titles` says for each of its links what it stands for: all links of the whole plan that leave or enter the column there.
    """

    part: Plan
    texts: Mapping[StepId, str]
    titles: Mapping[Way, str]


def columns(plan: Plan, say: Callable[[Atom], str]) -> list[Column]:
    """The plan in as few columns of about equal height as `HIGHEST` allows; at least one."""
    count = max(1, ceil(len(plan.steps) / HIGHEST))
    height = ceil(len(plan.steps) / count)
    texts = {START: "start", **{step.id: f"{step.id} {step.operator}" for step in plan.steps}, GOAL: "goal"}
    return [
        _column(plan, plan.steps[n * height : (n + 1) * height], texts, say)
        for n in range(count)
        if n == 0 or n * height < len(plan.steps)
    ]


def _column(
    plan: Plan, steps: tuple[Step, ...], texts: Mapping[StepId, str], say: Callable[[Atom], str]
) -> Column:
    own = {step.id for step in steps}
    links: dict[Way, list[CausalLink]] = {}
    for link in plan.links:
        if way := _way(link, own, not steps or steps[0] == plan.steps[0]):
            links.setdefault(way, []).append(link)
    made = tuple(replace(step, after=tuple(each for each in step.after if each in own)) for step in steps)
    shown = {each: text for each, text in texts.items() if each in own or each in (START, GOAL)}
    shown |= dict(_ends(plan, steps))
    titles = {way: _title(parts, texts, say) for way, parts in links.items()}
    return Column(Plan(made, tuple(CausalLink(*way) for way in links)), shown, titles)


def _way(link: CausalLink, own: set[StepId], first: bool) -> Way | None:
    """Where a link of the plan runs in a column; None if it passes by. What the start gives the goal is in the first."""
    inside = link.producer in own, link.consumer in own
    if not any(inside) and not (first and (link.producer, link.consumer) == (START, GOAL)):
        return None
    return link.producer if inside[0] else START, link.condition, link.consumer if inside[1] else GOAL


def _ends(plan: Plan, steps: tuple[Step, ...]) -> Iterator[tuple[StepId, str]]:
    """What stands above and below a column that is not the first or not the last."""
    if steps and steps[0] != plan.steps[0]:
        yield START, f"start and steps up to {steps[0].id - 1}"
    if steps and steps[-1] != plan.steps[-1]:
        yield GOAL, f"goal and steps from {steps[-1].id + 1} on"


def _title(links: list[CausalLink], texts: Mapping[StepId, str], say: Callable[[Atom], str]) -> str:
    users: dict[StepId, list[str]] = {}
    for link in links:
        users.setdefault(link.producer, []).append(texts[link.consumer])
    said = say(links[0].condition)
    return "; ".join(f"{texts[each]} achieves {said} for {', '.join(names)}" for each, names in users.items())
