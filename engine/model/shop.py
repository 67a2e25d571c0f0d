"""A scheduling problem: jobs made of stages, resources, time windows between stages, and devices.

Times are integers.
"""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property


@dataclass(frozen=True, slots=True)
class Need:
    """A stage needs `device` at `setting` from `begin` to `end`.

    Both times count from the start of the stage.
    """

    device: str
    setting: str
    begin: int
    end: int


@dataclass(frozen=True, slots=True)
class Stage:
    """An activity of length `duration` without a break. It holds one unit of each of its resources.

    `origin` is where a travelling resource must be when the stage starts; `destination` is where it is at the
    end.
    """

    name: str
    duration: int
    resources: tuple[str, ...] = ()
    needs: tuple[Need, ...] = ()
    origin: str = ""
    destination: str = ""


@dataclass(frozen=True, slots=True)
class Job:
    """Stages that belong together. Windows say in which order they come. No stage starts before `release`.

    If the job ends after `due`, each unit of time costs `priority`.
    """

    name: str
    stages: tuple[Stage, ...]
    release: int = 0
    due: int | None = None
    priority: int = 1


@dataclass(frozen=True, slots=True)
class Moment:
    """The time `offset` after the start of a stage."""

    stage: str
    offset: int = 0


@dataclass(frozen=True, slots=True)
class Window:
    """`later` comes at least `least` and at most `most` after `earlier`. (A largest time is called dwell.)"""

    earlier: Moment
    later: Moment
    least: int = 0
    most: int | None = None


@dataclass(frozen=True, slots=True)
class Hold:
    """One unit of `resource` is taken from `begin` to `end`, even between stages (blocking).

    `begin` None: from time 0; `end` None: for ever.
    """

    resource: str
    begin: Moment | None
    end: Moment | None


@dataclass(frozen=True, slots=True)
class Resource:
    """A resource with `capacity` equal units.

    If it travels (capacity 1), it takes `travel[from, to]` between two stages. `home` is where it is at the
    start. Pairs that are not named take no time. With kinds of work in place of places, travel is a
    sequence-dependent set-up.
    """

    name: str
    capacity: int = 1
    travel: Mapping[tuple[str, str], int] = field(default_factory=dict)
    home: str = ""
    units: tuple[str, ...] = ()  # names of the units, if they have names


@dataclass(frozen=True, slots=True)
class Changeover:
    """How a device gets from one setting to another.

    Its operator needs `duration`, and moves from `origin` to `destination`.
    """

    before: str
    after: str
    duration: int
    origin: str = ""
    destination: str = ""


@dataclass(frozen=True, slots=True)
class Device:
    """A device such as a door, a lid or a tool.

    It has one setting at a time; `operator` (a resource of capacity 1) changes it. `final` is the setting
    that it must have at the end; empty if any setting will do.
    """

    name: str
    operator: str
    initial: str
    changes: tuple[Changeover, ...]
    final: str = ""

    def change(self, before: str, after: str) -> Changeover | None:
        """The change from setting `before` to setting `after`, if there is one."""
        found = [each for each in self.changes if (each.before, each.after) == (before, after)]
        return found[0] if found else None


@dataclass(frozen=True)
class Shop:
    """A whole scheduling problem. Names of stages are unique among all jobs."""

    jobs: tuple[Job, ...]
    resources: tuple[Resource, ...]
    windows: tuple[Window, ...] = ()
    holds: tuple[Hold, ...] = ()
    devices: tuple[Device, ...] = ()

    @cached_property
    def stages(self) -> dict[str, Stage]:
        """Every stage by name, in the order of jobs."""
        return {stage.name: stage for job in self.jobs for stage in job.stages}

    @cached_property
    def owners(self) -> dict[str, Job]:
        """The job of each stage."""
        return {stage.name: job for job in self.jobs for stage in job.stages}

    @cached_property
    def resource(self) -> dict[str, Resource]:
        """Every resource by name."""
        return {each.name: each for each in self.resources}

    @cached_property
    def device(self) -> dict[str, Device]:
        """Every device by name."""
        return {each.name: each for each in self.devices}

    def end(self, stage: str) -> Moment:
        """The end of a stage."""
        return Moment(stage, self.stages[stage].duration)

    def after(self, earlier: str, later: str, least: int = 0, most: int | None = None) -> Window:
        """`later` starts at least `least` and at most `most` after the end of `earlier`."""
        return Window(self.end(earlier), Moment(later), least, most)


def in_order(stages: tuple[Stage, ...]) -> tuple[Window, ...]:
    """Each stage starts when the one before it has ended, or later."""
    return tuple(
        Window(Moment(first.name, first.duration), Moment(second.name))
        for first, second in itertools.pairwise(stages)
    )
