"""What is to be scheduled: jobs of stages on resources, windows between them, and devices. Times are integers."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property


@dataclass(frozen=True, slots=True)
class Need:
    """A stage needs `device` at `setting` from `begin` to `end`, counted from the start of the stage."""

    device: str
    setting: str
    begin: int
    end: int


@dataclass(frozen=True, slots=True)
class Stage:
    """Something that lasts `duration` without a break and holds one unit of each of its resources meanwhile.

    `origin` and `destination` are where a resource that travels must be when it starts, and is when it has ended.
    """

    name: str
    duration: int
    resources: tuple[str, ...] = ()
    needs: tuple[Need, ...] = ()
    origin: str = ""
    destination: str = ""


@dataclass(frozen=True, slots=True)
class Job:
    """Stages that belong together; their order is told by windows. None starts before `release`.

    To end after `due` costs `priority` for each unit of time.
    """

    name: str
    stages: tuple[Stage, ...]
    release: int = 0
    due: int | None = None
    priority: int = 1


@dataclass(frozen=True, slots=True)
class Moment:
    """`offset` after the start of a stage."""

    stage: str
    offset: int = 0


@dataclass(frozen=True, slots=True)
class Window:
    """`later` comes at least `least` and (dwell) at most `most` after `earlier`."""

    earlier: Moment
    later: Moment
    least: int = 0
    most: int | None = None


@dataclass(frozen=True, slots=True)
class Hold:
    """One unit of `resource` is taken from `begin` to `end`, not before (blocking); None is from the start, or for good."""

    resource: str
    begin: Moment | None
    end: Moment | None


@dataclass(frozen=True, slots=True)
class Resource:
    """`capacity` equal units. One that travels (capacity 1) takes `travel[from, to]` between what it does.

    `home` is where it is at the start. Pairs that are not named take no time; travel that depends on kinds of work
    in place of places is a sequence-dependent set-up.
    """

    name: str
    capacity: int = 1
    travel: Mapping[tuple[str, str], int] = field(default_factory=dict)
    home: str = ""
    units: tuple[str, ...] = ()  # their names, if they have some


@dataclass(frozen=True, slots=True)
class Changeover:
    """How a device comes from one setting to another: `duration` of its operator's time, from `origin` to `destination`."""

    before: str
    after: str
    duration: int
    origin: str = ""
    destination: str = ""


@dataclass(frozen=True, slots=True)
class Device:
    """A door, a lid, a tool: one setting at a time, changed by `operator` (a resource of capacity 1).

    `final` is the setting to be left behind, if it matters.
    """

    name: str
    operator: str
    initial: str
    changes: tuple[Changeover, ...]
    final: str = ""

    def change(self, before: str, after: str) -> Changeover | None:
        """How to come from `before` to `after`, if there is a way."""
        found = [each for each in self.changes if (each.before, each.after) == (before, after)]
        return found[0] if found else None


@dataclass(frozen=True)
class Shop:
    """Everything to be scheduled. Names of stages are unique among all jobs."""

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
