"""The reader checks rules beyond the schema; quantities arrive in SI units."""

import math
import re
from pathlib import Path

import pytest

from cosim.errors import InputError
from cosim.quantity import quantity
from cosim.scenario.edits import Change, set_controller, set_fmu, set_seed
from cosim.scenario.reader import read_scenario
from cosim.scenario.reader.times import Times
from cosim.scenario.scenario import Follower, Scenario
from cosim.signals.effects import Effect, understood
from cosim.vehicle.car_like import CAR_LIKE
from cosim.vehicle.kind import units_of

EXAMPLE = Path(__file__).with_name("example.xml")


def understood_effects(scenario: Scenario, follower: Follower) -> list[tuple[Effect, ...]]:
    """Return the effects of a car's sensor and actuators, as they are understood when the scenario is set up."""
    times = Times(scenario.step, scenario.ticks)
    parts = ((follower.sensor, CAR_LIKE.pose), (follower.actuator, CAR_LIKE.command))
    return [understood(written, units_of(roles), times, "the robot") for written, roles in parts]


def refused(*replacements: str) -> InputError:
    with pytest.raises(InputError) as caught:
        understood_effects(scenario := read_scenario(EXAMPLE, replacements), scenario.followers[0])
    return caught.value


def test_what_a_file_says_in_si_units() -> None:
    scenario = read_scenario(EXAMPLE)
    assert (scenario.name, scenario.step, scenario.ticks, scenario.horizon) == ("example", 0.02, 5000, 100)
    assert scenario.leader.pose.values == {"x": 2.5, "y": 5.5, "psi": 0.0, "gamma": 0.0}
    assert scenario.leader.torque.values == {"tau_drive": 8.0, "tau_steer": 0.0}
    assert [follower.pose.values["x"] for follower in scenario.followers] == [-5.0] * 4
    assert [follower.pose.values["y"] for follower in scenario.followers] == [0.0, 10.0, 15.0, -5.0]
    ranges, bearings = zip(*(follower.desired for follower in scenario.followers), strict=True)
    assert ranges == (3.0, 3.0, 8.0, 8.0)
    assert bearings == pytest.approx([math.pi / 4, -math.pi / 4, math.pi / 12, -math.pi / 12], abs=1e-15)
    for follower in scenario.followers:
        sensor, actuator = understood_effects(scenario, follower)
        assert [(e.kind, e.amount, e.channels) for e in sensor] == [
            ("noise", 0.001, (channel,)) for channel in ("x", "y", "psi", "gamma")
        ]
        assert [(e.kind, e.amount, e.channels) for e in actuator] == [("saturation", 200.0, ())]
    gains = {gain.name: gain.value for gain in scenario.controllers["pid"].gains}
    assert gains["gamma_w"] == "10"
    assert gains["W_m"] == "1000"


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("3 m", "m", 3.0),
        ("3m", "m", 3.0),
        ("-1.5e3 mm", "m", -1.5),
        ("180 deg", "rad", math.pi),
        ("20 ms", "s", 0.02),
        ("36 km/h", "m/s", 10.0),
        ("0.5", "1", 0.5),
    ],
)
def test_quantities(text: str, unit: str, value: float) -> None:
    assert quantity(text, unit) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "unit", "sentence"),
    [
        ("3", "m", "the unit is missing; expected a quantity such as '3 m'"),
        ("3 s", "m", "s does not fit; expected a quantity such as '3 m'"),
        ("3 parsec", "m", "'parsec' is not known"),
        ("three m", "m", "is not a number with a unit"),
        ("1e999 m", "m", "is not a finite number"),
        ("nan m", "m", "is not a number with a unit"),
    ],
)
def test_bad_quantities(text: str, unit: str, sentence: str) -> None:
    with pytest.raises(ValueError, match=re.escape(sentence)):
        quantity(text, unit)


@pytest.mark.parametrize(
    ("replacement", "place", "sentence"),
    [
        ("//simulation/@step=0 ms", "11:3", 'step="0 ms" of <simulation> must be greater than zero'),
        ("//simulation/@step=30 ms", "11:3", "is not a whole number of communication steps"),
        ("//simulation/@horizon=1e9 s", "11:3", "at most 10000000 are possible"),
        ("//simulation/@step=1e-320 s", "11:3", "at most 10000000 are possible"),
        ("//noise/@psi=-1 deg", "36:5", "must not be negative"),
        ("//saturation/@limit=0 N.m", "39:5", "must be greater than zero"),
        ("//follower[1]/desired/@range=-3 m", "49:5", "must be greater than zero"),
        ("//follower[2]/@id=follower_1", "51:3", "'follower_1' is given to a second <follower>; first in line 47"),
        ("//follower[2]/@id=leader", "51:3", "a follower cannot have the id 'leader'"),
        ("//follower[2]/@plant=clrm", "51:3", "has no plant 'clrm': did you mean 'clmr'?"),
        ("//leader/@plant=clrm", "42:3", "has no plant 'clrm'"),
        ("//follower[2]/@controller=pdi", "51:3", "has no controller 'pdi': did you mean 'pid'?"),
        ("//gain[2]/@name=K_p", "25:5", "the gain 'K_p' is given twice; first in line 24"),
    ],
)
def test_what_does_not_hold_together(replacement: str, place: str, sentence: str) -> None:
    error = refused(replacement)
    assert str(error).startswith(f"{EXAMPLE}:{place}: ")
    assert sentence in error.message


ONE = '<follower id="follower_1" plant="clmr" controller="pid">'
END = 'bearing="45 deg"/>'
POSE = '<pose x="2.5 m" y="5.5 m" psi="0 deg" gamma="0 deg"/>'
LEADING = '<torque tau_drive="8 N.m" tau_steer="0 N.m"/>'


@pytest.mark.parametrize(
    ("old", "new", "place", "sentence"),
    [
        # times
        (
            'seed="1"',
            'seed="1" period="50 ms"',
            "11:3",
            "the period 0.05 s is not a whole number of communication steps of 0.02 s",
        ),
        ('seed="1"', 'seed="1" period="0 s"', "11:3", "the period 0 s is not a whole number of communication steps"),
        ("<actuator>", '<actuator><delay time="30 ms"/>', "38:13", "the time 0.03 s is not a whole number of"),
        (
            "<actuator>",
            '<actuator><delay time="1e7 s"/>',
            "38:13",
            'time="1e7 s" of <delay> is longer than the run of 100 s',
        ),
        ("<sensor>", '<sensor><delay time="1e308 s"/>', "35:11", "is longer than the run of 100 s"),
        (
            "<sensor>",
            '<sensor>\n<delay time="60 s" channels="x"/><delay time="60 s" channels="y"/>\n<delay time="60 s"/>',
            "37:1",
            "the delays of a channel add up to 120 s, longer than the run of 100 s",
        ),
        ("<noise ", '<noise from="2 s" to="1 s" ', "36:5", "the window ends at 1 s, before it begins at 2 s"),
        (
            "</scenario>",
            '<event at="101 s" robots="leader"><stop/></event></scenario>',
            "64:1",
            "is after the end of the run at 100",
        ),
        ("</scenario>", '<event at="-1 s" robots="leader"><stop/></event></scenario>', "64:1", "must not be negative"),
        (
            "<noise ",
            '<noise from="101 s" to="102 s" ',
            "36:5",
            "the <noise> at 101 s is after the end of the run at 100 s",
        ),
        (
            "<actuator>",
            '<actuator><effectiveness factor="0" from="2 min"/>',
            "38:13",
            "at 120 s is after the end of the run at 100 s",
        ),
        *(
            (
                "<leader ",
                f'<input name="tau_d_y">\n<{wave}/></input><leader ',
                "43:1",
                "at 101 s is after the end of the run at 100 s",
            )
            for wave in (
                'step value="1 N" at="101 s"',
                'ramp value="1 N" from="101 s" to="102 s"',
                'pulse value="1 N" from="101 s" to="102 s"',
                'sine value="1 N" period="1 s" from="101 s"',
                'random value="1 N" cutoff="1 Hz" from="101 s"',
            )
        ),
        (
            END,
            f'{END[:-2]}><change from="101 s" to="102 s" range="1 m"/></desired>',
            "49:43",
            "at 101 s is after the end of the run at 100 s",
        ),
        (
            "</scenario>",
            '<expect><regular from="101 s"/></expect></scenario>',
            "64:9",
            "at 101 s is after the end of the run at 100 s",
        ),
        (
            'seed="1"',
            'seed="1" period="101 s"',
            "11:3",
            'period="101 s" of <simulation> is longer than the run of 100 s',
        ),
        *(
            ("<noise ", f'<noise x="0 m"/><{own} from="1 s" to="1 s"/><noise ', "36:21", "the end must be later")
            for own in ('bias x="1 mm"', 'quantisation x="1 mm"', 'dropout probability="1"')
        ),
        *(
            (
                "<leader ",
                f'<input name="tau_d_y">\n<{wave} from="1 s" to="1 s"/></input><leader ',
                "43:1",
                "must be later",
            )
            for wave in ('ramp value="1 N"', 'pulse value="1 N"', 'sine value="1 N" period="1 s"')
        ),
        # changes of places
        (END, f'{END[:-2]}><change from="9 s" to="7 s" range="1 m"/></desired>', "49:43", "ends at 7 s, before"),
        (END, f'{END[:-2]}><change from="9 s" to="9 s" range="1 m"/></desired>', "49:43", "the end must be later"),
        (END, f'{END[:-2]}><change from="1 s" to="2 s"/></desired>', "49:43", "nothing changes"),
        (
            END,
            f'{END[:-2]}>\n<change from="1 s" to="3 s" range="1 m"/>'
            '\n<change from="2 s" to="4 s" range="2 m"/></desired>',
            "51:1",
            "the change from 2 s begins before 3 s, when the one before it ends",
        ),
        (
            END,
            f'{END[:-2]}>\n<change from="5 s" to="6 s" range="1 m"/>'
            '\n<change from="2 s" to="4 s" range="2 m"/></desired>',
            "51:1",
            "the change from 2 s begins before 6 s",
        ),
        # references
        (
            "</scenario>",
            '<event at="1 s" robots="follower_9"><stop/></event></scenario>',
            "64:1",
            "has no robot 'follower_9': did you mean 'follower_",
        ),
        ("</scenario>", '<expect><regular robots="leader"/></expect></scenario>', "64:9", "has no robot 'leader': "),
        (
            "</scenario>",
            '<event at="1 s" robots="follower_1"><torque/></event></scenario>',
            "64:37",
            '<torque> needs robots="leader"',
        ),
        (
            "</scenario>",
            '<event at="1 s" robots="leader"><torque/>\n<torque tau_drive="1 N.m"/></event></scenario>',
            "65:1",
            "an event takes one <torque>: remove this second one",
        ),
        (
            "</scenario>",
            '<event at="1 s" robots="leader"><torque/>\n<command tau_drive="2 N.m"/></event></scenario>',
            "65:1",
            "an event takes one <torque>: remove this second one",
        ),
        (
            "</scenario>",
            '<event at="1 s" robots="leader"><stop/>\n<stop/></event></scenario>',
            "65:1",
            "an event takes one <stop>: remove this second one",
        ),
        # what excludes each other
        (f"{POSE}\n    {LEADING}", "<trajectory/>", "43:5", "needs either waypoints or file"),
        (POSE, "", "42:3", "the <leader> needs a <pose> to start from"),
        (LEADING, '<trajectory file="a.csv"/>', "43:5", "a leader with a <trajectory> has no <pose>"),
        # numbers
        (
            "<actuator>",
            '<actuator><effectiveness factor="1.5"/>',
            "38:13",
            'factor="1.5" of <effectiveness> is not from 0 to 1',
        ),
        (
            "<sensor>",
            '<sensor><dropout probability="-0.1"/>',
            "35:11",
            'probability="-0.1" of <dropout> is not from 0 to 1',
        ),
        ("<actuator>", '<actuator><rate limit="0 N.m/s"/>', "38:13", "must be greater than zero"),
        (ONE, ONE.replace("follower_1", "leader"), "47:3", "a follower cannot have the id 'leader'"),
    ],
)
def test_what_a_schema_cannot_say(tmp_path: Path, old: str, new: str, place: str, sentence: str) -> None:
    path = tmp_path / "s.xml"
    text = EXAMPLE.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        understood_effects(scenario := read_scenario(path), scenario.followers[0])
    assert str(caught.value).startswith(f"{path}:{place}: ")
    assert sentence in caught.value.message


def test_a_plant_needs_one_source(tmp_path: Path) -> None:
    path = tmp_path / "s.xml"
    for source in ("", 'model="car_like" fmu="car.fmu"'):
        path.write_text(EXAMPLE.read_text().replace('model="car_like"', source))
        with pytest.raises(InputError, match="needs either model"):
            read_scenario(path)


def test_an_fmu_is_looked_for_beside_the_scenario(tmp_path: Path) -> None:
    path = tmp_path / "s.xml"
    path.write_text(EXAMPLE.read_text().replace('model="car_like"', 'fmu="fmus/car.fmu"'))
    assert read_scenario(path).plants["clmr"].fmu == tmp_path / "fmus" / "car.fmu"


def test_changes_are_made_in_the_text_that_is_kept() -> None:
    changes = [
        set_seed(7),
        set_fmu("clmr", Path("other.fmu")),
        set_controller("pid", "other-law", "other-package", "2.1"),
    ]
    scenario = read_scenario(EXAMPLE, changes)
    assert scenario.seed == 7
    plant = scenario.plants["clmr"]
    assert (plant.model, plant.fmu) == (None, Path.cwd() / "other.fmu")
    assert len(plant.parameters) == 7
    law = scenario.controllers["pid"]
    assert (law.name, law.package, law.version, law.gains) == ("other-law", "other-package", "==2.1", ())
    for piece in ('seed="7"', f'fmu="{Path.cwd() / "other.fmu"}"', 'name="other-law"', 'version="==2.1"'):
        assert piece in scenario.text
    for piece in ("gain", "model="):
        assert piece not in scenario.text


@pytest.mark.parametrize(("name", "kept"), [("neural-adaptive-pid", (9, 1)), ("observer-pid", (0, 0))])
def test_gains_belong_to_a_law(tmp_path: Path, name: str, kept: tuple[int, int]) -> None:
    path = tmp_path / "s.xml"
    own = '<desired range="3 m" bearing="45 deg"/>'
    path.write_text(EXAMPLE.read_text().replace(own, f'{own}<gain name="K_p" value="7"/>'))
    scenario = read_scenario(path, [set_controller("pid", name, "formation-controllers", "0.1.0")])
    assert (len(scenario.controllers["pid"].gains), len(scenario.followers[0].gains)) == kept


def test_another_law_leaves_the_gains_of_other_controllers(tmp_path: Path) -> None:
    path = tmp_path / "s.xml"
    own = '<desired range="3 m" bearing="45 deg"/>'
    text = EXAMPLE.read_text().replace(own, f'{own}<gain name="K_p" value="7"/>')
    other = (
        '<controller id="other" name="lqg" package="formation-controllers" version="~=0.1"/>\n  <controller id="pid"'
    )
    path.write_text(text.replace('<controller id="pid"', other))
    scenario = read_scenario(path, [set_controller("other", "observer-pid", "formation-controllers", "0.1.0")])
    assert (len(scenario.controllers["pid"].gains), len(scenario.followers[0].gains)) == (9, 1)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (set_seed(-1), 'seed="-1" of <simulation> is not a whole number from 0'),
        (set_fmu("car", Path("x.fmu")), "has no plant 'car'"),
        (set_controller("pd", "a", "b", "1"), "has no controller 'pd': did you mean 'pid'?"),
    ],
)
def test_changes_that_do_not_apply(change: Change, sentence: str) -> None:
    with pytest.raises(InputError, match=re.escape(sentence)):
        read_scenario(EXAMPLE, [change])


def test_white_space_in_values_does_not_count(tmp_path: Path) -> None:
    path = tmp_path / "s.xml"
    text = EXAMPLE.read_text().replace('id="clmr"', 'id=" clmr\n"')
    path.write_text(text.replace('name="example"', 'name=" example "'))
    scenario = read_scenario(path)
    assert scenario.name == "example"
    assert list(scenario.plants) == ["clmr"]


def test_a_title_cannot_control_the_terminal(tmp_path: Path) -> None:
    path = tmp_path / "s.xml"
    path.write_text(EXAMPLE.read_text().replace("An example", "\u009b31m \u202e An example"), encoding="utf-8")
    assert read_scenario(path).title == "?31m ? An example for the tests"
