"""Joint values from the command line, such as `0, -90, 1.2 rad`, for one of several arms."""

from pathlib import Path

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, unknown_name
from cellwright.kb.files import File
from cellwright.kb.loader.geometry_values import ANGLE, LENGTH, QuantityReader
from cellwright.kb.loader.reader import LoadFindings, require_valid
from cellwright.kb.loader.yaml_tree import YamlNode
from cellwright.kb.model.cell_model import Cell, JointKind


def read_configuration(
    text: str, cell: Cell, option: str = "--configuration"
) -> tuple[str, tuple[float, ...]]:
    """The arm, and its joint values in rad or m; bare numbers count degrees or metres.

    Raises `InvalidInput`.
    """
    findings, file = LoadFindings(), File.of(option, text)
    name, colon, listed = text.rpartition(":")
    arm = name.strip() or next(iter(cell.arms), "")
    if arm not in cell.arms or (not colon and len(cell.arms) > 1):
        raise InvalidInput([_ask_for_arm(arm if colon else "", cell, file)])
    joints, parts = cell.arms[arm].arm.joints, listed.split(",")
    if len(parts) != len(joints):
        hint = f"{arm} has {len(joints)} joints"
        raise InvalidInput(
            [Diagnostic(file.at(0), "K707", f"there are {len(parts)} joint values", hint)]
        )
    read, values, start = QuantityReader(findings, Path()), [], len(text) - len(listed)
    for joint, part in zip(joints, parts, strict=True):
        at = start + len(part) - len(part.lstrip())
        kind = LENGTH if joint.kind is JointKind.PRISMATIC else ANGLE
        values.append(read.number(YamlNode(part.strip(), file, at, start + len(part)), kind))
        start += len(part) + 1
    require_valid(findings)
    return arm, tuple(values)


def _ask_for_arm(arm: str, cell: Cell, file: File) -> Diagnostic:
    if arm:
        return unknown_name("arm", arm, cell.arms, file.at(0))
    hint = f"write one of: {', '.join(f'{name}: ...' for name in cell.arms)}" if cell.arms else ""
    return Diagnostic(
        file.at(0),
        "K005",
        "the arm for these joint values is not given",
        hint or "the cell has no arms",
    )
