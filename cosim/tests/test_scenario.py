"""What the schema cannot say is checked by the reader; quantities arrive in SI units."""

import math
import re
from pathlib import Path

import pytest

from cosim.changes import Change, set_controller, set_fmu, set_seed
from cosim.errors import InputError
from cosim.quantity import quantity
from cosim.reader import read_scenario

EXAMPLE = Path(__file__).with_name("example.xml")


def refused(*replacements: str) -> InputError:
    with pytest.raises(InputError) as caught:
        read_scenario(EXAMPLE, replacements)
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
        assert [(e.kind, e.amount, e.channels) for e in follower.sensor] == [
            ("noise", 0.001, (channel,)) for channel in ("x", "y", "psi", "gamma")
        ]
        assert [(e.kind, e.amount, e.channels) for e in follower.actuator] == [("saturation", 200.0, ())]
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
        ("3", "m", "the unit is missing; expected is a quantity such as '3 m'"),
        ("3 s", "m", "s does not fit; expected is a quantity such as '3 m'"),
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


def test_the_same_law_keeps_its_gains() -> None:
    same = set_controller("pid", "neural-adaptive-pid", "formation-controllers", "0.1.0")
    assert len(read_scenario(EXAMPLE, [same]).controllers["pid"].gains) == 9


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
