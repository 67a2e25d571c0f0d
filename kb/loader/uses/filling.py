"""The file of a device with its parameters filled in. Places in it are told as places in the file as it was written."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from cellwright.kb.diagnostics import InvalidInput, Source, unknown_name
from cellwright.kb.files import File, read_file

PARAMETER = re.compile(
    r"^[ \t]*[#%][^\n]*|\$(?:([A-Za-z_][A-Za-z0-9_]*)|\{([A-Za-z_][A-Za-z0-9_]*)\}|(\$))", re.MULTILINE
)  # lines that are comments stay as they are
DIGITS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine")
Values = tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class Filled(File):
    """A file with values for its parameters. `cuts` are the (start, end, start as written) of each value in the text."""

    written: File
    cuts: tuple[tuple[int, int, int], ...]
    values: Values
    used: Source

    def at(self, index: int) -> Source:
        """The place of a character in the file as it was written, with the place of the use."""
        return replace(self.written.at(self.as_written(index)), used=self.used)

    def beside(self, path: Path) -> File:
        """Another file of the device, filled in with the same values."""
        return filled(read_file(path), self.values, self.used)

    def user(self) -> Source | None:
        """The place where the device is used."""
        return self.used

    def as_written(self, index: int) -> int:
        """Where a character of the text stands in the file as it was written."""
        shift = 0
        for start, end, origin in self.cuts:
            if index < start:
                break
            if index < end:
                return origin
            shift = _after(self.written.text, origin) - end
        return index + shift


def _after(text: str, start: int) -> int:
    found = PARAMETER.match(text, start)
    return found.end() if found else start


def filled(file: File, values: Values, used: Source) -> Filled:
    """The file with these values in place of `$name` and `${name}`; `$$` is one `$`. Raises `InvalidInput`."""
    known, parts, cuts, wrong = dict(values), [], [], []
    done = length = 0
    for found in PARAMETER.finditer(file.text):
        name = found[1] or found[2]
        if name is None and not found[3]:
            continue
        if name is not None and name not in known:
            where = replace(file.at(found.start()), used=used)
            plain = [each for each in known if not each.endswith("_words")]
            found_none = unknown_name(
                "parameter", name, plain if not name.endswith("_words") else known, where
            )
            advice = f"{found_none.hint}; or declare it, under `own` for a name of the device, or under `parameters`"
            wrong.append(replace(found_none, hint=advice))
        value = "$" if name is None else known.get(name, name)
        parts += [file.text[done : found.start()], value]
        length += found.start() - done
        cuts.append((length, length + len(value), found.start()))
        length, done = length + len(value), found.end()
    if wrong:
        raise InvalidInput(wrong)
    text = "".join([*parts, file.text[done:]])
    starts = File.of(file.path, text).line_starts
    return Filled(file.path, text, starts, file, tuple(cuts), values, used)


def all_values(values: Mapping[str, str]) -> Values:
    """The values, and for each name `NAME_words`: how people say it, with blanks for underscores and words for digits."""
    worded = {f"{key}_words": _spoken(value) for key, value in values.items() if _is_name(value)}
    return tuple({**worded, **values}.items())


def _spoken(name: str) -> str:
    return " ".join(re.sub(r"\d", lambda found: f" {DIGITS[int(found[0])]} ", name).replace("_", " ").split())


def _is_name(value: str) -> bool:
    return re.fullmatch(r"[a-z][A-Za-z0-9_]*", value) is not None
