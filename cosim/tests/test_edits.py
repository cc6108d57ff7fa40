"""Scenarios with another horizon, without expectations, and changed again after they were read."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest
import xarray as xr

import cosim
from cosim.cli import main
from cosim.errors import InputError, Location
from cosim.scenario.grammar import NAMESPACE
from cosim.scenario.reader import read_scenario
from cosim.tests.driving import scenario

EXAMPLE = Path(__file__).with_name("example.xml")
LATER = """
  <input name="tau_d_x"><sine value="1 N" period="0.1 s"/><step value="1 N" at="0.3 s"/>
    <ramp value="1 N" from="30 s" to="40 s"/></input>
  <input name="tau_d_y"><pulse value="3 N" from="20 s" to="21 s"/></input>
"""
EVENTS = """
  <event at="0.3 s" robots="follower_1"><parameter name="m_c" value="45 kg"/></event>
  <event at="30 s" robots="follower_2"><stop/></event>
  <expect>
    <rms signal="range_error" below="9 m" to="0.4 s"/>
    <rms signal="range_error" below="0.1 m" from="80 s"/>
  </expect>
"""


@pytest.fixture
def eventful(tmp_path: Path) -> Path:
    """Return a scenario in which things begin before and after 0.4 s."""
    text = EXAMPLE.read_text("utf-8")
    text = text.replace("  <leader", LATER + "  <leader").replace("</scenario>", EVENTS + "</scenario>")
    text = text.replace('gamma="1 mrad"/>', 'gamma="1 mrad"/><bias x="1 m" from="50 s"/><dropout probability="0.5"/>')
    text = text.replace('bearing="15 deg"/>', 'bearing="15 deg"><change from="10 s" to="20 s" range="9 m"/></desired>')
    (path := tmp_path / "eventful.xml").write_text(text, "utf-8")
    return path


def test_a_shortened_run_is_the_beginning_of_the_run(eventful: Path) -> None:
    scenario = read_scenario(eventful).edited(expectations=False)
    longer, shorter = (cosim.run(scenario, horizon=end) for end in (0.8, "400 ms"))
    assert shorter.attrs["status"] == longer.attrs["status"] == "completed"
    assert shorter.sizes["time"] == 21
    xr.testing.assert_equal(shorter, longer.isel(time=slice(21)))
    assert float(abs(longer["velocity"]).max()) > 0


def test_an_input_whose_signals_begin_later_is_zero_until_then(tmp_path: Path, make: Callable[..., Path]) -> None:
    """It does not have the FMU's own start value, which is 1 for the gear; a switch has it, which is on."""
    plant = f'<plant id="car" fmu="{make(discrete=True)}"/>'
    gear = '<input name="gear"><!-- later --><step value="2" at="0.4 s"/></input>'
    gear += '<input name="enable"><step value="0" at="0.4 s"/></input>'
    path = scenario(tmp_path / "s.xml", plant, horizon="0.8 s")
    path.write_text(path.read_text("utf-8").replace("<leader", f"{gear}<leader"), "utf-8")
    longer = read_scenario(path)
    shorter = longer.edited(horizon=0.2)
    assert shorter.text.count('later="yes"') == 2
    in_gear = ["//input[@name='gear']/step/@at=0 s", "//input[@name='gear']/step/@value=1"]
    short, driven = cosim.run(shorter), cosim.run(shorter.edited(in_gear))
    xr.testing.assert_equal(short, cosim.run(longer).isel(time=slice(11)))
    still, moving = (float(abs(result["velocity"].sel(velocity_component="v")).max()) for result in (short, driven))
    assert still == 0.0 < moving


def test_what_begins_with_the_end_stays_whatever_its_unit(tmp_path: Path) -> None:
    """1380 ms is a little more than 1.38 s."""
    event = '  <event at="1380 ms" robots="follower_2"><stop/></event>\n</scenario>'
    text = EXAMPLE.read_text("utf-8").replace("</scenario>", event)
    (path := tmp_path / "late.xml").write_text(text, "utf-8")
    assert len(read_scenario(path).edited(horizon="1.38 s", expectations=False).events) == 1
    assert len(read_scenario(path).edited(horizon="1.36 s", expectations=False).events) == 0


BEHIND = """
  <input name="tau_d_y"><step value="2 N" at="0.6 s"/><random value="1 N" cutoff="2 Hz"/></input>
  <input name="tau_d_x"><pulse value="2 N" from="0.5 s" to="0.6 s"/></input>
  <input name="tau_d_x" value="1 N"/>
"""
OWN = """
    <sensor><dropout probability="0.5" from="0.6 s"/><!-- --><dropout probability="0.3" channels="x"/></sensor>
    <input name="tau_d_x"><random value="1 N" cutoff="2 Hz"/></input>
"""


def test_noise_behind_what_is_left_out_stays_the_same(tmp_path: Path) -> None:
    """Its stream follows from its place, which is another one then."""
    text = EXAMPLE.read_text("utf-8").replace("  <leader", BEHIND + "  <leader")
    text = text.replace('bearing="15 deg"/>', f'bearing="15 deg"/>{OWN}')
    (path := tmp_path / "noisy.xml").write_text(text, "utf-8")
    longer = read_scenario(path).edited(horizon=0.8, expectations=False)
    shorter = longer.edited(horizon=0.4)
    assert [wave.get("stream") for wave in shorter.inputs[0].waves] == ["1"]
    own = shorter.followers[2].inputs[0].waves  # before it, a pulse that is all of its input has stayed
    assert [wave.get("stream") for wave in own] == [""]
    assert [effect.get("stream") for effect in shorter.followers[2].sensor] == ["1"]
    short, long = cosim.run(shorter), cosim.run(longer)
    xr.testing.assert_equal(short.isel(time=slice(20)), long.isel(time=slice(20)))
    assert float(abs(long["pose"] - long["measured_pose"]).max()) > 0
    other = cosim.run(shorter.edited(["//random/@stream=7"]))
    assert not short["pose"].equals(other["pose"])


def test_what_begins_later_is_left_out(eventful: Path) -> None:
    scenario = read_scenario(eventful, ["//rms[2]/@from=0.2 s"]).edited(horizon=0.4)
    assert (scenario.horizon, scenario.ticks) == (0.4, 20)
    assert [event.time for event in scenario.events] == [0.3]
    assert [(given.name, [wave.kind for wave in given.waves]) for given in scenario.inputs] == [
        ("tau_d_x", ["sine", "step"]),
        ("tau_d_y", ["pulse"]),
    ]
    assert {effect.kind for effect in scenario.followers[0].sensor} == {"noise", "dropout"}
    assert [follower.changes for follower in scenario.followers] == [()] * 4
    assert len(scenario.expectations) == 2
    assert scenario.edited() is scenario


def test_an_expectation_about_a_later_time_is_refused_with_its_place(eventful: Path) -> None:
    scenario = read_scenario(eventful)
    with pytest.raises(InputError, match="the <rms> at 80 s is after the end of the run at 2 s") as raised:
        scenario.edited(horizon=2)
    assert raised.value.where == scenario.expectations[1].where
    assert "; --no-expectations (from Python, expectations=False) leaves all expectations out" in str(raised.value)
    assert cosim.run(scenario, horizon=0.1, expectations=False).sizes["time"] == 6


@pytest.mark.parametrize(
    ("horizon", "sentence"),
    [
        (-1.0, "must be greater than zero"),
        (float("nan"), 'horizon="nan s" of <simulation> is not a time with its unit'),
        (0.03, "is not a whole number of communication steps of 0.02 s"),
        ("soon", 'horizon="soon" of <simulation> is not a time with its unit'),
    ],
)
def test_horizons_that_are_none(horizon: float | str, sentence: str) -> None:
    with pytest.raises(InputError, match=re.escape(sentence)):
        read_scenario(EXAMPLE).edited(horizon=horizon)


def test_edits_come_one_after_another_and_are_remembered() -> None:
    read = read_scenario(EXAMPLE, ["simulation/@seed=2"])
    edited = read.edited(["simulation/@seed=3"]).edited(horizon=2.5, expectations=False)
    at_once = read_scenario(EXAMPLE, ["simulation/@seed=3"]).edited(horizon=2.5, expectations=False)
    assert (read.seed, edited.seed, edited.horizon) == (2, 3, 2.5)
    words = ("--set simulation/@seed=2", "--set simulation/@seed=3", "--horizon '2.5 s'", "--no-expectations")
    assert edited.changes == words
    assert edited.followers == at_once.followers
    same = read_scenario(EXAMPLE, ["simulation/@seed=2"]).edited(["simulation/@seed=3"])
    assert {edited: 1}[same.edited(horizon=2.5, expectations=False)], "equal scenarios have the same hash"
    with pytest.raises(InputError, match="selects nothing"):
        read.edited(["//nothing/@at=all"])
    assert read == read_scenario(EXAMPLE, ["simulation/@seed=2"]), "an edit makes another scenario"


def test_places_stay_those_in_the_files(tmp_path: Path) -> None:
    """The text of a variant is of several files, and a changed text has other lines than its file."""
    (tmp_path / "base.xml").write_text(EXAMPLE.read_text("utf-8"), "utf-8")
    (path := tmp_path / "v.xml").write_text(
        f"""<variant xmlns="{NAMESPACE}" name="v" of="base.xml">
  <title>Another</title>
  <set select="follower[2]/gain[@name='K_p']/@value" value="12"/>
</variant>""",
        "utf-8",
    )
    scenario = read_scenario(path)
    path.unlink()
    edited = scenario.edited(["follower[3]/gain[@name='K_p']/@value=13"], horizon=1.0)
    assert [f.where for f in edited.followers] == [f.where for f in scenario.followers]
    assert edited.followers[1].gains[0].where == Location(str(path), 3, 3)
    assert edited.followers[2].gains[0].where.file.startswith("--set ")
    assert edited.path == path


def test_paths_stay_where_the_file_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = EXAMPLE.read_text("utf-8").replace('model="car_like"', 'fmu="fmus/car.fmu"')
    (tmp_path / "s.xml").write_text(text, "utf-8")
    monkeypatch.chdir(tmp_path)
    scenario = read_scenario("s.xml")
    monkeypatch.chdir("/")
    edited = scenario.edited(horizon=1.0)
    assert edited.plants["clmr"].fmu == tmp_path / "fmus" / "car.fmu"
    assert edited.path == Path("s.xml"), "as it was named"


def test_the_command_line_has_both(eventful: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--horizon", "0.1 s", "--no-expectations", "--out", str(tmp_path / "runs"), "--no-figure"]
    assert main(["run", str(eventful), *options]) == 0
    assert "changed by --horizon '0.1 s' --no-expectations" in capsys.readouterr().out
    result = cosim.load_result(tmp_path / "runs" / "example")
    assert result.sizes["time"] == 6
    assert main(["show", str(tmp_path / "runs" / "example")]) == 0
    assert main(["check", str(eventful), "--horizon", "2", "--seed", "3"]) == 2
    refused = capsys.readouterr().err
    assert 'horizon="2" of <simulation> is not a time with its unit' in refused
    assert refused.endswith("(as changed by --seed 3, --horizon 2)\n")
