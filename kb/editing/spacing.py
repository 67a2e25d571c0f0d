"""The usual spaces in an expression, and in ASP. Only white space changes; alignment by hand in ASP stays."""

from functools import lru_cache

from cellwright.kb.editing.tokens import Token, tokens

_RELATIONS = {"=", "==", "!=", "<>", "<", "<=", ">", ">=", ":-", ":~", "|", "&"}
_TIGHT_BEFORE = {",", ";", ")", "]", "."}
_TIGHT_AFTER = {"(", "["}


@lru_cache(8192)
def spaced(text: str) -> str:
    """An expression of one line with its usual spaces: `at(Item,Place)` becomes `at(Item, Place)`."""
    found = tokens(text.strip())
    parts: list[str] = []
    for number, token in enumerate(found):
        if number:
            before = found[number - 1]
            gap = text.strip()[before.end : token.start]
            parts.append(_gap(before, token, gap))
        parts.append(token.text)
    return "".join(parts)


def spaced_rules(text: str) -> str:
    """ASP with its usual spaces. Lines, indentation, comments and columns aligned with several spaces stay; the first
    line has no indentation."""
    found = tokens(text, True)
    parts: list[str] = []
    end = 0
    for number, token in enumerate(found):
        gap = text[end : token.start]
        if "\n" in gap or not number:
            parts.append(_lines(gap) if number else "")
        elif (
            token.kind == "comment"
            or found[number - 1].text in (".", "]")
            or (len(gap) > 1 and _may_align(token))
        ):
            parts.append(gap.expandtabs(4) if gap or token.kind != "comment" else " ")
        else:
            parts.append(_gap(found[number - 1], token, gap))
        parts.append(token.text.rstrip() if token.kind == "comment" else token.text)
        end = token.end
    return "".join(parts).rstrip() + "\n" if found else ""


def _may_align(token: Token) -> bool:
    return token.text not in _TIGHT_BEFORE


def _lines(gap: str) -> str:
    """The ends of lines between two tokens: at most one blank line, and the indentation of the next line."""
    indent = gap.rpartition("\n")[2].expandtabs(4)
    return "\n" * min(gap.count("\n"), 2) + indent


def _gap(before: Token, token: Token, gap: str) -> str:
    """What stands between two tokens of a line."""
    if token.text in _TIGHT_BEFORE or before.text in _TIGHT_AFTER:
        return ""
    if before.text in (",", ";") or before.text in _RELATIONS or token.text in _RELATIONS:
        return " "
    if token.text == ":" or before.text == ":":
        return " "
    if token.text == "(" and before.kind == "name" and before.text != "not":
        return ""
    return " " if gap else ""


def same_but_for_spaces(one: str, other: str) -> bool:
    """Whether two expressions have the same tokens."""
    return one == other or _texts(one) == _texts(other)


def _texts(text: str) -> list[str]:
    return [token.text for token in tokens(text)]
