"""How a simulated cell behaves, from the options of its driver."""

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from cellwright.engine.pipelines.simulator.injections import Injection, injection
from cellwright.engine.ports import DriverSetup
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.numbers import NumberError, decimal


@dataclass(frozen=True, slots=True)
class Settings:
    """How a simulated cell behaves. Durations are spread evenly by a share around the forecast."""

    seed: int = 0
    factor: float = 0.0
    spread: float = 0.0
    lookahead: int = 1
    injections: tuple[Injection, ...] = ()
    log: str = ""


def settings_of(setup: DriverSetup, more: Sequence[str] = ()) -> Settings:
    """How a simulated cell behaves. `more` are options that its driver has beside these. Raises `InvalidInput`."""
    known = ("spread", "lookahead", "fault", "log", "truth", *more)
    if unknown := [name for name in setup.options if name not in known]:
        hint = f"one of: {', '.join(known)}"
        raise InvalidInput(
            [Diagnostic(Source("--option"), "K408", f"the simulator has no option '{unknown[0]}'", hint)]
        )
    return Settings(
        setup.seed,
        setup.factor,
        number_of(setup.options, "spread"),
        max(1, int(number_of(setup.options, "lookahead", 1))),
        tuple(injection(each.strip()) for each in setup.options.get("fault", "").split(";") if each.strip()),
        setup.options.get("log", ""),
    )


def number_of(options: Mapping[str, str], name: str, default: float = 0.0) -> float:
    """An option of a driver as a number. Raises `InvalidInput`."""
    try:
        return decimal(options[name]) if name in options else default
    except NumberError as error:
        said = f"'{options[name][:40]}' {error}"
        raise InvalidInput([Diagnostic(Source("--option"), "K107", said, f"write {name}=0.2")]) from None


def drawn(settings: Settings, action: str, time_: int, lasts_ms: int) -> int:
    """How long an action takes the n-th time: always the same for the same seed."""
    share = random.Random(f"{settings.seed} {action} {time_}").uniform(-1.0, 1.0)
    return max(0, round(lasts_ms * (1.0 + settings.spread * share)))
