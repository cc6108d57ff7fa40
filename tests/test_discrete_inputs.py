"""Inputs that are true or false, whole numbers, items or texts: given by signals and events, at the right time."""

# ruff: noqa: E501 (pieces of XML, one case a line)

import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import cosim
from cosim.cli import main
from cosim.tests.driving import scenario

from .stub.stub import make_fmu, write

LEADER = '<torque tau_drive="2 N.m" tau_steer="0 N.m"/>'
ACCELERATION = 0.2
STEP = 0.02


def written(folder: Path, inputs: str, *, plant: str = "", more: str = "", **options: Any) -> Path:
    """Write a scenario with a leader, a stub with discrete inputs, and values for them."""
    fmu = make_fmu(folder, **{"discrete": True} | options)
    path = scenario(folder / "s.xml", f'<plant id="car" fmu="{fmu}" {plant}/>', more=more)
    text = path.read_text(encoding="utf-8")
    assert LEADER in text
    path.write_text(text.replace(LEADER, LEADER + inputs), encoding="utf-8")
    return path


def gains(result: xr.Dataset) -> np.ndarray:
    """Return the factor of the leader's acceleration in each step."""
    return np.diff(result["leader_velocity"].values[:, 0]) / (ACCELERATION * STEP)


def course(*pieces: tuple[float, float]) -> np.ndarray:
    """Return the gain of each of 50 steps: pieces of a time until which [s], and a gain."""
    ends = [round(end / STEP) for end, _ in pieces]
    return np.repeat([gain for _, gain in pieces], np.diff([0, *ends]))


INPUTS = """
    <input name="enable"><constant value="false"/><pulse value="true" from="0.2 s" to="0.6 s"/></input>
    <input name="gear"><constant value="1"/><step value="2" at="0.4 s"/></input>"""
EVENT = """<event at="0.5 s" robots="leader follower_1"><input name="direction" value="backward"/></event>
<event at="0.9 s" robots="leader"><input name="enable" value="1"/><input name="direction" value="forward"/></event>"""


@pytest.mark.parametrize(
    ("plant", "options"),
    [
        ("", {"fmi": "1.0"}),
        ("", {"fmi": "2.0"}),
        ("", {"fmi": "3.0"}),
        ("", {"fmi": "2.0", "interface": "model_exchange"}),
        ("", {"fmi": "3.0", "interface": "model_exchange"}),
        ('solver="cvode"', {"fmi": "3.0", "interface": "model_exchange"}),
        ('isolate="process" time_limit="30 s"', {"fmi": "2.0"}),
        ('isolate="process" time_limit="30 s"', {"fmi": "3.0", "interface": "model_exchange"}),
    ],
)
def test_inputs_change_at_their_times(tmp_path: Path, plant: str, options: dict[str, str]) -> None:
    """Whole numbers add up; of true and false the signal that is written last counts, and an event from its time on."""
    result = cosim.run(written(tmp_path, INPUTS, plant=plant, more=EVENT, **options))
    expected = course((0.2, 0), (0.4, 1), (0.5, 3), (0.6, -3), (0.9, 0), (1.0, 3))
    assert gains(result) == pytest.approx(expected, abs=1e-5 if "cvode" in plant else 1e-11)


def test_an_input_may_have_one_value(tmp_path: Path) -> None:
    result = cosim.run(written(tmp_path, '<input name="gear" value="-2"/><input name="note" value="hello there"/>'))
    assert gains(result) == pytest.approx(course((1.0, -2)))
    assert "the note says hello there" in result.attrs["plant_messages"]


@pytest.mark.parametrize("interface", ["co_simulation", "model_exchange"])
def test_an_input_may_be_set_as_a_parameter(tmp_path: Path, interface: str) -> None:
    more = '<event at="0.5 s" robots="leader"><parameter name="gear" value="3"/></event>'
    given = '<parameter name="gear" value="2"/><parameter name="push" value="1 N"/>'
    result = cosim.run(written(tmp_path, given, more=more, interface=interface))
    assert gains(result) == pytest.approx(course((0.5, 2), (1.0, 3)) + 0.1 / ACCELERATION)


def test_plants_are_compared_with_inputs_of_their_own(tmp_path: Path) -> None:
    fmu = make_fmu(tmp_path, discrete=True)
    options: dict[str, Any] = {"duration": 1.0, "torque": np.full((50, 2), 1.0), "isolated": False}
    still, moving = cosim.PlantFile(fmu, parameters={"enable": "false"}), cosim.PlantFile(fmu, parameters={"gear": "2"})
    comparison = cosim.compare_plants(still, moving, **options)
    assert [states[-1, 4] for states in comparison.states] == pytest.approx([0.0, 0.2])


def test_a_signal_that_does_not_act_leaves_the_fmu_s_start_value(tmp_path: Path) -> None:
    result = cosim.run(written(tmp_path, '<input name="enable"><pulse value="0" from="0.4 s" to="0.6 s"/></input>'))
    assert gains(result) == pytest.approx(course((0.4, 1), (0.6, 0), (1.0, 1)))


@pytest.mark.parametrize(
    ("name", "rows", "expected"),
    [
        ("gear", "0.1,2\n0.4,-1", course((0.4, 2), (1.0, -1))),
        ("enable", "0,0\n0.3,1", course((0.3, 0), (1.0, 1))),
        ("direction", "0,1\n0.3,3", course((0.3, 1), (1.0, -1))),
    ],
)
def test_a_table_holds_from_row_to_row(tmp_path: Path, name: str, rows: str, expected: np.ndarray) -> None:
    (tmp_path / "t.csv").write_text(f"time [s],it\n{rows}\n", encoding="utf-8")
    result = cosim.run(written(tmp_path, f'<input name="{name}"><table file="t.csv" column="it"/></input>'))
    assert gains(result) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("inputs", "more", "sentence"),
    [
        ('<input name="enable"><sine value="1" period="1 s"/></input>', "", "'enable' is true or false and takes no <sine>; it takes <constant>, <step>, <pulse> and <table>"),
        ('<input name="gear"><ramp value="3" from="0 s" to="1 s"/></input>', "", "'gear' is a whole number and takes no <ramp>"),
        ('<input name="note"><table file="t.csv" column="it"/></input>', "", "'note' is a text and takes no <table>"),
        ('<input name="enable" value="maybe"/>', "", "value=\"maybe\" of <constant>: 'maybe' is neither true nor false"),
        ('<input name="gear" value="1.5"/>', "", "'1.5' is not a whole number"),
        ('<input name="gear" value="1 m"/>', "", "'1 m' is not a whole number"),
        ('<input name="gear" value="+-1"/>', "", "'+-1' is not a whole number"),
        ('<input name="gear" value="2000000000"/><input name="gear" value="2000000000"/>', "", "the input 'gear' at 0 s: 4000000000 is out of bounds; a Integer is from"),
        ('<input name="direction" value="bacward"/>', "", "'bacward' is none of its items: did you mean 'backward'"),
        ('<input name="enable"><table file="t.csv" column="it"/></input>', "", "the column 'it' of"),
        ('<input name="enabled" value="true"/>', "", "the FMU stub.fmu has no input 'enabled': did you mean 'enable'"),
        ('<input name="tau_drive" value="strong"/>', "", "value=\"strong\" of <constant>: 'strong' is not a number with a unit"),
        ('<input name="enable"/>', "", "an <input> takes either value=\"...\" or signals within it"),
        ('<input name="enable" value="1"><constant value="1"/></input>', "", "an <input> takes either value=\"...\" or signals within it"),
        ('', '<event at="0 s" robots="leader"><input name="enable"><constant value="1"/></input></event>', "an <input> of an event takes value="),
        ('', '<event at="0 s" robots="leader"><input name="gear" value="x"/></event>', "value=\"x\" of the input 'gear': 'x' is not a whole number"),
        ('', '<event at="0 s" robots="leader"><input name="gear" value="1"/><input name="gear" value="2"/></event>', "the input 'gear' is given twice"),
        ('', '<event at="0 s" robots="leader"><input name="tau_drive" value="1 N.m"/></event>', "an event cannot set 'tau_drive', which a controller or the <torque> of the leader commands"),
        ('<parameter name="tau_steer" value="1 N.m"/>', "", "has no parameter 'tau_steer'"),
        ('<parameter name="gear" value="x"/>', "", "parameter gear of stub.fmu: 'x' is not a whole number"),
        ('<parameter name="gear" value="2"/><input name="gear" value="3"/>', "", "the input 'gear' is given a value as <parameter> and as <input>: remove one"),
        ('<input name="gear" value="3"/>', '<event at="0 s" robots="leader"><parameter name="gear" value="1"/></event>', "the input 'gear' is given a value as <parameter> and as <input>: remove one"),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_refused_at_its_place(tmp_path: Path, inputs: str, more: str, sentence: str) -> None:
    (tmp_path / "t.csv").write_text("time [s],it\n0,0\n1,2\n", encoding="utf-8")
    with pytest.raises(cosim.InputError, match=re.escape(sentence)) as caught:
        cosim.run(written(tmp_path, inputs, more=more))
    assert re.match(r".*s\.xml:\d+:\d+$", str(caught.value.where))


@pytest.mark.parametrize(
    ("inputs", "more"),
    [
        ('<input name="push"><constant value="{}"/></input>', ""),
        ('<parameter name="push" value="{}"/>', ""),
        ('', '<event at="0 s" robots="leader"><input name="push" value="{}"/></event>'),
    ],
)  # fmt: skip
def test_a_unit_that_contradicts_its_name_takes_the_bare_number(tmp_path: Path, inputs: str, more: str) -> None:
    """A binding does not decide about inputs without a role: here 1 N is 2 N, by the FMU's definition."""
    fmu = make_fmu(tmp_path, discrete=True)
    with zipfile.ZipFile(fmu) as archive:
        content = {name: archive.read(name) for name in archive.namelist()}
    newton = b'<Unit name="N"><BaseUnit kg="1" m="1" s="-2"/>'
    assert newton in content["modelDescription.xml"]
    wrong = content["modelDescription.xml"].replace(newton, newton.replace(b"/>", b' factor="2"/>'))
    path = written(tmp_path / "s", inputs.format("1 N"), more=more.format("1 N"))
    write(tmp_path / "s" / "stub.fmu", content | {"modelDescription.xml": wrong})
    sentence = "by the name, 1 N is 1 N, by the definition 2 N: give the bare number, as the FMU counts"
    with pytest.raises(cosim.InputError, match=sentence):
        cosim.run(path)
    path.write_text(path.read_text(encoding="utf-8").replace('"1 N"', '"1"'), encoding="utf-8")
    assert gains(cosim.run(path)) == pytest.approx(course((1.0, 1 + 0.1 / ACCELERATION)))


@pytest.mark.parametrize(
    ("before", "after", "inputs"),
    [
        (r'(name="push".*?start=")[^"]*', r"\1abc", '<input name="push"><constant value="1 N"/></input>'),
        (r'(name="direction".*?start=")[^"]*', r"\1abc", '<input name="direction"><step value="backward" at="0.5 s"/></input>'),
        (r'(name="drive".*?start=")[^"]*', r"\1abc", ""),
    ],
)  # fmt: skip
def test_a_start_value_that_is_no_number_is_told(tmp_path: Path, before: str, after: str, inputs: str) -> None:
    """The schema does not allow it, which is but a warning."""
    path = written(tmp_path, inputs)
    with zipfile.ZipFile(tmp_path / "stub.fmu") as archive:
        content = {name: archive.read(name) for name in archive.namelist()}
    text, changed = re.subn(before, after, content["modelDescription.xml"].decode(), count=1, flags=re.DOTALL)
    assert changed
    write(tmp_path / "stub.fmu", content | {"modelDescription.xml": text.encode()})
    with pytest.raises(cosim.InputError, match=r"has the start value 'abc' of '.*', which is no number"):
        cosim.run(path)


def test_what_another_fmu_lacks_is_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path, INPUTS, more=EVENT)
    other = make_fmu(tmp_path / "other", discrete=True, names={"gear": "ratio"}, fmi="3.0")
    bare = make_fmu(tmp_path / "bare", name="bare")
    variant = tmp_path / "v.xml"
    assert main(["swap", str(path), "--plant", f"car={other}", "--out", str(variant)]) == 0
    assert "no such input: leader: gear" in " ".join(capsys.readouterr().err.split())
    assert gains(cosim.run(variant)) == pytest.approx(course((0.2, 0), (0.5, 1), (0.6, -1), (0.9, 0), (1.0, 1)))
    assert main(["swap", str(path), "--plant", f"car={bare}", "--out", str(variant), "--force"]) == 0
    said = " ".join(capsys.readouterr().err.split())
    assert "no such input: leader: gear, enable; leader at 0.9 s: enable, direction; leader at 0.5 s" in said
    assert gains(cosim.run(variant)) == pytest.approx(course((1.0, 1)))


@pytest.mark.parametrize(
    ("limit", "sentence"),
    [
        (
            "MAX_SAMPLES",
            "the input 'enable' has 2 signals at 51 communication points; at most 3e+00 values are computed",
        ),
        ("MAX_CHANGES", "the input 'enable' has changed more than 1 times at 1 s; at most 3e+00 changes"),
    ],
)
def test_more_than_can_be_kept_is_refused_at_its_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: str, sentence: str
) -> None:
    for module in ("discrete_inputs", "robot_inputs"):
        monkeypatch.setattr(f"cosim.master.{module}.{limit}", 3, raising=False)
    path = written(tmp_path, INPUTS)
    with pytest.raises(cosim.InputError, match=rf"s.xml:\d+:\d+: {re.escape(sentence)}"):
        cosim.run(path)
