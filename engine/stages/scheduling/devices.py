"""Devices in the constraint model: the time of each device is a row of periods, each with one setting.

Period 0 has the setting that the device has at the start. Each need falls into one period of its setting.
Between two periods the operator changes the device. Periods after the last one that is needed are absent.
"""

from collections import Counter
from dataclasses import dataclass
from itertools import pairwise

from ortools.sat.python.cp_model import IntVar

from cellwright.engine.model.shop import Changeover, Device, Need
from cellwright.engine.stages.scheduling.batches import batches
from cellwright.engine.stages.scheduling.model import Model, Work


@dataclass(frozen=True)
class Period:
    """A time with one setting.

    `settings` has a literal for each possible setting. `changes` are the changes that may lead to this
    period, with their literals; the change starts at `changed`.
    """

    begin: IntVar
    end: IntVar
    present: IntVar
    settings: dict[str, IntVar]
    changes: tuple[tuple[Changeover, IntVar], ...]
    changed: IntVar | None


@dataclass(frozen=True)
class Periods:
    """The periods of one device and, for each need of a stage, the literals of the periods where it may fall."""

    device: Device
    periods: tuple[Period, ...]
    needs: tuple[tuple[str, Need, dict[int, IntVar]], ...]


def add_devices(model: Model) -> tuple[Periods, ...]:
    """The periods of every device of the shop, tied to the stages that need them."""
    return tuple(_add(model, device) for device in model.shop.devices)


def _add(model: Model, device: Device) -> Periods:
    wanted = [
        (stage.name, need)
        for stage in model.shop.stages.values()
        for need in stage.needs
        if need.device == device.name
    ]
    periods = [_found(model, device)]
    for settings in _reachable(device, wanted):
        periods.append(_next(model, device, periods[-1], settings, len(periods)))
    for first, second in pairwise(periods):
        model.cp.add_implication(second.present, first.present)
    needs = tuple((stage, need, _place(model, stage, need, periods)) for stage, need in wanted)
    _add_use(model, device, periods, [found for _, _, found in needs])
    _add_batches(model, device, len(periods), needs)
    return Periods(device, tuple(periods), needs)


def _found(model: Model, device: Device) -> Period:
    zero, one = model.cp.new_constant(0), model.cp.new_constant(1)
    end = model.cp.new_int_var(0, model.horizon, "")
    return Period(zero, end, one, {device.initial: one}, (), None)


def _reachable(device: Device, wanted: list[tuple[str, Need]]) -> list[list[str]]:
    """For each period that can be useful, the settings that it may have.

    No setting comes twice in a row, and each is needed by some stage or is the final one.
    """
    counts = Counter(need.setting for _, need in wanted)
    useful = sorted(set(counts) | ({device.final} if device.final else set()))
    most = max(counts.values(), default=0)
    number = min(counts.total(), 2 * (counts.total() - most) + 1) + bool(device.final)
    found: list[list[str]] = []
    before = {device.initial}
    for _ in range(number):
        before = {s for s in useful if any(b != s and device.change(b, s) for b in before)}
        if before:
            found.append(sorted(before))
    return found


def _next(model: Model, device: Device, before: Period, settings: list[str], number: int) -> Period:
    """The period after `before`, with the operator's work between them."""
    cp, horizon = model.cp, model.horizon
    begin, end, changed = (cp.new_int_var(0, horizon, "") for _ in range(3))
    present = cp.new_bool_var(f"{device.name} {number}")
    literals = {s: present if len(settings) == 1 else cp.new_bool_var("") for s in settings}
    cp.add(sum(literals.values()) == present)
    ways = [
        change
        for was in before.settings
        for will in settings
        if was != will and (change := device.change(was, will))
    ]
    changes = tuple((way, present if len(ways) == 1 else cp.new_bool_var("")) for way in ways)
    cp.add(sum(taken for _, taken in changes) == present)
    for change, taken in changes:
        cp.add_implication(taken, before.settings[change.before])
        cp.add_implication(taken, literals[change.after])
        _work(model, device, change, taken, changed, number)
        cp.add(begin >= changed + change.duration).only_enforce_if(taken)
    cp.add(changed >= before.end).only_enforce_if(present)
    for variable in (begin, end, changed):
        cp.add(variable == horizon).only_enforce_if(~present)
    cp.add(end >= begin)
    return Period(begin, end, present, literals, changes, changed)


def _work(
    model: Model, device: Device, change: Changeover, taken: IntVar, start: IntVar, number: int
) -> None:
    """Add what the operator does if it makes this change."""
    end = start + change.duration
    interval = model.cp.new_optional_fixed_size_interval_var(start, change.duration, taken, "")
    work = Work(start, end, interval, change.origin, change.destination, taken, device.name, number)
    model.works.setdefault(device.operator, []).append(work)
    model.cp.add(model.makespan >= end).only_enforce_if(taken)


def _place(model: Model, stage: str, need: Need, periods: list[Period]) -> dict[int, IntVar]:
    """The literals of the periods into which a need may fall; exactly one of them is true."""
    found: dict[int, IntVar] = {}
    for number, period in enumerate(periods):
        if need.setting in period.settings:
            inside = model.cp.new_bool_var(f"{stage} in {number}")
            model.cp.add_implication(inside, period.settings[need.setting])
            model.cp.add(model.starts[stage] + need.begin >= period.begin).only_enforce_if(inside)
            model.cp.add(model.starts[stage] + need.end <= period.end).only_enforce_if(inside)
            found[number] = inside
    model.cp.add_exactly_one(found.values())
    return found


def _add_use(model: Model, device: Device, periods: list[Period], needs: list[dict[int, IntVar]]) -> None:
    """Each period serves some stage or has the final setting.

    If the device has a final setting, the last period has it.
    """
    for number, period in enumerate(periods):
        absent = [~period.present] if number else []
        final = [period.settings[device.final]] if device.final in period.settings else []
        if number:
            used = [found[number] for found in needs if number in found]
            model.cp.add_bool_or([*used, *absent, *final])
        if device.final:
            following = [each.present for each in periods[number + 1 : number + 2]]
            model.cp.add_bool_or([*final, *following, *absent])


def _add_batches(
    model: Model, device: Device, periods: int, needs: tuple[tuple[str, Need, dict[int, IntVar]], ...]
) -> None:
    """No period holds more stages of a batch than there are places.

    The other constraints imply this, but the solver does not see it.
    """
    for served in (each for each in batches(model.lags) if each.device == device.name):
        members = {stage.name for stage in served.stages}
        for number in range(periods):
            inside = [
                places[number]
                for stage, need, places in needs
                if stage in members and need.setting == served.setting and number in places
            ]
            model.cp.add(sum(inside) <= served.most)
