"""Foreign FMUs: each kind of bad file has its message, and fitting variables are bound by role and unit."""

import re
import tempfile
import time
import zipfile
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

import plants
from cosim.errors import InputError, Location
from cosim.fmu.parameters import geometry, understand
from cosim.fmu.vehicle import Fmu, open_fmu
from cosim.scenario.scenario import BindingSource, RoleSource, Setting
from tests.stub.broken import BROKEN, EVIL, make_broken
from tests.stub.stub import Options, description, make_fmu

from .driving import drive, fleet

HERE = Location("scenario.xml", 3, 5)


@pytest.fixture(scope="module")
def car() -> Path:
    return plants.build("car_like")


def repack(
    source: Path, target: Path, old: str = "", new: str = "", extra: str = "", leave_out: str = "nothing"
) -> Path:
    """Copy an FMU with a replacement in its model description, an extra entry, or without some entries."""
    with zipfile.ZipFile(source) as original, zipfile.ZipFile(target, "w") as copy:
        for entry in original.infolist():
            if leave_out in entry.filename:
                continue
            data = original.read(entry)
            if entry.filename == "modelDescription.xml" and old:
                assert old.encode() in data
                data = data.replace(old.encode(), new.encode())
            copy.writestr(entry.filename, data)
        if extra:
            copy.writestr(extra, b"x")
    return target


def refused(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        open_fmu(path, HERE).close()
    assert caught.value.where == HERE
    assert str(path) in caught.value.message
    return caught.value.message


def test_missing(tmp_path: Path) -> None:
    assert "cannot be read: there is no such file" in refused(tmp_path / "none.fmu")


def test_no_archive(tmp_path: Path) -> None:
    path = tmp_path / "text.fmu"
    path.write_text("not a zip file")
    assert "is not an FMU: File is not a zip file" in refused(path)


def test_truncated(car: Path, tmp_path: Path) -> None:
    path = tmp_path / "half.fmu"
    path.write_bytes(car.read_bytes()[: car.stat().st_size // 2])
    assert "is not an FMU" in refused(path)


def test_damaged(car: Path, tmp_path: Path) -> None:
    data = bytearray(car.read_bytes())
    start = data.index(b"modelDescription.xml") + 100
    data[start : start + 50] = bytes(50)
    path = tmp_path / "damaged.fmu"
    path.write_bytes(data)
    refused(path)


def test_no_description(car: Path, tmp_path: Path) -> None:
    path = repack(car, tmp_path / "a.fmu", leave_out="modelDescription.xml")
    assert "it holds no modelDescription.xml" in refused(path)


def test_entry_outside(car: Path, tmp_path: Path) -> None:
    path = repack(car, tmp_path / "a.fmu", extra="../../escaped.txt")
    assert "has the entry '../../escaped.txt', which leads outside of the FMU" in refused(path)
    assert not (tmp_path.parent / "escaped.txt").exists()


def test_document_type(car: Path, tmp_path: Path) -> None:
    path = repack(car, tmp_path / "a.fmu", "<fmiModelDescription", "<!DOCTYPE a><fmiModelDescription")
    assert "declares a document type" in refused(path)


def test_invalid_description(car: Path, tmp_path: Path) -> None:
    path = repack(car, tmp_path / "a.fmu", 'valueReference="', 'valueReference="number ')
    assert re.search(r"has no valid model description: line \d+: .*'number \d+' is not a valid value", refused(path))


def test_another_root_element(car: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", "<model/>")
    assert "it begins with <model>; expected <fmiModelDescription fmiVersion=...>" in refused(path)


def test_no_binary_for_this_machine(car: Path, tmp_path: Path) -> None:
    path = repack(car, tmp_path / "a.fmu", leave_out="binaries")
    assert "has no binary for this machine" in refused(path)


def test_roles_that_are_missing_are_named(car: Path, tmp_path: Path) -> None:
    path = repack(car, tmp_path / "a.fmu", 'name="tau_steer"', 'name="steering_torque"')
    assert "as a car_like vehicle it lacks the input 'tau_steer' [N.m]" in refused(path)


# Parameters -----------------------------------------------------------------------------------------------------------


@pytest.fixture
def fmu(car: Path):
    opened = open_fmu(car, HERE)
    yield opened
    opened.close()
    assert not opened.directory.exists()


def setting(name: str, value: str) -> Setting:
    return Setting(name, value, HERE)


def test_geometry_is_that_of_the_parameters(fmu: Fmu) -> None:
    parameters = understand(fmu, [setting("a", "80 cm"), setting("drive", "rear_wheel")])
    assert geometry(fmu, parameters, HERE) == {"wheelbase": 0.8, "drive": "rear_wheel"}
    assert geometry(fmu, (), HERE) == {"wheelbase": 1.2, "drive": "as_printed"}


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        ("mass", "30 kg", "has no parameter 'mass'"),
        ("m_C", "30 kg", "did you mean 'm_c'?"),
        ("m_c", "-30 kg", "-30 kg is out of bounds; it must be at least"),
        ("m_c", "30", "the unit is missing; expected a quantity such as '30 kg'"),
        ("m_c", "30 m", "does not fit"),
        ("m_c", "heavy", "is not a number with a unit"),
        ("drive", "all_wheel", "is none of its items"),
        ("x", "1 m", "has no parameter 'x'"),
    ],
)
def test_bad_parameters(fmu: Fmu, name: str, value: str, sentence: str) -> None:
    with pytest.raises(InputError) as caught:
        understand(fmu, [setting(name, value)])
    assert caught.value.where == HERE
    assert sentence in caught.value.message


def test_a_parameter_by_the_role_that_it_plays(car: Path, tmp_path: Path) -> None:
    """In the unit that the binding knows: here the FMU states none."""
    renamed = repack(car, tmp_path / "a.fmu", ' name="a"', ' name="L"')
    path = repack(renamed, tmp_path / "b.fmu", 'unit="m" min="1e-06" start="1.2"', 'min="1" start="1200"')
    role = RoleSource(name="a", variable="L", unit="mm", where=HERE)
    with closing(open_fmu(path, HERE, BindingSource("car_like", (role,), HERE))) as opened:
        (value,) = understand(opened, [setting("a", "80 cm")])
        assert (value.variable.name, value.value) == ("L", pytest.approx(800.0))
        assert geometry(opened, [value], HERE)["wheelbase"] == pytest.approx(0.8)
        for text, sentence in (("0.5 mm", "out of bounds"), ("1 kg", "does not fit"), ("800", "the unit is missing")):
            with pytest.raises(InputError, match=sentence):
                understand(opened, [setting("a", text)])
        (value,) = understand(opened, [setting("L", "900")])
        assert geometry(opened, [value], HERE)["wheelbase"] == pytest.approx(0.9)
        with pytest.raises(InputError, match="has no parameter 'gamma'"):
            understand(opened, [setting("gamma", "1 rad")])


def test_a_constant_of_the_binding_may_be_set_to_itself(car: Path, tmp_path: Path) -> None:
    path = repack(car, tmp_path / "a.fmu", ' name="drive"', ' name="axle"')
    path = repack(path, tmp_path / "b.fmu", ' name="a"', ' name="L"')
    roles = (
        RoleSource(name="a", value="1200 mm", where=HERE),
        RoleSource(name="drive", value="as_printed", where=HERE),
    )
    with closing(open_fmu(path, HERE, BindingSource("car_like", roles, HERE))) as opened:
        assert understand(opened, [setting("a", "1.2 m"), setting("drive", "as_printed")]) == ()
        for name, text, sentence in (
            ("a", "1.3 m", "parameter a of b.fmu: '1.3 m' contradicts the binding, which states 1.2 m"),
            ("a", "1.2", "the unit is missing"),
            ("drive", "rear_wheel", "drive of b.fmu: 'rear_wheel' contradicts the binding, which states as_printed"),
        ):
            with pytest.raises(InputError, match=sentence):
                understand(opened, [setting(name, text)])


def test_a_parameter_beside_a_constant_of_the_same_name_has_its_value(car: Path) -> None:
    """The FMU has a parameter a, and the binding states a wheelbase of its own: the two are the same or refused."""
    role = RoleSource(name="a", value="1.5 m", where=HERE)
    with closing(open_fmu(car, HERE, BindingSource("car_like", (role,), HERE))) as opened:
        (value,) = understand(opened, [setting("a", "1500 mm")])
        assert value.value == 1.5
        with pytest.raises(InputError, match=r"parameter a: '1\.3 m' contradicts the binding"):
            understand(opened, [setting("a", "1.3 m")])
        with pytest.raises(InputError, match="the unit is missing"):
            understand(opened, [setting("a", "1.3")])


def test_an_enumeration_is_set_by_the_role_that_it_plays(car: Path, tmp_path: Path) -> None:
    path = repack(car, tmp_path / "a.fmu", ' name="drive"', ' name="axle"')
    role = RoleSource(name="drive", variable="axle", where=HERE)
    with closing(open_fmu(path, HERE, BindingSource("car_like", (role,), HERE))) as opened:
        values = understand(opened, [setting("drive", "rear_wheel")])
        assert geometry(opened, values, HERE)["drive"] == "rear_wheel"


# Broken files, each in one way ----------------------------------------------------------------------------------------

OPENED = {
    "empty_file": "is not an FMU: File is not a zip file",
    "no_zip": "is not an FMU: File is not a zip file",
    "empty_zip": "is not an FMU: it holds no modelDescription.xml",
    "truncated": "is not an FMU: File is not a zip file",
    "crc": "cannot be unpacked: Bad CRC-32 for file 'binaries/",
    "description_crc": "is not an FMU: Bad CRC-32 for file 'modelDescription.xml'",
    "encrypted": "is not an FMU: its entry 'modelDescription.xml' is encrypted",
    "no_description": "is not an FMU: it holds no modelDescription.xml",
    "two_descriptions": "has the entry 'modelDescription.xml' twice",
    "no_xml": "has no valid model description: Start tag expected",
    "no_utf8": "has no valid model description: Error reading file 'modelDescription.xml': Invalid bytes in character",
    "fmi_4": "has no valid model description: Unsupported FMI version: 4.0",
    "entity_bomb": "declares a document type in its modelDescription.xml",
    "external_entity": "declares a document type in its modelDescription.xml",
    "parent_entry": f"has the entry '../{EVIL}', which leads outside of the FMU",
    "backslash_entry": f"has the entry '..\\\\{EVIL}', which leads outside of the FMU",
    "absolute_entry": f"has the entry '/tmp/{EVIL}', which leads outside of the FMU",
    "link_entry": "has the symbolic link 'resources/link', not a file",
    "identifier_outside": f"has the model identifier '../../{EVIL}', which is no ",
    "no_identifier": "has the model identifier '', which is no ",
    "duplicate_names": "it has more than one variable 'x'",
    "duplicate_references": "it cannot be given 'x' and 'y' through the same number, 'y'",
    "no_binaries": "has no binary for this machine",
    "other_platforms": "has no binary for this machine",
    "misnamed_binary": "only: another",
}
"""What is refused when the file is opened, and how."""
STARTED = {
    "wrong_token": "the token {00000000-0000-0000-0000-000000000000} is not that of this binary",
    "other_machine": "its binary cannot be loaded: it is made for another machine",
    "text_binary": "its binary cannot be loaded: binaries/",
    "empty_binary": "its binary cannot be loaded: binaries/",
    "no_do_step": "its binary cannot be loaded: binaries/",
}
"""What is refused when a robot is started, and how."""
WORKS = ("undefined_unit", "no_start")


def test_all_are_known() -> None:
    assert {*OPENED, *STARTED, *WORKS} == set(BROKEN)


Broken = Callable[[str, str], Path]


@pytest.fixture(scope="module")
def broken(tmp_path_factory: pytest.TempPathFactory) -> Broken:
    return lambda kind, fmi: make_broken(tmp_path_factory.mktemp("broken"), kind, fmi=fmi)


@pytest.mark.parametrize("fmi", ["1.0", "2.0", "3.0"])
@pytest.mark.parametrize("kind", OPENED)
def test_refused_when_it_is_opened(
    broken: Broken, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, fmi: str
) -> None:
    """With a sentence on one line, that names no temporary folder; nothing is left behind, in there or elsewhere."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    path = broken(kind, fmi)
    said = refused(path)
    assert OPENED[kind] in said
    assert "\n" not in said
    assert str(tmp_path) not in said.replace(str(path), "")
    assert list(tmp_path.iterdir()) == []
    assert not list(path.parent.rglob(EVIL))
    assert not Path(f"/tmp/{EVIL}").exists()


@pytest.mark.parametrize(("fmi", "isolated"), [("1.0", False), ("2.0", False), ("3.0", False), ("2.0", True)])
@pytest.mark.parametrize("kind", STARTED)
def test_refused_when_it_is_started(
    broken: Broken,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    kind: str,
    fmi: str,
    isolated: bool,
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with pytest.raises(InputError) as caught, fleet(broken(kind, fmi), isolated=isolated):
        pass
    assert caught.value.where == HERE
    assert caught.value.message.startswith(f"the FMU {kind}.fmu cannot be started as robot_1: {STARTED[kind]}")
    assert str(tmp_path) not in caught.value.message
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("fmi", ["1.0", "2.0", "3.0"])
@pytest.mark.parametrize("kind", WORKS)
def test_what_works_all_the_same(broken: Broken, kind: str, fmi: str) -> None:
    moved = drive(broken(kind, fmi), np.tile([10.0, 0.0], (50, 1)))
    assert moved[-1, 4] == pytest.approx(1.0)


@pytest.mark.parametrize("entry", ["./modelDescription.xml", "x/../modelDescription.xml", "binaries//../../x"])
def test_one_file_by_two_names(car: Path, tmp_path: Path, entry: str) -> None:
    said = refused(repack(car, tmp_path / "a.fmu", extra=entry))
    assert "twice" in said or "leads outside of the FMU" in said


def test_many_variables_take_no_time(tmp_path: Path) -> None:
    """Ten thousand take some tenths of a second; the limit allows for a busy machine, and for nothing quadratic."""
    path = make_fmu(tmp_path, fillers=10_000)
    begin = time.process_time()
    with fleet(path) as (started, state):
        started.step(0, 0.02, np.array([10.0, 0.0]))
    assert time.process_time() - begin < 5.0
    assert state[0, 4] == pytest.approx(0.02)


@pytest.mark.parametrize("tool", [False, True])
def test_what_an_fmu_of_fmi_1_can_do_is_read(tmp_path: Path, tool: bool) -> None:
    path = make_fmu(tmp_path, fmi="1.0", once=True)
    if tool:
        model = '<Model entryPoint="file:///x" manualStart="false" type="x"/>'
        text = description(Options(fmi="1.0", once=True, when=1.0))
        alone = text[text.index("<CoSimulation_StandAlone>") : text.index("</Implementation>")]
        of_a_tool = f"<CoSimulation_Tool><Capabilities/>{model}</CoSimulation_Tool>"
        path = repack(path, tmp_path / "tool.fmu", alone, of_a_tool)
    with closing(open_fmu(path)) as opened:
        assert opened.about_interface.canBeInstantiatedOnlyOncePerProcess == (not tool)
        assert opened.about_interface.canHandleVariableCommunicationStepSize == (not tool)
        assert opened.about_interface.needsExecutionTool == tool
