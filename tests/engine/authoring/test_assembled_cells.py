"""Cells put together from devices plan, run in the simulated cell, fail and recover: each
device alone, and any of them together.
"""

import itertools
import json
import random
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from cellwright.engine.authoring.starter import assemble_domain, create_with
from cellwright.engine.faces.cli import app
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load
from cellwright.kb.loader.device_uses import all_devices
from cellwright.kb.loader.fault_base import load_faults

DEVICES = [
    "balance",
    "barcode_reader",
    "camera",
    "capper",
    "centrifuge",
    "conveyor",
    "dispenser",
    "drawer",
    "freezer",
    "furnace",
    "heater_shaker",
    "incubator",
    "laser_tool",
    "liquid_handler",
    "person",
    "plate_hotel",
    "plate_reader",
    "rack",
    "sealer",
    "tool_rack",
    "ultrasonic_tool",
    "washer",
]
PLATES = ["incubator", "liquid_handler", "plate_reader", "sealer", "washer"]
OTHERS = [device for device in DEVICES if device not in PLATES]
TOGETHER = [tuple(random.Random(seed).choices(OTHERS, k=2 + seed % 4)) for seed in range(12)]
TOGETHER += [(each, *random.Random(each).choices(OTHERS, k=2)) for each in PLATES]
TOGETHER += [tuple(PLATES[1:])]  # an incubator has many shelves: its runs take long


def answer(*arguments: object) -> tuple[int, dict[str, Any]]:
    result = CliRunner().invoke(app, [*map(str, arguments), "--format", "json"])
    data: dict[str, Any] = json.loads(result.stdout)["data"]
    return result.exit_code, data


def assert_all_works(folder: Path, devices: tuple[str, ...]) -> None:
    """Nothing is wrong with the cell, it runs, and after each fault that its devices propose
    the goals are still reached.
    """
    _, faults = create_with(folder, devices)
    assert answer("check", folder)[0] == 0
    problem = folder / "problems" / "first.yaml"
    assert answer("run", problem)[0] == 0
    steps = {
        step["operator"].partition("(")[0] for step in answer("plan", problem)[1]["plan"]["steps"]
    }
    tried = [each for each in faults if each.partition("=")[0] in steps]
    assert tried or not faults
    for fault in tried:
        code, ran = answer("run", problem, "--fault", fault)
        assert (fault, code) == (fault, 0)
        assert ran["exceptions"] == 1


@pytest.fixture(autouse=True)
def _own_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs are kept beside the cell: tests at the same moment would take each other's names."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


def test_a_cell_of_two_furnaces_fails_and_recovers(tmp_path: Path) -> None:
    assert_all_works(tmp_path / "cell", ("furnace", "furnace"))


@pytest.mark.slow
@pytest.mark.parametrize("device", DEVICES)
def test_each_device_alone_makes_a_cell(tmp_path: Path, device: str) -> None:
    assert_all_works(tmp_path / "cell", (device,))


@pytest.mark.slow
@pytest.mark.parametrize("devices", TOGETHER, ids="+".join)
def test_any_devices_make_a_cell_together(tmp_path: Path, devices: tuple[str, ...]) -> None:
    assert_all_works(tmp_path / "cell", devices)


def test_the_devices_tried_are_those_that_there_are(tmp_path: Path) -> None:
    shared = {"holding", "closing", "measuring", "gripper"}
    assert {each.name for each in all_devices(tmp_path)} - shared == set(DEVICES)


def test_an_unknown_device_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="unknown device 'furnance'"):
        create_with(tmp_path / "cell", ["furnance"])
    assert not (tmp_path / "cell").exists()


@pytest.mark.parametrize("devices", ["", " , "])
def test_no_devices_are_a_misuse(tmp_path: Path, devices: str) -> None:
    result = CliRunner().invoke(app, ["init", str(tmp_path / "cell"), "--with", devices])
    assert (result.exit_code, list(tmp_path.iterdir())) == (2, [])


def test_a_device_can_be_given_a_name(tmp_path: Path) -> None:
    create_with(tmp_path / "cell", ["hotel=plate_hotel", "dispenser"])
    domain = (tmp_path / "cell" / "domain.yaml").read_text("utf-8")
    assert "  hotel: {device: plate_hotel}\n" in domain
    assert (
        "  dispenser: {holder: rack}\n" in domain
    )  # nobody doses into a plate that has another one above it
    problem = (tmp_path / "cell" / "problems" / "first.yaml").read_text("utf-8")
    assert "own_depot(probe_1, slot(hotel, 1))" in problem
    assert answer("run", tmp_path / "cell" / "problems" / "first.yaml")[0] == 0


def test_what_only_lies_in_a_hotel_needs_no_rack(tmp_path: Path) -> None:
    written, _ = assemble_domain(tmp_path, "cell", ["plate_hotel", "heater_shaker"])
    assert "rack" not in written["domain.yaml"]


@pytest.mark.parametrize("name", ["A", "2nd", "", "bin", "not so"])
def test_a_name_that_cannot_be_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InvalidInput, match="cannot be the name"):
        create_with(tmp_path / "cell", ["bin=rack", f"{name}=rack"])


def test_all_devices_in_one_cell_contradict_each_other_nowhere(tmp_path: Path) -> None:
    written, _ = assemble_domain(tmp_path, "cell", DEVICES)
    for name, text in written.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, "utf-8")
    assert load(tmp_path / "domain.yaml").domain.operators
    model, _ = load_faults(tmp_path / "domain.yaml")
    assert len(model.causes) > 50


@pytest.mark.parametrize(
    "devices", list(itertools.permutations(["capper", "dispenser", "conveyor"]))
)
def test_a_probe_arrives_is_filled_and_is_closed_in_whatever_order_devices_are_named(
    tmp_path: Path, devices: tuple[str, ...]
) -> None:
    written, _ = assemble_domain(tmp_path, "cell", devices)
    assert (
        "stages: inside(P, conveyor), filled(P, 5), capped(P), stored(P)"
        in written["problems/first.yaml"]
    )
