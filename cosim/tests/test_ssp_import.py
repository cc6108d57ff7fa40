"""Scenarios from systems of FMUs (SSP) of somebody else, and SSPs that are refused."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

import pytest

import plants
from cosim.errors import InputError
from cosim.fmu.discrete_values import items
from cosim.master.setup import set_up
from cosim.scenario.reader import read_scenario
from cosim.ssp.imported import Imported, import_ssp

NAMESPACES = " ".join(
    f'xmlns:{prefix}="http://ssp-standard.org/SSP1/SystemStructure{name}"'
    for prefix, name in {"ssd": "Description", "ssc": "Common", "ssv": "ParameterValues"}.items()
)
DESCRIPTION = """\
<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription {namespaces} version="{version}" name="depot">
<ssd:System name="depot">
<ssd:Elements>
{elements}
</ssd:Elements>
{rest}
</ssd:System>
<ssd:Units><ssc:Unit name="m"><ssc:BaseUnit m="1"/></ssc:Unit></ssd:Units>
<ssd:DefaultExperiment startTime="0" stopTime="12"/>
</ssd:SystemStructureDescription>
"""
SET = """\
<ssv:ParameterSet {namespaces} version="1.0" name="start"><ssv:Parameters>{parameters}</ssv:Parameters>
<ssv:Units><ssc:Unit name="furlong"><ssc:BaseUnit m="1" factor="201.168"/></ssc:Unit></ssv:Units></ssv:ParameterSet>
"""
CAR = "resources/car.fmu"


def component(name: str, source: str = CAR, inner: str = "", more: str = "") -> str:
    return f'<ssd:Component name="{name}" source="{source}" {more}>{inner}</ssd:Component>'


def with_set(file: str) -> str:
    binding = f'<ssd:ParameterBinding type="application/x-ssp-parameter-set" source="{file}"/>'
    return f"<ssd:ParameterBindings>{binding}</ssd:ParameterBindings>"


def parameters(values: Mapping[str, str]) -> str:
    """Return a parameter set, of values such as ``Real value="1" unit="m"``."""
    listed = "".join(f'<ssv:Parameter name="{name}"><ssv:{value}/></ssv:Parameter>' for name, value in values.items())
    return SET.format(namespaces=NAMESPACES, parameters=listed)


@pytest.fixture(scope="module")
def car() -> Path:
    return plants.build("car_like")


@pytest.fixture
def depot(tmp_path: Path, car: Path) -> Path:
    """An SSP of a leader with parameters and a follower, and a file to write another one like it."""
    return system(tmp_path, car, component("the_leader", inner=with_set("a.ssv")) + component("van 2"), START)


START = {
    "a.ssv": parameters({"x": 'Real value="4.5" unit="m"', "m_c": 'Real value="31.5"', "tau_drive": 'Real value="3"'})
}


def system(
    folder: Path, car: Path, elements: str, texts: Mapping[str, str] = {}, rest: str = "", version: str = "1.0"
) -> Path:
    path = folder / "depot.ssp"
    text = DESCRIPTION.format(namespaces=NAMESPACES, version=version, elements=elements, rest=rest)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("SystemStructure.ssd", text)
        archive.write(car, CAR)
        for name, content in texts.items():
            archive.writestr(name, content)
    return path


def written(imported: Imported) -> Path:
    for path, content in imported.files.items():
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)
    return imported.scenario


def test_vehicles_become_robots_with_their_values_and_the_rest_is_told(depot: Path, tmp_path: Path) -> None:
    imported = import_ssp(depot, tmp_path / "mine.xml")
    scenario = read_scenario(written(imported))
    with ExitStack() as cleanup:
        setup = set_up(scenario, cleanup, {})
    assert setup.leader.pose == (4.5, 0.0, 0.0, 0.0)
    assert [(p.variable.name, p.value) for p in setup.leader.parameters] == [("m_c", 31.5)]
    assert setup.leader.torque[0].tolist() == [3.0, 0.0]
    assert [robot.name for robot in setup.followers] == ["van_2"]
    assert scenario.followers[0].desired == pytest.approx((4.5, 0.0))
    assert (scenario.horizon, scenario.step) == (12.0, 0.02)
    assert imported.runs
    assert imported.to_do[0] == "the_leader is taken as the leader"
    assert all(sentence.split(":")[0] in scenario.text for sentence in imported.to_do)


def test_values_of_inputs_and_outputs_are_taken_over_or_told(car: Path, tmp_path: Path) -> None:
    values = {"tau_d_y": 'Real value="20" unit="N"', "tau_d_x": 'Real value="2"', "v": 'Real value="1.5"'}
    ends = 'startElement="a" startConnector="x" endElement="b" endConnector="tau_d_x"'
    rest = f"<ssd:Connections><ssd:Connection {ends}/></ssd:Connections>"
    elements = component("a") + component("b", inner=with_set("b.ssv"))
    imported = import_ssp(system(tmp_path, car, elements, {"b.ssv": parameters(values)}, rest), tmp_path / "mine.xml")
    with ExitStack() as cleanup:
        follower = set_up(read_scenario(written(imported)), cleanup, {}).followers[0]
    inputs = {
        bound.role.name: values.tolist() for bound, values in zip(follower.inputs, follower.samples[0], strict=True)
    }
    assert inputs == {"tau_d_y": 20.0}
    told = "the connection of a.x with 'tau_d_x' of b is left out, and so is the value that it starts with"
    assert told in imported.to_do
    assert "the value of 'v' of b cannot be stated in a scenario, and is left out" in imported.to_do


def test_connections_between_vehicles_are_told_one_by_one(car: Path, tmp_path: Path) -> None:
    """But not those of commands, in whose place the law is."""
    ends = (("x", "b", "tau_d_x"), ("v", "b", "m_c"), ("y", "b", "tau_drive"), ("psi", "a", "tau_steer"))
    connections = "".join(
        f'<ssd:Connection startElement="a" startConnector="{start}" endElement="{end}" endConnector="{name}"/>'
        for start, end, name in ends
    )
    rest = f"<ssd:Connections>{connections}</ssd:Connections>"
    sets = {"s.ssv": parameters({"m_c": 'Real value="40"'}), "a.ssv": parameters({"tau_steer": 'Real value="2"'})}
    elements = component("a", inner=with_set("a.ssv")) + component("b", inner=with_set("s.ssv"))
    imported = import_ssp(system(tmp_path, car, elements, sets, rest), tmp_path / "mine.xml")
    assert [sentence for sentence in imported.to_do if "connection" in sentence] == [
        "the connection of a.psi with 'tau_steer' of a is left out, and so is the value that it starts with",
        "the connection of a.x with 'tau_d_x' of b is left out",
        "the connection of a.v with 'm_c' of b is left out: it keeps the value that it has besides",
    ]
    with ExitStack() as cleanup:
        setup = set_up(read_scenario(written(imported)), cleanup, {})
    assert setup.leader.torque[0].tolist() == [0.0, 0.0]
    assert [one.value for one in setup.followers[0].parameters] == [40.0]


def test_a_component_has_the_interface_that_it_asks_for(car: Path, tmp_path: Path) -> None:
    elements = [component(name, more=f'implementation="{how}"') for name, how in HOW.items()]
    imported = import_ssp(system(tmp_path, car, "".join(elements)), tmp_path / "mine.xml")
    assert [name for name in imported.files if name.suffix == ".fmu"] == [tmp_path / "mine_files" / "car.fmu"]
    assert len([sentence for sentence in imported.to_do if "has Model Exchange" in sentence]) == 1
    with ExitStack() as cleanup:
        setup = set_up(read_scenario(written(imported)), cleanup, {})
    used = {robot.name: robot.fmu.interface for robot in (setup.leader, *setup.followers)}
    assert used == {"leader": "co_simulation", "b": "model_exchange", "c": "co_simulation", "d": "model_exchange"}
    alone = tmp_path / "alone.fmu"
    with zipfile.ZipFile(car) as old, zipfile.ZipFile(alone, "w") as new:
        for name in old.namelist():
            data = old.read(name)
            if name == "modelDescription.xml":
                data, count = re.subn(rb"<ModelExchange[^>]*?(/>|>.*?</ModelExchange>)", b"", data, flags=re.DOTALL)
                assert count == 1
            new.writestr(name, data)
    for fmu, how, why in ((alone, "ModelExchange", "does not offer model_exchange"), (car, "Other", "read are any, ")):
        path = system(tmp_path, fmu, component("a", more=f'implementation="{how}"'))
        with pytest.raises(InputError, match=why):
            import_ssp(path, tmp_path / "mine.xml")


HOW = {"leader": "any", "b": "ModelExchange", "c": "CoSimulation", "d": "ModelExchange"}


def test_a_unit_that_the_fmu_leaves_open_takes_no_other_one(car: Path, tmp_path: Path) -> None:
    open_unit = tmp_path / "open.fmu"
    with zipfile.ZipFile(car) as old, zipfile.ZipFile(open_unit, "w") as new:
        for name in old.namelist():
            data = old.read(name)
            if name == "modelDescription.xml":
                data, count = re.subn(rb'(name="m_c"[^>]*>\s*<Real[^>]*unit=")kg"', rb'\1stone"', data)
                assert count == 1
            new.writestr(name, data)
    sets = {"s.ssv": parameters({"m_c": 'Real value="3" unit="kg"'})}
    path = system(tmp_path, open_unit, component("a", inner=with_set("s.ssv")), sets)
    with pytest.raises(InputError, match=r"'m_c' is in 'kg', and the unit that the FMU has is not known: .*stone"):
        import_ssp(path, tmp_path / "mine.xml")


@pytest.mark.parametrize(
    ("value", "name"),
    [('Integer value="2"', "front_wheel"), ('Enumeration value="rear_wheel"', "rear_wheel"), ('Integer value="7"', "")],
)
def test_an_enumeration_is_stated_by_the_name_of_its_item(value: str, name: str, car: Path, tmp_path: Path) -> None:
    path = system(tmp_path, car, component("a", inner=with_set("s.ssv")) + component("b"))
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("s.ssv", parameters({"drive": value}))
    if not name:
        with pytest.raises(InputError, match=r"'drive' is '7', which is none of its items: .*rear_wheel \("):
            import_ssp(path, tmp_path / "mine.xml")
        return
    with ExitStack() as cleanup:
        leader = set_up(read_scenario(written(import_ssp(path, tmp_path / "mine.xml"))), cleanup, {}).leader
    (drive,) = leader.parameters
    assert items(drive.variable)[int(drive.value)] == name


def test_what_is_no_vehicle_is_named(car: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(car) as archive:
        text = archive.read("modelDescription.xml").decode()
    for name in ("x", "y", "psi", "tau_drive", "tau_steer"):
        text = text.replace(f'name="{name}"', f'name="thing_{name}q"')
    other = tmp_path / "other.fmu"
    with zipfile.ZipFile(other, "w") as archive:
        archive.writestr("modelDescription.xml", text)
    path = system(tmp_path, car, component("car") + component("lamp", "lamp.fmu"))
    with zipfile.ZipFile(path, "a") as archive:
        archive.write(other, "lamp.fmu")
    imported = import_ssp(path, tmp_path / "mine.xml")
    assert any(s.startswith("left out, as they are no vehicles: lamp") for s in imported.to_do)
    assert not imported.runs  # a leader alone


def test_values_bound_to_the_system_reach_its_components(car: Path, tmp_path: Path) -> None:
    sets = {"all.ssv": parameters({"b.x": 'Real value="2"', "b.m_c": 'Real value="33" unit="kg"'})}
    path = system(tmp_path, car, component("a") + component("b"), sets, rest=with_set("all.ssv"))
    scenario = read_scenario(written(import_ssp(path, tmp_path / "mine.xml")))
    assert scenario.followers[0].pose.values["x"] == 2.0
    assert [(s.name, s.value) for s in scenario.followers[0].parameters] == [("m_c", "33.0 kg")]


LAST = "</ssd:Component>"
BAD = {
    "nested": ('<ssd:System name="inner"/>', {}, '<System name="inner"> is a system within the system'),
    "dictionary": ('<ssd:SignalDictionaryReference name="d" dictionary="x"/>', {}, "is no <Component>"),
    "other_type": (
        component("c", more='type="application/x-ssp-package"'),
        {},
        "<Component name=\"c\"> is of type 'application/x-ssp-package'; only FMUs are read",
    ),
    "missing_fmu": (component("c", "gone.fmu"), {}, "<Component name=\"c\"> names the FMU 'gone.fmu', which is not in"),
    "outside": (component("c", "../car.fmu"), {}, "names the FMU '../car.fmu'; only files in the SSP itself are read"),
    "web": (component("c", "https://example.org/car.fmu"), {}, "only files in the SSP itself are read"),
    "no_source": ('<ssd:Component name="c"/>', {}, "names no FMU: source=... is missing"),
    "unknown_unit": (
        component("c", inner=with_set("s.ssv")),
        {"s.ssv": parameters({"m_c": 'Real value="3" unit="stone"'})},
        "s.ssv:1:",
    ),
    "unit": (
        component("c", inner=with_set("s.ssv")),
        {"s.ssv": parameters({"m_c": 'Real value="3" unit="stone"'})},
        "<Real> has the unit 'stone', which the SSP does not define",
    ),
    "no_number": (
        component("c", inner=with_set("s.ssv")),
        {"s.ssv": parameters({"m_c": 'Real value="heavy"'})},
        '<Real> has value="heavy", which is no number',
    ),
    "no_set": (component("c", inner=with_set("s.ssv")), {}, "names the parameter set 's.ssv', which is not in the SSP"),
    "broken_set": (component("c", inner=with_set("s.ssv")), {"s.ssv": "<ssv:"}, "s.ssv:1:"),
    "entities": (
        component("c", inner=with_set("s.ssv")),
        {"s.ssv": '<!DOCTYPE x [<!ENTITY e "e">]><x>&e;</x>'},
        "a parameter set has no document type declaration",
    ),
    "mapping": (
        component(
            "c",
            inner='<ssd:ParameterBindings><ssd:ParameterBinding source="s.ssv"><ssd:ParameterMapping source="m.ssm"/>'
            "</ssd:ParameterBinding></ssd:ParameterBindings>",
        ),
        {"s.ssv": parameters({})},
        "has a <ParameterMapping>, which is not read",
    ),
    "no_url": (component("c", "http://[car"), {}, "which is no place of a file"),
    "long_name": (component("c", "c" * 3000), {}, "which is not in the SSP"),
    "text_for_a_number": (
        component("c", inner=with_set("s.ssv")),
        {"s.ssv": parameters({"x": 'String value="here"'})},
        "'x' is 'here', where a number is needed",
    ),
    "root_of_a_unit": (
        component("c", inner=with_set("s.ssv")),
        {"s.ssv": parameters({"x": 'Real value="1" unit="furlong"'}).replace('m="1"', 'm="0.5"')},
        "'furlong' has an exponent that is no whole number",
    ),
    "no_fmu": (component("c", "no.fmu"), {"no.fmu": "text"}, "is not an FMU"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_systems_are_refused_with_file_and_element(case: str, car: Path, tmp_path: Path) -> None:
    elements, texts, why = BAD[case]
    path = system(tmp_path, car, elements, texts)
    with pytest.raises(InputError) as refused:
        import_ssp(path, tmp_path / "mine.xml")
    said = str(refused.value)
    assert why in said
    assert "depot.ssp" in said or ".fmu" in said
    assert [p.name for p in tmp_path.iterdir()] == ["depot.ssp"]


def test_bad_connections_and_versions_are_refused(car: Path, tmp_path: Path) -> None:
    ends = 'startElement="a" startConnector="x" endElement="ghost" endConnector="y"'
    rest = f"<ssd:Connections><ssd:Connection {ends}/></ssd:Connections>"
    with pytest.raises(InputError, match=r"ssd:\d+:\d+: <Connection> names the element 'ghost', which is not there"):
        import_ssp(system(tmp_path, car, component("a"), rest=rest), tmp_path / "mine.xml")
    with pytest.raises(InputError, match=r"has version '3\.0'; versions 1\.0 and 2\.0 are read"):
        import_ssp(system(tmp_path, car, component("a"), version="3.0"), tmp_path / "mine.xml")


def test_an_ssp_without_vehicles_is_refused(car: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no component is recognised as a vehicle \(there is none\)"):
        import_ssp(system(tmp_path, car, ""), tmp_path / "mine.xml")


def test_broken_archives_are_refused(depot: Path, tmp_path: Path) -> None:
    whole = depot.read_bytes()
    cut = tmp_path / "cut.ssp"
    cut.write_bytes(whole[: len(whole) // 2])
    text = tmp_path / "text.ssp"
    text.write_text("no archive")
    other = tmp_path / "other.ssp"
    with zipfile.ZipFile(other, "w") as archive:
        archive.writestr("deep/SystemStructure.ssd", "<x/>")
    evil = tmp_path / "evil.ssp"
    with zipfile.ZipFile(evil, "w") as archive:
        archive.writestr("SystemStructure.ssd", "<x/>")
        archive.writestr("../../evil", "")
    for path, why in (
        (cut, "is not an SSP"),
        (text, "is not an SSP: File is not a zip file"),
        (other, "is not an SSP: it holds no SystemStructure.ssd, but deep/SystemStructure.ssd"),
        (evil, "has the entry '../../evil', which leads outside of the SSP"),
        (tmp_path / "gone.ssp", "the SSP"),
    ):
        with pytest.raises(InputError) as refused:
            import_ssp(path, tmp_path / "mine.xml")
        assert why in str(refused.value)
        assert str(path) in str(refused.value)


def test_names_that_cannot_be_scenarios_are_refused(depot: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"name a file that ends in \.xml"):
        import_ssp(depot, tmp_path / "mine.txt")
    with pytest.raises(InputError, match="the file's name becomes the scenario's name"):
        import_ssp(depot, tmp_path / "my scenario!.xml")
