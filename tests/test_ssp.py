"""A formation as a system of FMUs: in other people's masters as in Formation, and back again."""

from __future__ import annotations

import contextlib
import re
import shutil
import zipfile
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.ssp.ssd import read_ssd, read_ssv
from lxml import etree

import cosim
import plants
from cosim.cli import main
from cosim.errors import InputError
from cosim.master.setup import set_up
from cosim.scenario.reader import read_scenario
from cosim.ssp.exported import export_ssp
from cosim.ssp.imported import import_ssp
from cosim.tests.driving import scenario as write_scenario
from tests.stub.stub import make_fmu

from .ssp_masters import MASTERS, Exported, in_ecos, in_fmpy, written

ROOT = Path(__file__).parents[1]
HORIZON = {"clmr_line": 6.0, "tractor_trailer_circle": 6.0, "mixed_team": 41.0, "figure_eight": 4.0}
"""Ends of the runs [s]; the leader of mixed_team begins to turn at 40 s."""


_known: dict[str, Exported] = {}


@pytest.fixture(params=["clmr_line", "tractor_trailer_circle", "mixed_team"])
def exported(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Exported:
    return _exported(request.param, tmp_path_factory)


def _exported(name: str, folders: pytest.TempPathFactory) -> Exported:
    if name not in _known:
        scenario = read_scenario(ROOT / "scenarios" / f"{name}.xml")
        _known[name] = Exported(scenario.edited(horizon=HORIZON[name], expectations=False), folders.mktemp(name))
    return _known[name]


@pytest.fixture
def line(tmp_path_factory: pytest.TempPathFactory) -> Exported:
    return _exported("clmr_line", tmp_path_factory)


# Other masters ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("master", [*MASTERS])
def test_a_master_has_the_trajectories_of_our_run(exported: Exported, master: str) -> None:
    assert exported.apart(MASTERS[master](exported)) < 1e-9


def test_a_leader_on_a_path_is_an_fmu_of_its_own(tmp_path_factory: pytest.TempPathFactory) -> None:
    exported = _exported("figure_eight", tmp_path_factory)
    assert exported.apart(in_fmpy(exported)) < 1e-9


def test_one_fmu_with_the_whole_formation(line: Exported, tmp_path: Path) -> None:
    pytest.importorskip("fmu_manipulation_toolbox")
    from cosim.ssp.exported import export_fmu

    path = tmp_path / "formation.fmu"
    export_fmu(line.scenario, path)
    result = fmpy.simulate_fmu(
        str(path), output_interval=line.scenario.step, step_size=line.scenario.step, output=line.names
    )
    assert line.apart({name: result[name][1:] for name in line.names}) < 1e-9
    description = fmpy.read_model_description(path)
    assert float(description.defaultExperiment.stopTime) == line.scenario.horizon == result["time"][-1]
    assert not description.coSimulation.canHandleVariableCommunicationStepSize


SAME_NAMES = """<scenario xmlns="urn:formation-cosim:scenario:1" name="same_names"><title>Names</title>
<simulation horizon="2 s" step="20 ms" seed="1"/>
<plant id="mine" fmu="car.fmu"/><plant id="heavy" model="car_like"><parameter name="m_c" value="90 kg"/></plant>
<controller id="mine" name="feedback-linearisation" package="formation-controllers" version="~=0.1.0"/>
<actuator><saturation limit="30 N.m" to="1 s"/></actuator>
<leader plant="mine"><pose x="2.5 m" y="5.5 m" psi="0 deg" gamma="0 deg"/>
<torque tau_drive="0 N.m" tau_steer="0 N.m"/>
<input name="tau_drive"><step value="8 N.m" at="0.5 s"/></input></leader>
<follower id="mine" plant="heavy" controller="mine"><pose x="-2 m" y="3 m" psi="0 deg" gamma="0 deg"/>
<desired range="3 m" bearing="45 deg"/></follower>
<follower id="inputs" plant="mine" controller="mine"><pose x="-2 m" y="8 m" psi="0 deg" gamma="0 deg"/>
<desired range="3 m" bearing="-45 deg"/></follower></scenario>"""


def test_what_has_the_same_name_in_a_scenario_stays_apart(tmp_path: Path) -> None:
    """A plant of a file, a controller, a robot and the courses each have a file in the SSP."""

    def exported(to: str) -> Exported:
        folder = tmp_path / to
        folder.mkdir()
        shutil.copy(plants.build("car_like"), folder / "car.fmu")
        (folder / "same_names.xml").write_text(SAME_NAMES.replace('to="1 s"', f'to="{to}"'))
        return Exported(read_scenario(folder / "same_names.xml"), folder)

    one = exported("1 s")
    assert exported("1.02 s").apart(in_fmpy(one)) < 1e-9
    assert "the window of <saturation> in actuators is one communication step late, too: mine, inputs" in one.notes
    sources = [c.get("source") for c in _description(one.path).iterfind(".//{*}Component")]
    assert sorted(sources) == [
        f"resources/{name}.fmu" for name in ("given_inputs", "mine", "plant_mine", "plant_mine", "team_mine")
    ]
    path = one.path.with_name("parameters.xml")
    path.write_text(SAME_NAMES.replace('id="inputs"', 'id="parameters"'))
    with pytest.raises(InputError, match=r"parameters\.xml:11:1: no robot of an SSP can be called 'parameters'"):
        export_ssp(read_scenario(path), tmp_path / "parameters.ssp")


MIRRORED = """<binding vehicle="car_like">
<role name="y" variable="y" factor="-1"/><role name="psi" variable="psi" factor="-1"/>
<role name="gamma" variable="gamma" factor="-1"/><role name="omega" variable="omega" factor="-1"/>
<role name="tau_steer" variable="tau_steer" factor="-1"/></binding>"""


def test_a_binding_becomes_a_linear_transformation(tmp_path: Path) -> None:
    original = read_scenario(ROOT / "scenarios" / "clmr_line.xml").edited(horizon=2.0, expectations=False)
    shutil.copy(plants.build("car_like"), tmp_path / "car.fmu")
    text = original.text.replace('model="car_like">', f'fmu="car.fmu">{MIRRORED}')
    (tmp_path / "mirrored.xml").write_text(text)
    mirrored = Exported(read_scenario(tmp_path / "mirrored.xml"), tmp_path)
    assert any("libcosim sets no enumeration and no start value of an output" in note for note in mirrored.notes)
    root = _description(mirrored.path)
    factors = {
        (c.get("startElement"), c.get("endConnector")): c.find("{*}LinearTransformation")
        for c in root.iterfind(".//{*}Connection")
    }
    assert factors["follower_1", "follower_1.x"] is None
    for end in (("follower_1", "follower_1.y"), ("pid", "tau_steer")):
        assert dict(factors[end].attrib) in ({"factor": "-1.0", "offset": "0.0"}, {"factor": "-1.0", "offset": "-0.0"})
        assert factors[end].getparent().get("suppressUnitConversion") == "true"
    found = in_ecos(mirrored)
    signs = {name: -1.0 if name.endswith((".y", ".psi", ".gamma")) else 1.0 for name in mirrored.names}
    assert mirrored.apart({name: sign * found[name] for name, sign in signs.items()}) < 1e-9
    back = import_ssp(mirrored.path, tmp_path / "back.xml")
    assert [path.name for path in back.files] == ["1_car.fmu", "back.xml"]
    assert cosim.run(read_scenario(written(back)).edited(horizon=0.1)).pose.shape[0] == 6


def test_units_that_would_be_converted_wrongly_are_not_stated_and_other_solvers_are_told(tmp_path: Path) -> None:
    """FMUs that say mm and count metres, two with other units of one name, and Model Exchange of a built-in plant."""
    metres = "".join(f'<role name="{name}" variable="{name}" factor="1000"/>' for name in ("x", "y", "a"))
    text = (ROOT / "scenarios" / "clmr_line.xml").read_text(encoding="utf-8")
    first = '<plant id="clmr" model="car_like"'
    text = text.replace(first, f'{first} interface="model_exchange" solver="runge_kutta_4" solver_step="20 ms"')
    for number, factor in ((1, 1), (2, 1000)):
        with (
            zipfile.ZipFile(plants.build("car_like")) as built,
            zipfile.ZipFile(tmp_path / f"{number}.fmu", "w") as fmu,
        ):
            for entry in built.namelist():
                data = built.read(entry)
                if entry == "modelDescription.xml":
                    data = data.replace(b'="kg"', b'="lump"').replace(
                        b'<BaseUnit kg="1"/>', b'<BaseUnit kg="1" factor="%d"/>' % factor
                    )
                    data = data.replace(b'="m"', b'="mm"').replace(
                        b'<BaseUnit m="1"/>', b'<BaseUnit m="1" factor="1e-3"/>'
                    )
                fmu.writestr(entry, data)
        follower = f'<follower id="follower_{number}" plant='
        text = text.replace(f'{follower}"clmr"', f'{follower}"p{number}"').replace(
            "  <plant ",
            f'<plant id="p{number}" fmu="{number}.fmu"><binding vehicle="car_like">{metres}</binding>'
            '<parameter name="m_c" value="30 kg"/></plant>  <plant ',
            1,
        )
    (tmp_path / "units.xml").write_text(text, encoding="utf-8")
    scenario = read_scenario(tmp_path / "units.xml").edited(horizon=0.1, expectations=False)
    told = Exported(scenario, tmp_path)
    assert any(
        note.startswith("car_like is integrated by the solver of its Co-Simulation there") for note in told.notes
    )
    connections = {
        (c.get("startElement"), c.get("endConnector")): (c.get("suppressUnitConversion"), len(c))
        for c in _description(told.path).iterfind(".//{*}Connection")
    }
    assert connections["follower_1", "follower_1.x"] == ("true", 0)
    assert connections["follower_3", "follower_3.x"] == (None, 0)
    with zipfile.ZipFile(told.path) as archive:
        sets = [etree.fromstring(archive.read(f"resources/follower_{number}.ssv")) for number in (1, 2)]
    assert [of.find(".//{*}Parameter[@name='m_c']/{*}Real").get("unit") for of in sets] == ["lump", None]


# The file ---------------------------------------------------------------------------------------------------


def test_it_satisfies_the_schemas_and_is_the_same_again(exported: Exported, tmp_path: Path) -> None:
    description = read_ssd(str(exported.path))  # validates
    assert {component.name for component in description.system.elements} >= {"leader"}
    with zipfile.ZipFile(exported.path) as archive:
        sets = [name for name in archive.namelist() if name.endswith(".ssv")]
    assert len(sets) > len(exported.scenario.followers)
    for name in sets:
        assert read_ssv(str(exported.path), name).parameters
    again = tmp_path / "again.ssp"
    export_ssp(exported.scenario, again)
    assert again.read_bytes() == exported.path.read_bytes()


@pytest.mark.parametrize("version", ["1.0", "2.0"])
def test_pyssp_standard_reads_both_versions(version: str, line: Exported, tmp_path: Path) -> None:
    standard = pytest.importorskip("pyssp_standard")
    path = tmp_path / "of_version.ssp"  # a copy of its own: pyssp-standard writes what it has read
    export_ssp(line.scenario, path, version=version)
    schemas = Path(standard.__file__).parent / "resources" / ("ssp2" if version == "2.0" else "")
    with zipfile.ZipFile(path) as archive:
        texts = {name: archive.read(name) for name in archive.namelist() if name.endswith((".ssd", ".ssv"))}
    for name, text in texts.items():
        kind = "Description" if name.endswith(".ssd") else "ParameterValues"
        schema = etree.XMLSchema(etree.parse(str(schemas / f"SystemStructure{kind}.xsd")))
        schema.assertValid(etree.fromstring(text))
        assert f'version="{version}"' in text.decode()
    with standard.SSP(path) as ssp, ssp.system_structure as structure:
        assert {element.name for element in structure.system.elements} >= {"leader", "follower_1"}


def _description(path: Path) -> etree._Element:
    with zipfile.ZipFile(path) as archive:
        return etree.fromstring(archive.read("SystemStructure.ssd"))


def test_names_units_and_prefixes_are_as_simple_readers_need_them(line: Exported) -> None:
    root = _description(line.path)
    text = etree.tostring(root).decode()
    assert text.startswith("<ssd:SystemStructureDescription ")
    assert f'<osp:FixedStepAlgorithm baseStepSize="{line.scenario.step!r}"/>' in text
    components = root.findall(".//{*}Component")
    assert all(component.get("source", "").startswith("resources/") for component in components)
    units = {unit.get("name"): unit[0].get("factor") for unit in root.iterfind(".//{*}Unit")}
    used = {real.get("unit") for real in root.iterfind(".//{*}Connector/{*}Real")} - {None}
    assert used <= set(units)
    assert set(units.values()) == {"1.0"}
    assert root.find(".//{*}LinearTransformation") is None


# And back ---------------------------------------------------------------------------------------------------


def test_export_and_import_give_the_same_bits(exported: Exported, tmp_path: Path) -> None:
    imported = import_ssp(exported.path, tmp_path / f"{exported.scenario.name}.xml")
    assert (imported.notes, imported.to_do) == ((), ())
    scenario = read_scenario(written(imported))
    assert scenario.text == exported.scenario.text
    short = {"horizon": 1.0, "expectations": False}
    ours, back = cosim.run(exported.scenario.edited(**short)), cosim.run(scenario.edited(**short))
    for name in ("pose", "torque", "measured_pose", "leader_pose"):
        np.testing.assert_array_equal(ours[name].values, back[name].values)


def _changed(path: Path, into: Path, change: Callable[[str, bytes], bytes]) -> Path:
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(into, "w") as new:
        for name in old.namelist():
            new.writestr(name, change(name, old.read(name)))
    return into


def test_values_changed_in_the_ssp_are_those_of_the_scenario(line: Exported, tmp_path: Path) -> None:
    def change(name: str, data: bytes) -> bytes:
        text = data.decode("utf-8", "surrogateescape")
        if name == "resources/follower_1.ssv":
            text = text.replace('"30.0" unit="kg"', '"33.0" unit="kg"').replace('"-5.0" unit="m"', '"-6.5" unit="m"')
        elif name == "resources/pid.ssv":
            text = re.sub(r'(name="follower_2.k_d">\s*<ssv:Real value=")10.0', r"\g<1>12.5", text)
        elif name == "SystemStructure.ssd":
            text = text.replace(f'stopTime="{line.scenario.horizon!r}"', 'stopTime="3.0"')
            text = text.replace('endElement="follower_1"', 'endElement="follower_3"', 1)
        return text.encode("utf-8", "surrogateescape")

    path = _changed(line.path, tmp_path / "changed.ssp", change)
    imported = import_ssp(path, tmp_path / "changed.xml")
    scenario = read_scenario(written(imported))
    first, second = scenario.followers[:2]
    assert first.pose.values["x"] == -6.5
    assert [(setting.name, setting.value) for setting in first.parameters] == [("m_c", "33.0 kg")]
    assert [(setting.name, setting.value) for setting in second.gains] == [("k_d", "12.5")]
    assert scenario.horizon == 3.0
    assert len(imported.notes) == 1
    assert "the connections were changed" in imported.notes[0]


def test_a_changed_entry_of_a_gain_stands_with_the_others(line: Exported, tmp_path: Path) -> None:
    def change(name: str, data: bytes) -> bytes:
        for entry, value in {"K_p[2]": "25.0", "centres[1]": "-3.0", "centres[3]": "0.5"}.items():
            pattern = rf'(name="follower_2\.{re.escape(entry)}">\s*<ssv:Real value=")[^"]*'
            data = re.sub(pattern.encode(), rf"\g<1>{value}".encode(), data) if name == "resources/pid.ssv" else data
        return data

    with ExitStack() as cleanup:
        before = set_up(line.scenario, cleanup, {}).gains[1]
        imported = import_ssp(_changed(line.path, tmp_path / "changed.ssp", change), tmp_path / "changed.xml")
        after = set_up(read_scenario(written(imported)), cleanup, {}).gains
    assert imported.notes == ()
    centres = (-3.0, before.centres[1], 0.5, *before.centres[3:])
    assert after[1] == replace(before, K_p=(before.K_p[0], 25.0), centres=centres)
    assert after[0] == after[2] == before


def test_a_changed_input_has_its_value_beside_the_signals_that_the_scenario_has_of_it(
    line: Exported, tmp_path: Path
) -> None:
    constant = '<input name="{}"><constant value="{}"/></input>'
    text = line.scenario.text.replace("<leader ", constant.format("tau_d_y", "20 N") + "<leader ")
    text = re.sub(r"(<torque [^>]*/>)", r"\1" + constant.format("tau_drive", "5 N.m"), text, count=1)
    (tmp_path / "pushed.xml").write_text(text)
    scenario = read_scenario(tmp_path / "pushed.xml")
    export_ssp(scenario, tmp_path / "pushed.ssp")

    def change(name: str, data: bytes) -> bytes:
        pattern = {"leader.ssv": b"tau_drive", "follower_1.ssv": b"tau_d_y"}.get(Path(name).name, b"none of these")
        return re.sub(rb'(name="' + pattern + rb'">\s*<ssv:Real value=")[^"]*', rb"\g<1>31.0", data)

    path = _changed(tmp_path / "pushed.ssp", tmp_path / "changed.ssp", change)
    imported = import_ssp(path, tmp_path / "changed.xml")
    with ExitStack() as cleanup:
        setup = set_up(read_scenario(written(imported)), cleanup, {})
    assert setup.leader.torque[0, 0] == 31.0
    pushed = [robot.samples[0].tolist() for robot in setup.followers]
    assert pushed == [[31.0], *[[20.0]] * (len(pushed) - 1)]


def test_a_changed_whole_number_of_an_input_has_its_value_too(tmp_path: Path) -> None:
    """Signals of whole numbers are added up as well."""
    fmu = make_fmu(tmp_path / "fmus", fmi="3.0", discrete=True)
    path = write_scenario(tmp_path / "geared.xml", f'<plant id="car" fmu="{fmu}"/>')
    text = path.read_text("utf-8").replace("<leader ", '<input name="gear"><constant value="2"/></input><leader ')
    path.write_text(text, "utf-8")
    export_ssp(read_scenario(path), tmp_path / "geared.ssp")

    def change(name: str, data: bytes) -> bytes:
        pattern = rb'(?s)(name="gear">\s*<ssv:\w+ value=")2'
        return re.sub(pattern, rb"\g<1>3", data) if name.endswith("/follower_1.ssv") else data

    imported = import_ssp(_changed(tmp_path / "geared.ssp", tmp_path / "changed.ssp", change), tmp_path / "changed.xml")
    with ExitStack() as cleanup:
        setup = set_up(read_scenario(written(imported)), cleanup, {})
    assert [[held.value for held in robot.held if held.variable.name == "gear"] for robot in setup.followers] == [[3]]


def test_a_command_of_a_follower_is_its_controllers(line: Exported, tmp_path: Path) -> None:
    torque = '<ssv:Parameter name="tau_drive"><ssv:Real value="3.0" unit="N.m"/></ssv:Parameter></ssv:Parameters>'
    path = _with(line, tmp_path / "given.ssp", "resources/follower_1.ssv", "</ssv:Parameters>", torque)
    (note,) = import_ssp(path, tmp_path / "given.xml").notes
    assert note == "follower_1.tau_drive was changed, which the scenario cannot state: it keeps its own value"


_INLINE = """\
<ssd:ParameterBinding><ssd:ParameterValues><ssv:ParameterSet version="1.0" name="more"
xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"><ssv:Parameters><ssv:Parameter name="x">
<ssv:Real value="-6.5" unit="m"/></ssv:Parameter></ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues>
</ssd:ParameterBinding>"""


def test_values_that_stand_in_the_description_are_those_of_the_scenario(line: Exported, tmp_path: Path) -> None:
    pattern = r'(source="resources/follower_1\.ssv"/>)'
    path = _with(line, tmp_path / "inline.ssp", "SystemStructure.ssd", pattern, rf"\1{_INLINE}")
    imported = import_ssp(path, tmp_path / "inline.xml")
    assert imported.notes == ()
    assert read_scenario(written(imported)).followers[0].pose.values["x"] == -6.5


def test_what_was_removed_or_added_is_told(line: Exported, tmp_path: Path) -> None:
    pattern = r'(?s)<ssv:Parameter name="follower_2\.k_d">.*?</ssv:Parameter>'
    path = _with(line, tmp_path / "removed.ssp", "resources/pid.ssv", pattern, "")
    (note,) = import_ssp(path, tmp_path / "removed.xml").notes
    assert note.endswith("which the scenario cannot state: it keeps its own of pid.follower_2.k_d")
    new = '<ssd:Component name="new" source="resources/follower_1.fmu"/>'
    path = _with(line, tmp_path / "added.ssp", "SystemStructure.ssd", "</ssd:Elements>", f"{new}</ssd:Elements>")
    (note,) = import_ssp(path, tmp_path / "added.xml").notes
    assert note == "the component new with resources/follower_1.fmu was added since the export, and is left out"


_TO_LAW = r'(endElement="pid" endConnector="follower_1.x")/>'


@pytest.mark.parametrize(
    ("pattern", "by", "note"),
    [
        (
            'source="resources/follower_1.fmu"',
            'source="resources/follower_2.fmu"',
            "the component follower_1 has another FMU since the export, resources/follower_2.fmu: the scenario keeps",
        ),
        (
            _TO_LAW,
            r"\1><ssc:BooleanMappingTransformation/></ssd:Connection>",
            "the connections were changed since the export",
        ),
        (_TO_LAW, r"\1><!-- said --><ssd:ConnectionGeometry pointsX='1' pointsY='2'/></ssd:Connection>", ""),
        (
            '(name="follower_1" [^>]*implementation=)"CoSimulation"',
            r'\1"ModelExchange"',
            "the component follower_1 was changed to Model Exchange since the export: the scenario keeps",
        ),
    ],
)
def test_another_fmu_or_a_changed_connection_is_told(
    line: Exported, tmp_path: Path, pattern: str, by: str, note: str
) -> None:
    imported = import_ssp(_with(line, tmp_path / "a.ssp", "SystemStructure.ssd", pattern, by), tmp_path / "a.xml")
    assert len(imported.notes) == bool(note)
    assert "".join(imported.notes).startswith(note)


def test_a_robot_with_another_file_as_its_fmu_is_told(tmp_path: Path) -> None:
    """The file that it had is the one which the scenario in the SSP names."""
    shutil.copy(plants.build("car_like"), tmp_path / "car.fmu")
    (tmp_path / "same_names.xml").write_text(SAME_NAMES)
    export_ssp(read_scenario(tmp_path / "same_names.xml"), tmp_path / "own.ssp")

    def change(name: str, data: bytes) -> bytes:
        if name != "SystemStructure.ssd":
            return data
        return re.sub(rb'(name="inputs"[^>]*source="resources/)plant_mine', rb"\1mine", data)

    path = _changed(tmp_path / "own.ssp", tmp_path / "changed.ssp", change)
    (note,) = import_ssp(path, tmp_path / "changed.xml").notes
    assert note.startswith("the component inputs has another FMU since the export, resources/mine.fmu: the scenario")
    assert import_ssp(tmp_path / "own.ssp", tmp_path / "changed.xml").notes == ()


_POSE = r'(name="x">\s*)<ssv:Real value="-5.0" unit="m"/>'
_GAIN = r'(name="follower_2.k_d">\s*)<ssv:Real value="10.0"[^>]*/>'


def _with(line: Exported, into: Path, file: str, pattern: str, by: str) -> Path:
    """Return the SSP with another text in one of its files."""

    def change(name: str, data: bytes) -> bytes:
        if name != file:
            return data
        found, count = re.subn(pattern, by, data.decode(), count=1)
        assert count
        return found.encode("latin-1")

    return _changed(line.path, into, change)


def test_a_value_changed_to_another_unit_is_converted(line: Exported, tmp_path: Path) -> None:
    pose = r'\1<ssv:Real value="-0.0075" unit="km"/>'
    path = _with(line, tmp_path / "moved.ssp", "resources/follower_1.ssv", _POSE, pose)
    scenario = read_scenario(written(import_ssp(path, tmp_path / "moved.xml")))
    assert scenario.followers[0].pose.values["x"] == -7.5


def _adding(name: str, value: str) -> str:
    return f'<ssv:Parameter name="{name}"><ssv:Real {value}/></ssv:Parameter></ssv:Parameters>'


def test_an_added_value_is_converted_to_the_unit_of_the_fmu(line: Exported, tmp_path: Path) -> None:
    added = _adding("tau_d_y", 'value="2" unit="kN"')
    path = _with(line, tmp_path / "a.ssp", "resources/follower_1.ssv", "</ssv:Parameters>", added)
    imported = import_ssp(path, tmp_path / "a.xml")
    with ExitStack() as cleanup:
        robot = set_up(read_scenario(written(imported)), cleanup, {}).followers[0]
    assert imported.notes == ()
    assert robot.samples[0].tolist() == [2000.0]


@pytest.mark.parametrize(("name", "has"), [("tau_d_y", "'N'"), ("m_c", "'kg'"), ("x", "'m'")])
def test_an_added_value_of_another_quantity_is_refused(line: Exported, tmp_path: Path, name: str, has: str) -> None:
    added = _adding(name, 'value="2" unit="rad"')
    path = _with(line, tmp_path / "a.ssp", "resources/follower_1.ssv", "</ssv:Parameters>", added)
    with pytest.raises(InputError, match=rf"'{name}' is in 'rad', and the FMU has it in {has}, which is another"):
        import_ssp(path, tmp_path / "a.xml")


UNITLESS = """<binding vehicle="car_like"><role name="x" variable="x" unit="m"/></binding>"""


def test_a_value_of_a_binding_or_of_a_connected_input(tmp_path: Path) -> None:
    """A binding states the unit that the FMU does not, the SSP what its units are; connected inputs keep their own."""
    _rewritten(plants.build("car_like"), tmp_path / "car.fmu", rb'(<ScalarVariable name="x"[^>]*>\s*<Real) unit="m"')
    text = SAME_NAMES.replace('fmu="car.fmu"/>', f'fmu="car.fmu">{UNITLESS}</plant>')
    (tmp_path / "same_names.xml").write_text(text)
    export_ssp(read_scenario(tmp_path / "same_names.xml"), tmp_path / "own.ssp")
    torque, mass = _adding("tau_drive", 'value="3" unit="kN.m"'), _adding("m_c", 'value="50" unit="g"')
    grams = '<ssv:Units><ssc:Unit name="g"><ssc:BaseUnit kg="1"/></ssc:Unit>'

    def change(name: str, data: bytes) -> bytes:
        if name != "resources/leader.ssv":
            return data
        text, count = re.subn(r'(name="x">\s*<ssv:Real value=")2.5"', r'\g<1>-500" unit="cm"', data.decode())
        assert count == 1
        text = text.replace("</ssv:Parameters>", torque).replace("</ssv:Parameters>", mass)
        return text.replace("<ssv:Units>", grams).encode()

    imported = import_ssp(_changed(tmp_path / "own.ssp", tmp_path / "changed.ssp", change), tmp_path / "changed.xml")
    with ExitStack() as cleanup:
        leader = set_up(read_scenario(written(imported)), cleanup, {}).leader
    assert imported.notes == ("leader.tau_drive was changed, which the scenario cannot state: it keeps its own value",)
    assert leader.pose[0] == -5.0
    assert [(one.variable.name, one.value) for one in leader.parameters] == [("m_c", 50.0)]
    assert leader.torque[[0, -1], 0].tolist() == [0.0, 8.0]


def _rewritten(fmu: Path, into: Path, pattern: bytes) -> None:
    """Write an FMU in whose description a pattern has become its first group."""
    with zipfile.ZipFile(fmu) as old, zipfile.ZipFile(into, "w") as new:
        for name in old.namelist():
            data, count = (
                re.subn(pattern, rb"\1", old.read(name)) if name == "modelDescription.xml" else (old.read(name), 1)
            )
            assert count == 1
            new.writestr(name, data)


@pytest.mark.parametrize(
    ("file", "pattern", "by", "why"),
    [
        ("follower_1.ssv", _POSE, r'\1<ssv:String value="here"/>', "'x' is 'here', where a number is needed"),
        ("follower_1.ssv", _POSE, r'\1<ssv:Real value="1.0" unit="kg"/>', "in 'm', which is another quantity"),
        ("pid.ssv", _GAIN, r'\1<ssv:Boolean value="true"/>', "'follower_2.k_d' is 'true', where a number is needed"),
        ("pid.ssv", _GAIN, r'\1<ssv:Real value="1.0" unit="km"/>', "'follower_2.k_d' is in 'km'.*another quantity"),
        ("scenario.xml", "</title>", "\xe9</title>", r"scenario\.xml: is no text in UTF-8"),
        ("scenario.xml", 'model="car_like"', f'fmu="{"a" * 3000}"', ""),
    ],
)
def test_changes_that_make_no_sense_are_refused(
    line: Exported, tmp_path: Path, file: str, pattern: str, by: str, why: str
) -> None:
    path = _with(line, tmp_path / "changed.ssp", f"resources/{file}", pattern, by)
    with pytest.raises(InputError, match=why) if why else contextlib.nullcontext():
        import_ssp(path, tmp_path / "changed.xml")


_STOP, _BASE = r'stopTime="[^"]*"', r'baseStepSize="[^"]*"'
_FACTS = r"<formation:Scenario.*?</formation:Scenario>"


@pytest.mark.parametrize(
    ("pattern", "by", "why"),
    [
        (_STOP, 'stopTime="-1.0"', r'<DefaultExperiment> has stopTime="-1.0", which is not positive'),
        (_STOP, 'stopTime="0"', r'<DefaultExperiment> has stopTime="0", which is not positive'),
        (_STOP, 'stopTime="NaN"', r'<DefaultExperiment> has stopTime="NaN", which is no number'),
        (_STOP, 'stopTime="INF"', r'<DefaultExperiment> has stopTime="INF", which is no number'),
        (_STOP, 'stopTime="1_0"', r'<DefaultExperiment> has stopTime="1_0", which is no number'),
        (_STOP, 'stopTime="1e120"', "states 1e\\+120 s, where at most 1e\\+100 s are possible"),
        (_STOP, 'stopTime="1e9"', "has 5e\\+10 communication steps of 0.02 s; at most 10000000 are possible"),
        (_STOP, 'stopTime="0.013"', "ends at 0.013 s, which is not a whole number of communication steps of 0.02 s"),
        ('startTime="0"', 'startTime="1.5"', "<DefaultExperiment> starts at 1.5 s; a scenario starts at 0 s"),
        ('startTime="0"', 'startTime="nan"', "which is no number"),
        (_BASE, 'baseStepSize="0.0"', r'<FixedStepAlgorithm> has baseStepSize="0.0", which is not positive'),
        (_BASE, 'baseStepSize="-0.02"', "which is not positive"),
        (_BASE, 'baseStepSize="inf"', "which is no number"),
        (_BASE, 'baseStepSize="0.07"', "ends at 6 s, which is not a whole number of communication steps of 0.07 s"),
        (
            r'(endConnector="tau_drive")/>',
            r'\1><ssc:LinearTransformation factor="0"/></ssd:Connection>',
            "by which nothing",
        ),
        ('name="follower_2" type', 'name="follower_1" type', "'follower_1' is the name of two components"),
        ('factor="1.0"', 'factor="NaN"', 'has factor="NaN", which is no number'),
    ],
)
@pytest.mark.parametrize("is_own", [True, False])
def test_numbers_that_make_no_run_are_refused(
    line: Exported, tmp_path: Path, pattern: str, by: str, why: str, is_own: bool
) -> None:
    path = _with(line, tmp_path / "odd.ssp", "SystemStructure.ssd", pattern, by)
    if not is_own:
        path = _foreign(path, tmp_path)
    with pytest.raises(InputError, match=rf"^{re.escape(str(path))}/SystemStructure\.ssd:\d+:\d+: .*{why}"):
        import_ssp(path, tmp_path / "odd.xml")


def _foreign(path: Path, folder: Path) -> Path:
    """Return an SSP without the words about its scenario."""

    def change(name: str, data: bytes) -> bytes:
        return re.sub(_FACTS.encode(), b"", data, flags=re.DOTALL) if name.endswith(".ssd") else data

    return _changed(path, folder / f"foreign_{path.name}", change)


def test_a_step_that_is_too_long_is_named_by_its_own_place(line: Exported, tmp_path: Path) -> None:
    path = _with(line, tmp_path / "odd.ssp", "SystemStructure.ssd", _BASE, 'baseStepSize="1e110"')
    with pytest.raises(InputError, match=r"the experiment states 1e\+110 s") as refused:
        import_ssp(path, tmp_path / "odd.xml")
    assert refused.value.where is not None
    with zipfile.ZipFile(path) as archive:
        assert b"baseStepSize" in archive.read("SystemStructure.ssd").splitlines()[refused.value.where.line - 1]


@pytest.mark.parametrize(
    ("stop", "base", "step", "end", "unstated"),
    [
        ('stopTime="1.013"', "", 0.02, 1.02, "no step"),
        ("", 'baseStepSize="0.07"', 0.07, 60.06, "no end"),
        ("", "", 0.02, 60.0, "no step and no end"),
    ],
)
def test_an_end_within_a_step_is_put_off_if_one_of_them_is_not_stated(
    line: Exported, tmp_path: Path, stop: str, base: str, step: float, end: float, unstated: str
) -> None:
    path = _with(line, tmp_path / "odd.ssp", "SystemStructure.ssd", f"(?s){_STOP}(.*){_BASE}", rf"{stop}\1{base}")
    imported = import_ssp(_foreign(path, tmp_path), tmp_path / "odd.xml")
    scenario = read_scenario(written(imported))
    assert (scenario.step, scenario.horizon) == (step, pytest.approx(end))
    told = f"the run has a step of {step:g} s and ends at {end:g} s: the SSP states {unstated}"
    assert told in imported.to_do


def test_a_broken_fmu_is_named_by_its_place_in_the_ssp(line: Exported, tmp_path: Path) -> None:
    def change(name: str, data: bytes) -> bytes:
        return b"no archive" if name == "resources/follower_1.fmu" else data

    path = _foreign(_changed(line.path, tmp_path / "broken.ssp", change), tmp_path)
    with pytest.raises(InputError) as refused:
        import_ssp(path, tmp_path / "broken.xml")
    assert f"{path}, resources/follower_1.fmu is not an FMU" in str(refused.value)
    assert "formation-ssp-" not in str(refused.value)


def test_a_quotation_mark_in_a_changed_name_is_a_name_that_is_not_there(line: Exported, tmp_path: Path) -> None:
    path = _with(line, tmp_path / "changed.ssp", "resources/pid.ssv", 'name="follower_2.k_d"', 'name="it\'s.k_d"')
    _removed, note = import_ssp(path, tmp_path / "changed.xml").notes
    assert note.startswith("pid.it's.k_d was changed, which the scenario cannot state")


@pytest.mark.parametrize("entry", ["K_p", "K_p[3]", "K_p[0]", "k_d[1]", "x[1]", "K_q[1]"])
def test_an_entry_that_a_gain_does_not_have_is_told(line: Exported, tmp_path: Path, entry: str) -> None:
    path = _with(
        line,
        tmp_path / "changed.ssp",
        "resources/pid.ssv",
        r'name="follower_2\.K_p\[1\]"',
        f'name="follower_2.{entry}"',
    )
    _removed, note = import_ssp(path, tmp_path / "changed.xml").notes
    assert note.startswith(f"pid.follower_2.{entry} was changed, which the scenario cannot state")


def test_the_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, scenario = tmp_path / "line.ssp", tmp_path / "mine.xml"
    original = str(ROOT / "scenarios" / "clmr_line.xml")
    assert main(["export", original, "--ssp", str(path), "--horizon", "6 s", "--no-expectations"]) == 0
    said = capsys.readouterr().out
    assert '<delay time="0.02 s"/>' in " ".join(said.split())
    assert main(["import", str(path), "--out", str(scenario)]) == 0
    assert "formation run" in capsys.readouterr().out
    assert main(["import", str(path), "--out", str(scenario)]) == 2
    assert "--force overwrites it" in " ".join(capsys.readouterr().err.split())
    assert main(["export", original, "--ssp", str(tmp_path / "line.zip")]) == 2
    assert "name a file that ends in .ssp" in " ".join(capsys.readouterr().err.split())
    assert main(["export", str(tmp_path), "--seed", "3"]) == 2
    assert "--seed changes a scenario" in " ".join(capsys.readouterr().err.split())
    assert main(["export", str(tmp_path), "--environment", "pid=env"]) == 2
    assert "--environment changes a scenario" in " ".join(capsys.readouterr().err.split())


def test_torques_and_stops_in_the_course_of_the_run_are_stated(tmp_path: Path) -> None:
    """The torque of the leader changes when it does in our run; a follower stops one step later, as torques come."""

    def exported(stop: str) -> Exported:
        def change(root: etree._Element) -> None:
            root.find("leader/torque").attrib.update({"tau_drive": "0 N.m", "tau_steer": "0 N.m"})  # as FMPy begins
            torque = "<event at='0.5 s' robots='leader'><torque tau_drive='12 N.m' tau_steer='0.1 N.m'/></event>"
            stops = ((stop, "follower_2"), ("0.8 s", "leader"))
            ends = [f"<event at='{at}' robots='{robot}'><stop/></event>" for at, robot in stops]
            root.extend(etree.fromstring(event) for event in (torque, *ends))

        folder = tmp_path / stop
        folder.mkdir()
        scenario = read_scenario(ROOT / "scenarios" / "clmr_line.xml")
        return Exported(scenario.edited([change], horizon=1.0, expectations=False), folder)

    one = exported("0.6 s")
    assert exported("0.62 s").apart(in_fmpy(one)) < 1e-9
    assert one.notes == ("the <stop/> of follower_2 acts one communication step late, too",)


def test_what_an_ssp_cannot_state_is_refused(tmp_path: Path) -> None:
    scenario = read_scenario(ROOT / "scenarios" / "heavy_payload.xml")
    with pytest.raises(InputError, match=r"heavy_payload\.xml:8:5: this event changes follower_1"):
        export_ssp(scenario, tmp_path / "payload.ssp")
    assert not list(tmp_path.iterdir())
