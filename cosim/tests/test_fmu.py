"""FMUs come from strangers: each kind of bad file has its sentence, and what fits is bound by role and unit."""

import zipfile
from contextlib import closing
from pathlib import Path

import pytest

import plants
from cosim.errors import InputError, Location
from cosim.fmu import Fmu, open_fmu
from cosim.parameters import geometry, understand
from cosim.scenario import BindingSource, RoleSource, Setting

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
    assert "cannot be read: No such file" in refused(tmp_path / "none.fmu")


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
    assert "has the entry '../../escaped.txt', outside of itself" in refused(path)
    assert not (tmp_path.parent / "escaped.txt").exists()


def test_document_type(car: Path, tmp_path: Path) -> None:
    path = repack(car, tmp_path / "a.fmu", "<fmiModelDescription", "<!DOCTYPE a><fmiModelDescription")
    assert "declares a document type" in refused(path)


def test_invalid_description(car: Path, tmp_path: Path) -> None:
    path = repack(car, tmp_path / "a.fmu", 'causality="output"', 'causality="sideways"')
    assert "has no valid model description" in refused(path)


def test_another_root_element(car: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", "<model/>")
    assert "it begins with <model>; expected is <fmiModelDescription fmiVersion=...>" in refused(path)


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
        ("m_c", "30", "the unit is missing; expected is a quantity such as '30 kg'"),
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
            ("a", "1.3 m", "parameter a of b.fmu: '1.3 m' contradicts the binding, which says 1.2 m"),
            ("a", "1.2", "the unit is missing"),
            ("drive", "rear_wheel", "drive of b.fmu: 'rear_wheel' contradicts the binding, which says as_printed"),
        ):
            with pytest.raises(InputError, match=sentence):
                understand(opened, [setting(name, text)])


def test_an_enumeration_is_set_by_the_role_that_it_plays(car: Path, tmp_path: Path) -> None:
    path = repack(car, tmp_path / "a.fmu", ' name="drive"', ' name="axle"')
    role = RoleSource(name="drive", variable="axle", where=HERE)
    with closing(open_fmu(path, HERE, BindingSource("car_like", (role,), HERE))) as opened:
        values = understand(opened, [setting("drive", "rear_wheel")])
        assert geometry(opened, values, HERE)["drive"] == "rear_wheel"
