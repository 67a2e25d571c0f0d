"""Devices in a domain: parameters, own names, ports, errors in the right file, and two of one
device.
"""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import File
from cellwright.kb.loader import load
from cellwright.kb.loader.device_uses import all_devices
from cellwright.kb.loader.device_uses.device_files import fill_file
from cellwright.kb.loader.fault_base import load_faults

SHAKER = """\
device: shaker
about: a shaker
use: {holding: {}}
include: [rules.lp]
parameters:
  capacity: {is: how many probes it holds, default: 1}
  lasts: {is: how long it shakes}
own:
  shake: the operator that shakes
  shaken: the event of a probe that was shaken
needs:
  hand: what presses its button
objects:
  unit: [$name]
events:
  $shaken(probe): {}
operators:
  $shake(Probe, Depot):
    where: part_of(Depot, $name)
    preconditions: at(Probe, Depot), free($hand)
    adds: $shaken(Probe)
    resources: $hand, Depot, Probe
    duration: $lasts
"""
RULES = "usual_capacity($name, $capacity).\naccessible(D) :- part_of(D, $name).\n"
FAULTS = """\
faults: shaker
exceptions:
  stalled:
    say: it does not turn
    of: $shake(Probe, Depot)
    causes: {clamp_loose: 8, '${hand_prefix}low_voltage': 2}
causes:
  clamp_loose: {say: the clamp is loose}
repairs:
  tighten: {say: tighten the clamp, cost: 15, cures: [clamp_loose]}
"""


def cell(folder: Path, use: str, more: str = "", shaker: str = SHAKER) -> Path:
    beside = folder / "devices" / "shaker"
    beside.mkdir(parents=True, exist_ok=True)
    for name, text in (("device.yaml", shaker), ("rules.lp", RULES), ("faults.yaml", FAULTS)):
        (beside / name).write_text(text, "utf-8")
    domain = folder / "domain.yaml"
    domain.write_text(f"domain: cell\nuse:\n{use}{more}", "utf-8")
    (folder / "faults.yaml").write_text("faults: cell\n", "utf-8")
    return domain


def refused(domain: Path) -> Diagnostic:
    with pytest.raises(InvalidInput) as error:
        load(domain)
    return error.value.diagnostics[0]


def test_a_device_brings_its_operators_and_takes_its_parameters(tmp_path: Path) -> None:
    domain = load(cell(tmp_path, "  gripper: {}\n  shaker: {lasts: 90 s}\n")).domain
    shake = next(each for each in domain.operators if each.name == "shake")
    assert str(shake.duration) == "90"
    assert {str(each) for each in shake.resources} >= {"hand"}


def test_two_of_one_device_have_names_and_faults_of_their_own(tmp_path: Path) -> None:
    use = (
        "  gripper: {}\n  shaker: {lasts: 90 s}\n  mixer: {device: shaker, lasts: 5 s, "
        "capacity: 3}\n"
    )
    path = cell(tmp_path, use)
    domain = load(path).domain
    names = {each.name for each in domain.operators}
    assert {"shake", "mixer_shake"} <= names
    assert {"shaken", "mixer_shaken"} <= set(domain.predicates)
    model, _ = load_faults(path)
    assert set(model.exceptions["mixer_stalled"].counts) == {"mixer_clamp_loose", "low_voltage"}
    assert model.exceptions["mixer_stalled"].say.endswith("(mixer)")
    assert dict(model.repairs["mixer_tighten"].cures) == {"mixer_clamp_loose": 1.0}


def test_costs_of_faults_are_seconds_in_any_cell(tmp_path: Path) -> None:
    use = "  gripper: {}\n  shaker: {lasts: 1 s}\n"
    in_s, _ = load_faults(cell(tmp_path / "s", use, "units: {time: s}\n"))
    in_ms, _ = load_faults(cell(tmp_path / "ms", use, "units: {time: ms}\n"))
    assert (in_s.repairs["tighten"].cost, in_ms.repairs["tighten"].cost) == (15, 15_000)


def test_an_own_name_can_be_given(tmp_path: Path) -> None:
    use = (
        "  gripper: {}\n  shaker: {lasts: 1 s}\n  mixer: {device: shaker, lasts: 5 s, shaken: "
        "shaken}\n"
    )
    domain = load(cell(tmp_path, use)).domain
    adders = {
        e.name for e in domain.operators if any("shaken" in str(effect) for effect in e.effects)
    }
    assert adders == {"shake", "mixer_shake"}


@pytest.mark.parametrize(
    ("use", "code", "said"),
    [
        ("  gripper: {}\n  shaker: {}\n", "K005", "lacks the parameter 'lasts'"),
        ("  shaker: {lasts: 1 s}\n", "K405", "no device offers one"),
        (
            "  gripper: {}\n  left: {device: gripper}\n  shaker: {lasts: 1 s}\n",
            "K405",
            "gripper and left",
        ),
        ("  gripper: {}\n  shaker: {last: 1 s}\n", "K101", "unknown parameter of shaker 'last'"),
        ("  gripper: {}\n  shakr: {}\n", "K101", "unknown device 'shakr'"),
        ("  gripper: {}\n  shaker: {lasts: '1 s #'}\n", "K005", "no value of a parameter"),
        ("  gripper: {}\n  gripper: {}\n", "K003", "already used"),
        ("  Furnace: {device: furnace}\n", "K112", "'Furnace' is not a name"),
    ],
)
def test_a_wrong_use_is_told_in_the_domain(tmp_path: Path, use: str, code: str, said: str) -> None:
    found = refused(cell(tmp_path, use))
    assert (found.code, found.where.path) == (code, str(tmp_path / "domain.yaml"))
    assert said in found.message
    assert found.where.line >= 3


def test_a_port_that_two_devices_offer_can_be_said(tmp_path: Path) -> None:
    use = "  gripper: {}\n  left: {device: gripper}\n  shaker: {lasts: 1 s, hand: left_hand}\n"
    domain = load(cell(tmp_path, use)).domain
    shake = next(each for each in domain.operators if each.name == "shake")
    assert "left_hand" in {str(each) for each in shake.resources}


def test_an_error_in_a_device_is_told_there_with_its_use(tmp_path: Path) -> None:
    wrong = SHAKER.replace("at(Probe, Depot), free", "att(Probe, Depot), free")
    found = refused(cell(tmp_path, "  gripper: {}\n  shaker: {lasts: 1 s}\n", shaker=wrong))
    assert found.where.path.endswith("devices/shaker/device.yaml")
    line = next(n for n, each in enumerate(wrong.split("\n"), 1) if "att(" in each)
    assert (found.where.line, found.where.column) == (
        line,
        wrong.split("\n")[line - 1].index("att(") + 1,
    )
    assert found.where.used is not None
    assert (found.where.used.path, found.where.used.line) == (str(tmp_path / "domain.yaml"), 4)
    assert f"used: {tmp_path / 'domain.yaml'}:4:3" in str(found)


def test_an_unknown_parameter_in_a_device_is_told_there(tmp_path: Path) -> None:
    wrong = SHAKER.replace("duration: $lasts", "duration: $nothing")
    found = refused(cell(tmp_path, "  gripper: {}\n  shaker: {lasts: 1 s}\n", shaker=wrong))
    assert (found.code, found.message) == ("K101", "unknown parameter 'nothing'")


def test_a_device_that_uses_itself_is_refused(tmp_path: Path) -> None:
    wrong = SHAKER.replace("{holding: {}}", "{inner: {device: shaker}}")
    assert refused(cell(tmp_path, "  shaker: {lasts: 1 s}\n", shaker=wrong)).code == "K109"


def test_two_parts_that_contradict_each_other_are_refused(tmp_path: Path) -> None:
    more = "fluents:\n  at(item, place): {weight: 7}\n"
    found = refused(cell(tmp_path, "  gripper: {}\n  shaker: {lasts: 1 s}\n", more))
    assert (found.code, found.where.path) == ("K104", str(tmp_path / "domain.yaml"))


def test_operators_can_be_left_out(tmp_path: Path) -> None:
    domain = load(
        cell(tmp_path, "  gripper: {}\n  shaker: {lasts: 1 s}\n", "without: [sense]\n")
    ).domain
    assert "sense" not in {each.name for each in domain.operators}
    assert (
        refused(cell(tmp_path, "  gripper: {}\n", "without: [sens]\n")).message
        == "unknown operator 'sens'"
    )


def test_faults_of_an_operator_that_is_left_out_are_left_out(tmp_path: Path) -> None:
    use = "  gripper: {}\n  shaker: {lasts: 1 s}\n"
    model, _ = load_faults(cell(tmp_path, use, "without: [sense, shake]\n"))
    assert not {"sensor_silent", "stalled"} & set(model.exceptions)
    assert "grip_failed" in model.exceptions
    assert all(each.by is None or each.by.name != "sense" for each in model.tests.values())


def test_an_operator_of_the_domain_takes_the_place_of_one_that_is_left_out(tmp_path: Path) -> None:
    own = """\
operators:
  shake(Probe, Depot):
    where: part_of(Depot, shaker)
    preconditions: at(Probe, Depot)
    adds: shaken(Probe)
    resources: Probe
    duration: 7 s
"""
    use = "  gripper: {}\n  shaker: {lasts: 90 s}\n"
    path = cell(tmp_path, use, f"without: [shake]\n{own}")
    shake = next(each for each in load(path).domain.operators if each.name == "shake")
    assert str(shake.duration) == "7"
    assert "stalled" in load_faults(path)[0].exceptions
    found = refused(cell(tmp_path, use, own))
    assert (found.code, "`without: [shake]`" in found.hint) == ("K104", True)


def test_every_device_of_the_engine_has_a_head_that_says_what_it_is(tmp_path: Path) -> None:
    devices = all_devices(tmp_path)
    assert len(devices) >= 14
    assert all(each.about and each.name == each.folder.name for each in devices)


VALUES = st.dictionaries(
    st.sampled_from(["a", "bc", "name"]), st.text("xyz_ 0,", max_size=6), min_size=1
)


@given(
    values=VALUES,
    parts=st.lists(st.tuples(st.text("pq \n", max_size=5), st.sampled_from(["a", "bc", "name"]))),
)
def test_each_place_of_a_filled_text_is_that_of_what_was_written(
    values: dict[str, str], parts: list[tuple[str, str]]
) -> None:
    text = (
        "".join(plain + (f"${{{name}}}" if name in values else "-") for plain, name in parts)
        + "end"
    )
    file = fill_file(File.of("f", text), tuple(values.items()), Source("domain.yaml", 1, 1))
    expected, places, at = "", [], 0
    for plain, name in parts:  # slow and plain: each character with the place that it comes from
        for character in plain:
            expected, places, at = expected + character, [*places, at], at + 1
        shown = values.get(name, "-")
        expected, places = expected + shown, [*places, *([at] * len(shown))]
        at += len(name) + 3 if name in values else 1
    places += [at, at + 1, at + 2]
    assert file.text == expected + "end"
    for index, origin in enumerate(places):
        assert file.at(index) == file.written.at(origin)
        assert file.at(index).used == Source("domain.yaml", 1, 1)
