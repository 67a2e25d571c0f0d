"""A plan as the executive runs it: activities, resource queues, and dwell times."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from cellwright.engine.model.start_rules import StartRule


@dataclass(frozen=True, slots=True)
class Activity:
    """A step of a plan. `start_ms` is its forecast on the run's clock; only its order behind
    `after` is promised.

    `expects` is the pattern of a normal reply. `rests` says that nothing is left in a hand when it
    ends, or that it reaches a goal: a run may pause behind it. A `process` goes on without a hand.
    Its device looks at the facts in `looks` before it begins, and at `watches` while it goes on.
    Where a policy is followed, `rule` says when it may begin (in milliseconds of the run's clock),
    and it is counted on to last no longer than `longest_ms`.
    """

    id: int
    action: str
    stream: str
    lasts_ms: int = 0
    after: tuple[int, ...] = ()
    resources: tuple[str, ...] = ()
    start_ms: int = 0
    timeout_ms: int | None = None
    says: str = ""
    expects: str = "done"
    asks: bool = False
    rests: bool = True
    process: bool = False
    looks: tuple[str, ...] = ()
    watches: tuple[str, ...] = ()
    rule: StartRule | None = None
    longest_ms: int | None = None


@dataclass(frozen=True, slots=True)
class Dwell:
    """What `source` has brought about may wait for `target` no longer than `most_ms`.

    What was there before the program has no source: it waits `since_ms`. Messages name the `thing`
    that waits and its `place`.
    """

    source: int
    target: int
    most_ms: int
    since_ms: int | None = None
    thing: str = field(default="", compare=False)
    place: str = field(default="", compare=False)


@dataclass(frozen=True)
class ActivityProgram:
    """All activities by number. Where it is `timed`, none begins before its forecast.

    `lookahead` says how many commands a stream takes at once; 1 for streams that are not named.
    `hands` are the resources that work as hands; where none are named, every resource counts as
    one.
    """

    activities: Mapping[int, Activity]
    dwells: tuple[Dwell, ...] = ()
    timed: bool = False
    lookahead: Mapping[str, int] = field(default_factory=dict)
    hands: frozenset[str] = frozenset()

    @cached_property
    def follows_rules(self) -> bool:
        """Whether its activities begin by the rules of a policy."""
        return any(activity.rule is not None for activity in self.activities.values())

    @cached_property
    def successors(self) -> Mapping[int, tuple[int, ...]]:
        """For each activity those that wait for it directly."""
        following: dict[int, list[int]] = {
            activity_number: [] for activity_number in self.activities
        }
        for activity in self.activities.values():
            for before in activity.after:
                following[before].append(activity.id)
        return {activity_number: tuple(later) for activity_number, later in following.items()}

    @cached_property
    def queues(self) -> Mapping[str, tuple[int, ...]]:
        """For each resource its activities, in the order of the forecast; those that wait for
        each other in that order.
        """
        order = {activity_number: place for place, activity_number in enumerate(self.activities)}
        queues: dict[str, list[int]] = {}
        for activity in sorted(self.activities.values(), key=lambda a: (a.start_ms, order[a.id])):
            for resource in activity.resources:
                queues.setdefault(resource, []).append(activity.id)
        return {resource: tuple(queue) for resource, queue in queues.items()}

    @cached_property
    def places(self) -> Mapping[int, Mapping[str, int]]:
        """For each activity its place in the queue of each of its resources."""
        places: dict[int, dict[str, int]] = {
            activity_number: {} for activity_number in self.activities
        }
        for resource, queue in self.queues.items():
            for place, queued in enumerate(queue):
                places[queued][resource] = place
        return places

    @cached_property
    def ending_in(self) -> Mapping[int, tuple[Dwell, ...]]:
        """For each activity the waits that begin with its end."""
        dwells: dict[int, tuple[Dwell, ...]] = {}
        for dwell in self.dwells:
            dwells[dwell.source] = (*dwells.get(dwell.source, ()), dwell)
        return dwells

    @property
    def forecast_ms(self) -> int:
        """When the last activity is forecast to end."""
        return max(
            (activity.start_ms + activity.lasts_ms for activity in self.activities.values()),
            default=0,
        )
