"""A gain or parameter that a scenario leaves out is added by the XPath that names it."""

import re
from contextlib import ExitStack
from pathlib import Path

import pytest
from lxml import etree

from cosim.errors import InputError, Location
from cosim.master.setup import set_up
from cosim.scenario.document import parse_document
from cosim.scenario.grammar import NAMESPACE
from cosim.scenario.reader import read_scenario
from cosim.scenario.xpath_selection import selected_or_added

EXAMPLE = Path(__file__).with_name("example.xml")


def by_name(settings: object) -> dict[str, str]:
    return {setting.name: setting.value for setting in settings}  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "xpath",
    [
        "controller[@id='pid']/gain[@name='guard']/@value",
        'controller/gain[ @name = "guard" ]/@value',
        "/scenario/controller[1]/gain[@name='guard']/@value",
    ],
)
def test_a_gain_is_added_to_a_controller(xpath: str) -> None:
    scenario = read_scenario(EXAMPLE, [f"{xpath}=0.5"])
    gains = by_name(scenario.controllers["pid"].gains)
    assert gains["guard"] == "0.5"
    assert len(gains) == 10
    assert parse_document(scenario.text, EXAMPLE), "the text that is kept is a scenario, too"


def test_gains_and_parameters_of_one_robot() -> None:
    changes = [
        "follower[@id='follower_2']/gain[@name='K_p']/@value=12",
        "follower[2]/parameter[@name='m_c']/@value=45 kg",
        "leader/parameter[@name='m_c']/@value=20 kg",
    ]
    scenario = read_scenario(EXAMPLE, changes)
    assert [by_name(follower.gains) for follower in scenario.followers] == [{}, {"K_p": "12"}, {}, {}]
    assert [by_name(follower.parameters) for follower in scenario.followers] == [{}, {"m_c": "45 kg"}, {}, {}]
    assert by_name(scenario.leader.parameters) == {"m_c": "20 kg"}
    assert by_name(scenario.controllers["pid"].gains)["K_p"] == "10"
    with ExitStack() as cleanup:
        gains = set_up(scenario, cleanup, {}).gains
    assert [own.K_p for own in gains] == [(10.0, 10.0), (12.0, 12.0), (10.0, 10.0), (10.0, 10.0)]


def test_what_is_there_is_changed_and_not_added_twice() -> None:
    change = "follower[1]/gain[@name='K_p']/@value"
    gains = read_scenario(EXAMPLE, [f"{change}=12", f"{change}=13"]).followers[0].gains
    assert [(gain.name, gain.value) for gain in gains] == [("K_p", "13")]


def test_a_variant_adds_it_too(tmp_path: Path) -> None:
    (tmp_path / "base.xml").write_text(EXAMPLE.read_text("utf-8"), "utf-8")
    (tmp_path / "v.xml").write_text(
        f"""<variant xmlns="{NAMESPACE}" name="v" of="base.xml">
  <title>A heavier wheel</title>
  <set select="plant[@id='clmr']/parameter[@name='I_w']/@value" value="2 kg.m2"/>
</variant>""",
        "utf-8",
    )
    parameter = read_scenario(tmp_path / "v.xml").plants["clmr"].parameters[-1]
    assert (parameter.name, parameter.value) == ("I_w", "2 kg.m2")
    assert parameter.where == Location(str(tmp_path / "v.xml"), 3, 3)


@pytest.mark.parametrize(
    ("xpath", "value", "nearest"),
    [
        ("controller/gain[@name='Kp']/@value", "1", "unknown gain 'Kp'; did you mean 'K_p'?"),
        ("follower[1]/gain[@name='gama_w']/@value", "1", "unknown gain 'gama_w'; did you mean 'gamma_w'?"),
        ("plant/parameter[@name='mc']/@value", "1 kg", "did you mean 'm_c'?"),
        ("follower[3]/parameter[@name='I_d']/@value", "1 kg", "'I_d'"),
    ],
)
def test_a_mistyped_name_is_refused_with_the_nearest(xpath: str, value: str, nearest: str) -> None:
    """The names that a law or a plant knows are not in the scenario: whether one fits is seen when it is set up."""
    scenario = read_scenario(EXAMPLE, [f"{xpath}={value}"])
    with ExitStack() as cleanup, pytest.raises(InputError, match=re.escape(nearest)) as raised:
        set_up(scenario, cleanup, {})
    assert raised.value.where == Location(f'--set "{xpath}={value}"')


@pytest.mark.parametrize(
    ("xpath", "sentence"),
    [
        ("//gain[@name='new']/@value", "to add the gain 'new', name the element that gets it, such as controller[@id"),
        ("//gain[@name='K_q']/@value", "did you mean //gain[@name='K_p']/@value?"),
        ("follower/gain[@name='new']/@value", "such as follower[@id='follower_1']/gain[@name='new']/@value"),
        ("controller[@id='other']/gain[@name='new']/@value", "selects nothing"),
        ("leader/gain[@name='new']/@value", "selects nothing"),
        ("controller/gain[@name=new]/@value", "selects nothing"),
        ("controller/gain[@name='']/@value", "selects nothing"),
        ("controller/gain[@name='new' or 1]/@value", ""),
        ("controller/gain[@name='new'][1]/@value", "selects nothing"),
        ("controller/gain[@name='new']/@nothing", "selects nothing"),
        ("controller[/gain[@name='new']/@value", "is not an XPath"),
        ("controller/gains[@name='new']/@value", "selects nothing"),
    ],
)
def test_nothing_is_added_where_it_is_not_clear_what_or_where(xpath: str, sentence: str) -> None:
    root = etree.fromstring(EXAMPLE.read_bytes().replace(f' xmlns="{NAMESPACE}"'.encode(), b""))
    before = etree.tostring(root)
    if sentence:
        with pytest.raises(ValueError, match=re.escape(sentence)):
            selected_or_added(root, xpath)
    else:
        assert len(selected_or_added(root, xpath)) == 9
    assert etree.tostring(root) == before
