"""The `Domain` in a `domain.yaml`, with its motion, its devices and its ASP files."""

import re
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

from cellwright.kb.commands import check_phrases
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import File, is_there, read_file
from cellwright.kb.loader.asp_files import read_rules
from cellwright.kb.loader.declarations import read_conventions, read_declarations
from cellwright.kb.loader.deductive_operators import read_deductive_operators, read_defaults
from cellwright.kb.loader.device_uses import compose_devices, composed_beside
from cellwright.kb.loader.operator_reader import read_operators
from cellwright.kb.loader.reader import LoadFindings, Reader, require_valid, validate_shape
from cellwright.kb.loader.symbol_table import SymbolTable
from cellwright.kb.loader.time_windows import TimeReader
from cellwright.kb.loader.yaml_tree import YamlNode
from cellwright.kb.model.condition_forms import with_named_values
from cellwright.kb.model.domain_model import (
    DISTANCE_TERM,
    RUN_TOOLS,
    USUAL_GRACE_S,
    WORLD_FRAME,
    Domain,
    Motion,
    Phrase,
    Predicate,
    ReplyTimes,
)
from cellwright.kb.model.name_conventions import CONVENTION_BY_NAME
from cellwright.kb.syntax import SECONDS_PER_UNIT, unit_seconds

UNIT_MICROMETRES = {"m": 1_000_000, "cm": 10_000, "mm": 1_000, "in": 25_400}
SPEED_TEXT = re.compile(rf"([0-9]+(?:\.[0-9]+)?)\s*({'|'.join(UNIT_MICROMETRES)})\s*/\s*([a-z]+)")
DURATION_TEXT = re.compile(r"([0-9]+(?:\.[0-9]+)?)\s*([a-z]*)")
MAX_SETTLING_S = Fraction(86_400)  # seconds
FACTOR_TEXT = re.compile(r"\d{1,6}(\.\d{1,6})?")
MAX_TIMEOUT_FACTOR = 1000
MAX_TIMEOUT_FLOOR_S = 30 * 86_400
MAX_SPEED_UM_PER_S = Fraction(10**10)  # micrometres per second
MIN_SPEED_UM_PER_S = Fraction(1, 10**3)


def read_motion(reader: Reader, names: SymbolTable) -> Motion | None:
    """The motion that a domain declares; None if it declares none, or one that is reported."""
    if "motion" not in reader.root.value:
        return None
    names.travel = reader.text("conventions", "travel") or CONVENTION_BY_NAME["travel"].role
    where = reader.root.value["motion"][0].where
    _refuse_others(where, names)
    if not reader.text("motion", "speed"):
        reader.findings.add(
            where, "K005", "`motion:` without a speed", "write `speed: 250 mm/s` below it"
        )
        return None
    speed = _read_speed(reader.root.descend(("motion", "speed")), reader)
    settling = _read_settling(reader)
    if speed is None or settling is None:
        return None
    return Motion(speed, settling, reader.text("motion", "frame") or WORLD_FRAME, where)


def _read_speed(node: YamlNode, reader: Reader) -> Fraction | None:
    """Micrometres per unit of the domain's time."""
    match = SPEED_TEXT.fullmatch(str(node.value).strip())
    unit = unit_seconds(match[3]) if match else None
    if match is None or unit is None:
        hint = "write 250 mm/s, 0.2 m/s or 12 m/min"
        reader.findings.add(node.where, "K005", f"'{str(node.value)[:40]}' is not a speed", hint)
        return None
    per_second = Fraction(match[1]) * UNIT_MICROMETRES[match[2]] / unit
    if not MIN_SPEED_UM_PER_S <= per_second <= MAX_SPEED_UM_PER_S:
        hint = "a speed must be greater than 0, and less than 10 km/s"
        reader.findings.add(node.where, "K113", f"the speed {match[0]} is out of range", hint)
        return None
    return per_second * SECONDS_PER_UNIT[reader.time_unit]


def _read_settling(reader: Reader) -> Fraction | None:
    """Units of the domain's time, 0 if nothing is said."""
    text, node = (
        reader.text("motion", "settling").strip(),
        reader.root.descend(("motion", "settling")),
    )
    if not text:
        return Fraction(0)
    match = DURATION_TEXT.fullmatch(text)
    unit = unit_seconds(match[2] or reader.time_unit) if match else None
    if match is None or unit is None:
        hint = "write 300 ms, 0.5 s or 0"
        reader.findings.add(node.where, "K005", f"'{text[:40]}' is not a time of 0 or more", hint)
        return None
    settling = Fraction(match[1]) * unit
    if settling > MAX_SETTLING_S:
        reader.findings.add(
            node.where,
            "K113",
            f"the settling time {match[0]} is longer than a day",
            "check the unit",
        )
        return None
    return settling / SECONDS_PER_UNIT[reader.time_unit]


def read_reply_times(reader: Reader) -> ReplyTimes:
    """After how long without a reply commands are given up, as the domain says."""
    usual = ReplyTimes()
    if "timeouts" not in reader.root.value:
        return usual
    factor, floor = usual.factor, Fraction(USUAL_GRACE_S)
    if text := reader.text("timeouts", "factor").strip():
        match = FACTOR_TEXT.fullmatch(text)
        factor = Fraction(text) if match else Fraction(0)
        if not 1 <= factor <= MAX_TIMEOUT_FACTOR:
            place = reader.root.descend(("timeouts", "factor")).where
            hint = f"write a number from 1 to {MAX_TIMEOUT_FACTOR}, such as 1.5"
            reader.findings.add(place, "K005", f"'{text[:40]}' is not a factor", hint)
            factor = usual.factor
    if text := reader.text("timeouts", "floor").strip():
        match = DURATION_TEXT.fullmatch(text)
        unit = unit_seconds(match[2] or reader.time_unit) if match else None
        if match is None or unit is None:
            place = reader.root.descend(("timeouts", "floor")).where
            hint = "write 30 s, 2 min or 0"
            reader.findings.add(place, "K005", f"'{text[:40]}' is not a time of 0 or more", hint)
        else:
            floor = min(Fraction(match[1]) * unit, Fraction(MAX_TIMEOUT_FLOOR_S))
    return ReplyTimes(factor, floor)


def _refuse_others(where: Source, names: SymbolTable) -> None:
    """Report whatever else has one of the names that durations use for ways between places.

    A table of travel times, with places and a number, is no other thing: its facts come first.
    """
    for name in (names.travel, DISTANCE_TERM):
        declared = names.predicates.get(name) or names.functions.get(name)
        table = name == names.travel and isinstance(declared, Predicate) and _is_table(declared)
        if declared is not None and not table:
            message = (
                f"with `motion:`, durations call a number '{name}', but line "
                f"{declared.where.line} declares it"
            )
            names.findings.add(where, "K104", message, "give the other one another name")


def _is_table(predicate: Predicate) -> bool:
    return CONVENTION_BY_NAME["travel"].deviation(predicate.kind.value, predicate.arguments) is None


Rewrite = Callable[[Path], File | None]


def as_written(_path: Path) -> None:
    """No other text than that of the file."""


def read_domain(
    path: Path, findings: LoadFindings, rewrite: Rewrite = as_written
) -> tuple[Domain, SymbolTable]:
    """The domain in a file and its symbol table. `rewrite` may give another text for the file.

    Raises `InvalidInput` if its form is wrong; other errors are noted.
    """
    reader = Reader.of(rewrite(path) or read_file(path), findings)
    compose_devices(reader, path)
    if not validate_shape(reader, "domain"):
        require_valid(findings)
    reader.time_unit = reader.text("units", "time") or "s"
    names = SymbolTable(findings)
    read_declarations(reader, names)
    asp, rules = read_rules(reader, names, path.parent)
    motion = read_motion(reader, names)
    operators = read_operators(reader, names)
    times = TimeReader(reader, names, {operator.name: operator for operator in operators})
    domain = Domain(
        str(reader.root.descend(("domain",)).value),
        names.types,
        names.functions,
        dict(names.objects),
        names.predicates,
        operators=operators,
        deductive_operators=read_deductive_operators(reader, names),
        defaults=read_defaults(reader, names),
        asp=tuple(asp),
        rules=tuple(rules),
        time_unit=reader.time_unit,
        motion=motion,
        reply_times=read_reply_times(reader),
        words=_read_words(reader),
        phrases=tuple(_read_phrases(reader)),
        path=str(path),
        renamed=read_conventions(reader, names),
        quantities=names.quantities,
        windows=tuple(times.windows()),
        calendars=tuple(times.calendars()),
        tools=tuple(dict.fromkeys(str(node.value) for node in reader.items("tools"))) or RUN_TOOLS,
    )
    for diagnostic in check_phrases(domain, reader.place_under("commands")):
        # what follows from a missing type
        if not names.missing & {*re.findall(r"\w+", diagnostic.message)}:
            findings.note(diagnostic)
    return with_named_values(domain), names


def read_beside(
    domain: Path, name: str, form: str, what: str
) -> tuple[Reader, Domain, SymbolTable]:
    """A file beside a domain file, read in a form of `cellwright.kb.schema`, with the domain
    and its names. Raises `InvalidInput`.
    """
    path = domain.with_name(name)
    if not is_there(path):
        hint = f"write one: `cellwright schema {form}` shows its form"
        raise InvalidInput(
            [Diagnostic(Source(str(path)), "K405", f"this domain has no {what}", hint)]
        )
    known, names = read_domain(domain, LoadFindings())
    reader = Reader.of(read_file(path), LoadFindings())
    composed_beside(reader, domain, form)
    if not validate_shape(reader, form):
        require_valid(reader.findings)
    names.findings = reader.findings
    return reader, known, names


def _read_words(reader: Reader) -> dict[str, tuple[str, ...]]:
    entries = reader.entries("commands", "words")
    return {key: tuple(str(item.value) for item in node.value) for key, _, node in entries}


def _read_phrases(reader: Reader) -> list[Phrase]:
    phrases = []
    for node in reader.items("commands", "phrases"):
        value = {key: str(item.value) for key, (_, item) in node.value.items()}
        if bool(value.get("goal")) == bool(value.get("stage")):
            reader.findings.add(
                node.where,
                "K005",
                "a phrase needs either a goal or a stage",
                "give exactly one of them",
            )
        where = node.value["say"][1].where
        goal, stage, subject = (value.get(key, "") for key in ("goal", "stage", "subject"))
        phrases.append(Phrase(value["say"], goal, stage, subject, where))
    return phrases
