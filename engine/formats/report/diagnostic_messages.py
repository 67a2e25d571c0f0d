"""Diagnostics as text: place, code, message, the line with a caret, and what to try."""

from collections.abc import Iterable

from rich.text import Text

from cellwright.kb.diagnostics import Diagnostic


def diagnostics_text(findings: Iterable[Diagnostic]) -> Text:
    """The diagnostics one after another. Colours do not change the characters."""
    return Text("\n").join([_diagnostic_text(finding) for finding in findings])


def _diagnostic_text(diagnostic: Diagnostic) -> Text:
    text = Text(str(diagnostic))
    first = text.plain.split("\n", 1)[0]
    place = len(str(diagnostic.where))
    severity = first.index(diagnostic.code)
    text.stylize("bold", 0, place)
    text.stylize("yellow" if diagnostic.warning else "bold red", place + 2, severity)
    for index, line in enumerate(text.plain.split("\n")):
        start = sum(len(text_line) + 1 for text_line in text.plain.split("\n")[:index])
        if line.strip() == "^":
            text.stylize("bold green", start, start + len(line))
        elif line.startswith("  try: "):
            text.stylize("cyan", start, start + len(line))
    return text


def diagnostics_summary(findings: Iterable[Diagnostic]) -> str:
    """The numbers of errors and warnings."""
    errors = warnings = 0
    for finding in findings:
        warnings += finding.warning
        errors += not finding.warning
    parts = [_count_noun(errors, "error"), _count_noun(warnings, "warning")]
    return ", ".join(part for part in parts if part) or "no errors"


def _count_noun(count: int, noun: str) -> str:
    return "" if not count else f"{count} {noun}{'' if count == 1 else 's'}"
