"""Options of a simulated cell, and the faults that are ordered for it, with their notation."""

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from cellwright.engine.ports import DriverSetup
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.operator_amounts import DurationRange
from cellwright.kb.numbers import NumberError, is_count, read_decimal

FORECAST, DRAWN, SHORTEST, LONGEST = "forecast", "drawn", "shortest", "longest"
MAX_REDRAWS = 10_000  # draws outside of the range
DURATION_CHOICES = (FORECAST, DRAWN, SHORTEST, LONGEST)


@dataclass(frozen=True, slots=True)
class Injection:
    """A fault that appears when a step is carried out: which step, the how-manieth time, and its
    cause.

    `action` is the step as an instance, or the name of its operator for any step of it. `exception`
    is how the step fails; empty for the first one of the base that the cause can have there.
    """

    action: str
    cause: str
    time: int = 1
    exception: str = ""


def read_injection(text: str) -> Injection:
    """An injection in the form STEP[#TIME]=CAUSE[@EXCEPTION]. Raises `InvalidInput`."""
    step, _, rest = text.rpartition("=")
    cause, _, exception = rest.partition("@")
    action, _, time_text = step.partition("#")
    if not action or not cause or (time_text and not is_count(time_text)):
        hint = "write STEP=CAUSE: pick(probe_1, slot(drawer, 1))=not_gripped, or pick#2=arm_offset"
        raise InvalidInput([Diagnostic(Source("--fault"), "K107", f"'{text}' is no fault", hint)])
    return Injection(action.strip(), cause.strip(), int(time_text or 1), exception.strip())


@dataclass(frozen=True, slots=True)
class SimulatorSettings:
    """How a simulated cell behaves. Durations are spread evenly by a share around the forecast.

    `durations` says how long steps last that have ranges: as `forecast`, `drawn`, or the `shortest`
    or `longest` time.
    """

    seed: int = 0
    factor: float = 0.0
    spread: float = 0.0
    lookahead: int = 1
    injections: tuple[Injection, ...] = ()
    log: str = ""
    durations: str = FORECAST


def settings_of(setup: DriverSetup, more: Sequence[str] = ()) -> SimulatorSettings:
    """How a simulated cell behaves.

    `more` are options that its driver has beside these. Raises `InvalidInput`.
    """
    known_options = ("spread", "lookahead", "fault", "log", "truth", "durations", *more)
    if unknown := [name for name in setup.options if name not in known_options]:
        hint = f"one of: {', '.join(known_options)}"
        raise InvalidInput(
            [
                Diagnostic(
                    Source("--option"), "K408", f"the simulator has no option '{unknown[0]}'", hint
                )
            ]
        )
    return SimulatorSettings(
        setup.seed,
        setup.factor,
        option_number(setup.options, "spread"),
        max(1, int(option_number(setup.options, "lookahead", 1))),
        tuple(
            read_injection(fault.strip())
            for fault in setup.options.get("fault", "").split(";")
            if fault.strip()
        ),
        setup.options.get("log", ""),
        _durations_option(setup.options),
    )


def _durations_option(options: Mapping[str, str]) -> str:
    """How long steps with ranges last. Raises `InvalidInput`."""
    said = options.get("durations", FORECAST)
    if said not in DURATION_CHOICES:
        reason, hint = f"no durations '{said[:40]}'", f"one of: {', '.join(DURATION_CHOICES)}"
        raise InvalidInput([Diagnostic(Source("--option"), "K406", reason, hint)])
    return said


def option_number(options: Mapping[str, str], name: str, default: float = 0.0) -> float:
    """An option of a driver as a number. Raises `InvalidInput`."""
    try:
        return read_decimal(options[name]) if name in options else default
    except NumberError as error:
        reason = f"'{options[name][:40]}' {error}"
        raise InvalidInput(
            [Diagnostic(Source("--option"), "K107", reason, f"write {name}=0.2")]
        ) from None


def drawn_duration(settings: SimulatorSettings, action: str, time_: int, lasts_ms: int) -> int:
    """How long an action takes the n-th time: always the same for the same seed."""
    share = random.Random(f"{settings.seed} {action} {time_}").uniform(-1.0, 1.0)
    return max(0, round(lasts_ms * (1.0 + settings.spread * share)))


def duration_in_range(
    settings: SimulatorSettings, action: str, time_: int, lasts: DurationRange
) -> float:
    """How long an action with a range takes the n-th time, in the domain's unit of time."""
    if settings.durations == SHORTEST:
        return lasts.least
    if settings.durations == LONGEST:
        return lasts.most
    if settings.durations == FORECAST:
        return lasts.usual
    chance = random.Random(f"{settings.seed} {action} {time_} in its range")
    for _ in range(MAX_REDRAWS if lasts.spread else 0):
        drawn = chance.gauss(lasts.usual, lasts.spread)
        if lasts.least <= drawn <= lasts.most:
            return drawn
    return chance.uniform(lasts.least, lasts.most)
