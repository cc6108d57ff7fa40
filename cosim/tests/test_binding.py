"""Bindings: variables of an FMU that play roles, found by name or declared, and read in the right unit."""

import math
import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from cosim.errors import InputError, Location
from cosim.fmu import description as fmu_description
from cosim.fmu.binding import Binding, bind
from cosim.fmu.parameters import geometry
from cosim.master.robot_plants import _initial_values
from cosim.scenario.grammar import NAMESPACE
from cosim.scenario.reader import read_binding, read_scenario
from tests.stub.stub import Options, description

HERE = Location("scenario.xml", 3, 5)
DEGREE = math.pi / 180
FMI = ("1.0", "2.0", "3.0")
EXAMPLE = Path(__file__).with_name("example.xml")

Describe = Callable[..., Any]
Bound = Callable[..., Binding]


@pytest.fixture
def describe(tmp_path: Path) -> Describe:
    """Return a function that describes a stub, with replacements made in its model description."""

    def made(*replacements: tuple[str, str], **options: Any) -> Any:
        text = description(Options(**options))
        for old, new in replacements:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / "modelDescription.xml"
        path.write_text(text, encoding="utf-8")
        return fmu_description.read(tmp_path).description

    return made


@pytest.fixture
def bound(tmp_path: Path) -> Bound:
    """Return a function that binds the described FMU by a binding with these roles."""

    def made(described: Any, roles: str) -> Binding:
        return bind(described, "car.fmu", read_binding(write(tmp_path / "binding.xml", roles)), HERE)

    return made


def write(path: Path, roles: str) -> Path:
    """Write a binding whose roles begin in line 2."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f'<binding xmlns="{NAMESPACE}" vehicle="car_like">\n{roles}\n</binding>\n', encoding="utf-8")
    return path


def scales(binding: Binding) -> dict[str, float]:
    return {name: one.played_by.scale for name, one in binding.bound.items() if one.played_by is not None}


def read(binding: Binding, role: str, number: float) -> float:
    """Return the value of a role for a number of the FMU."""
    number_of = binding.bound[role].played_by
    assert number_of is not None
    return number_of.scale * number + number_of.offset


# By name ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fmi", FMI)
def test_variables_with_the_names_of_the_roles_play_them(describe: Describe, fmi: str) -> None:
    binding = bind(describe(fmi=fmi), "car.fmu")
    assert binding.kind.name == "car_like"
    names = ("x", "y", "psi", "gamma", "v", "omega", "tau_drive", "tau_steer", "a", "drive")
    assert binding.described() == {name: name for name in names}
    assert set(scales(binding).values()) == {1.0}
    assert all(binding.bound[name].initial == binding.bound[name].played_by for name in ("x", "y", "psi", "gamma"))


@pytest.mark.parametrize("fmi", FMI)
def test_optional_roles_may_be_missing(describe: Describe, fmi: str) -> None:
    binding = bind(describe(fmi=fmi, velocities=False), "car.fmu")
    assert not {"v", "omega", "tau_d_x"} & set(binding.bound)
    assert binding.of(binding.kind.velocity) == (None, None)


def test_an_optional_role_that_another_variable_has_the_name_of_is_missing(describe: Describe) -> None:
    described = describe(('name="v" valueReference="4" causality="output"', 'name="v" valueReference="4"'))
    assert "v" not in bind(described, "car.fmu").bound


def test_what_is_missing_is_named_for_every_kind_of_vehicle(describe: Describe) -> None:
    with pytest.raises(InputError) as caught:
        bind(describe(names={"tau_steer": "steering", "a": "L"}, drive=False), "car.fmu", None, HERE)
    message = str(caught.value)
    assert message.startswith(
        "scenario.xml:3:5: the FMU car.fmu is no vehicle that can be driven as it is: as a car_like vehicle it lacks "
        "the input 'tau_steer' [N.m]; it lacks the parameter 'a' [m]; it lacks the parameter 'drive'. as a tractor"
    )
    assert message.endswith('A <binding> assigns variables to these roles; "formation swap" writes one to complete')


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (
            {"initial": "parameters"},
            "has no start value of 'x' that can be set; if a parameter gives the initial value",
        ),
        ({"units": "none"}, "has 'x' without a unit: a binding states it"),
        ({"fmi": "1.0", "units": "names"}, 'it does not define: a binding states the unit, unit="m"'),
        (
            {"replace": ('causality="output"', 'causality="local"')},
            "has 'x' as local, not as output; it has 'y'",
        ),
        ({"replace": ('name="x"', 'name="y"')}, "has more than one variable 'y'"),
    ],
)
def test_what_does_not_fit_by_name(describe: Describe, options: dict[str, Any], sentence: str) -> None:
    replacements = [options.pop("replace")] if "replace" in options else []
    with pytest.raises(InputError, match=re.escape(sentence)):
        bind(describe(*replacements, **options), "car.fmu", None, HERE)


# Units ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fmi", FMI)
def test_units_are_those_of_the_fmu(describe: Describe, fmi: str) -> None:
    found = scales(bind(describe(fmi=fmi, units="deg"), "car.fmu"))
    assert found["psi"] == found["gamma"] == found["omega"] == pytest.approx(DEGREE, rel=1e-15)
    assert found["v"] == pytest.approx(1 / 3.6, rel=1e-15)
    assert found["x"] == found["tau_drive"] == found["a"] == 1.0


@pytest.mark.parametrize("fmi", FMI[1:])
def test_the_definition_of_a_unit_counts_whatever_its_name(describe: Describe, fmi: str) -> None:
    assert set(scales(bind(describe(fmi=fmi, units="names"), "car.fmu")).values()) == {1.0}
    metre = '<Unit name="metre"><BaseUnit m="1"/>'
    described = describe((metre, metre.replace("/>", ' factor="0.3048"/>')), fmi=fmi, units="names")
    assert scales(bind(described, "car.fmu"))["x"] == 0.3048


def test_the_unit_may_be_that_of_the_type(describe: Describe) -> None:
    described = describe(
        ("  <TypeDefinitions>\n", '  <TypeDefinitions>\n<SimpleType name="Angle"><Real unit="deg"/></SimpleType>\n'),
        ('unit="deg" start="0"/></ScalarVariable>', 'declaredType="Angle" start="0"/></ScalarVariable>'),
        units="deg",
    )
    assert scales(bind(described, "car.fmu"))["psi"] == pytest.approx(DEGREE, rel=1e-15)


@pytest.mark.parametrize("fmi", FMI[1:])
def test_units_that_are_not_defined_are_known_by_name(describe: Describe, fmi: str) -> None:
    defined = re.search(
        r" *<UnitDefinitions>.*</UnitDefinitions>\n", description(Options(fmi=fmi, units="deg")), re.DOTALL
    )
    assert defined is not None
    assert scales(bind(describe((defined[0], ""), fmi=fmi, units="deg"), "car.fmu"))["v"] == pytest.approx(1 / 3.6)


def test_angles_may_be_defined_as_numbers(describe: Describe) -> None:
    described = describe((' rad="1"', ""), units="deg")
    assert scales(bind(described, "car.fmu"))["psi"] == pytest.approx(DEGREE, rel=1e-15)


def test_an_angle_that_nobody_can_know_of_is_stated(describe: Describe, bound: Bound) -> None:
    described = describe((' rad="1"', ""), units="names")
    with pytest.raises(InputError, match="offers a unit that does not fit: 'psi' is in 1, not in rad"):
        bind(described, "car.fmu", None, HERE)
    roles = "".join(f'<role name="{name}" variable="{name}" unit="rad"/>' for name in ("psi", "gamma"))
    binding = bound(described, roles + '<role name="omega" variable="omega" unit="rad/s"/>')
    assert set(scales(binding).values()) == {1.0}


STATED = "".join(
    f'<role name="{role}" variable="{role}" unit="{unit}"/>'
    for role, unit in {
        "x": "m", "y": "dm", "psi": "deg", "gamma": "mrad", "v": "km/h", "omega": "deg/s", "tau_drive": "kN.m",
        "tau_steer": "N.m", "a": "mm",
    }.items()
)  # fmt: skip


@pytest.mark.parametrize("fmi", FMI)
def test_a_unit_is_stated_where_there_is_none(describe: Describe, bound: Bound, fmi: str) -> None:
    found = scales(bound(describe(fmi=fmi, units="none"), STATED))
    assert found == pytest.approx(
        {
            "x": 1.0,
            "y": 0.1,
            "psi": DEGREE,
            "gamma": 1e-3,
            "v": 1 / 3.6,
            "omega": DEGREE,
            "tau_drive": 1e3,
            "tau_steer": 1.0,
        }
        | {"a": 1e-3, "drive": 1.0}
    )


def test_a_unit_that_is_there_may_be_stated_again(describe: Describe, bound: Bound) -> None:
    roles = '<role name="psi" variable="psi" unit="rad"/><role name="tau_drive" variable="tau_drive" unit="kg.m2/s2"/>'
    assert set(scales(bound(describe(units="names"), roles)).values()) == {1.0}


@pytest.mark.parametrize("factor", ["0.0174533", "0.01745329", "0.01745", "0.017453292519943295"])
@pytest.mark.parametrize("roles", ["", '<role name="psi" variable="psi" unit="deg"/>'])
@pytest.mark.parametrize("fmi", FMI[1:])
def test_a_factor_may_be_rounded(describe: Describe, bound: Bound, fmi: str, roles: str, factor: str) -> None:
    degree = f'rad="1" factor="{DEGREE!r}"'
    described = describe((degree, degree.replace(repr(DEGREE), factor)), fmi=fmi, units="deg")
    assert scales(bound(described, roles))["psi"] == DEGREE, "that of the name, which is exact"


def test_a_rounded_factor_of_a_unit_with_a_name_of_its_own_is_the_stated_one(describe: Describe, bound: Bound) -> None:
    radian = '<Unit name="radian"><BaseUnit rad="1"/>'
    described = describe((radian, radian.replace("/>", ' factor="0.0174533"/>')), units="names")
    roles = '<role name="psi" variable="psi" unit="deg"/>'
    assert scales(bound(described, roles))["psi"] == DEGREE
    assert scales(bind(described, "car.fmu"))["psi"] == 0.0174533


DEGREES = f'<Unit name="deg"><BaseUnit rad="1" factor="{DEGREE!r}"/>'
SPEED = f'<Unit name="km/h"><BaseUnit m="1" s="-1" factor="{1 / 3.6!r}"/>'


@pytest.mark.parametrize(
    ("definition", "another", "variable", "told"),
    [
        (DEGREES, 'rad="1"', "psi", '1 deg is 0.0174533 rad, by the definition 1 rad. A binding decides: unit="deg" or '
         'unit="rad"'),
        (DEGREES, "", "psi", 'by the definition 1 rad. A binding decides: unit="deg" or unit="rad"'),
        (DEGREES, 'rad="1" factor="0.0157"', "psi", 'unit="deg" or unit="rad" factor="0.0157"'),
        (SPEED, 'm="1" s="-1"', "v", 'unit="km/h" or unit="m/s"'),
    ],
)  # fmt: skip
def test_a_unit_that_contradicts_its_name_is_told_and_the_binding_decides(
    describe: Describe, bound: Bound, definition: str, another: str, variable: str, told: str
) -> None:
    """Also of an optional role such as v: it would be dropped without a word."""
    before = definition.split("<BaseUnit ")[1].removesuffix("/>")
    described = describe((definition, definition.replace(before, another)), units="deg")
    with pytest.raises(InputError, match=re.escape(told)) as caught:
        bind(described, "car.fmu", None, HERE)
    assert f"has {variable!r} in" in str(caught.value)
    names = ("psi", "gamma") if variable == "psi" else ("v",)
    for unit, scale in (("deg", DEGREE), ("rad", 1.0)) if variable == "psi" else (("km/h", 1 / 3.6), ("m/s", 1.0)):
        roles = "".join(f'<role name="{name}" variable="{name}" unit="{unit}"/>' for name in names)
        found = scales(bound(described, roles))
        assert [found[name] for name in names] == pytest.approx([scale] * len(names), rel=1e-15)
    wrong = "".join(f'<role name="{name}" variable="{name}" unit="kg"/>' for name in names)
    with pytest.raises(InputError, match="offers a unit that does not fit"):
        bound(described, wrong)


@pytest.mark.parametrize("base", ['rad="1" factor="{}"', 'factor="{}"'])  # some tools take radians for pure numbers
def test_a_unit_with_an_offset_wants_a_binding_with_one(describe: Describe, bound: Bound, base: str) -> None:
    """Such as a compass counts: without it, the offset would be lost."""
    compass = f'<Unit name="deg"><BaseUnit {base.format(DEGREE)} offset="1.5"/>'
    described = describe((DEGREES, compass), units="deg")
    told = 'in deg, with an offset of 1.5 rad: a binding states both, unit="deg" offset="1.5 rad"'
    roles = '<role name="{0}" variable="{0}" unit="deg"/>'
    with pytest.raises(InputError, match=re.escape(f"has 'psi' {told}")):
        bind(described, "car.fmu", None, HERE)
    with pytest.raises(InputError, match=re.escape(f"has 'psi' {told}")):
        bound(described, "".join(map(roles.format, ("psi", "gamma"))))
    proposed = "".join(map(roles.format, ("psi", "gamma"))).replace('unit="deg"', 'unit="deg" offset="1.5 rad"')
    assert read(bound(described, proposed), "psi", 90.0) == pytest.approx(math.pi / 2 + 1.5)


def test_a_unit_may_have_a_name_that_others_use_for_something_else(describe: Describe) -> None:
    """Here "C", which is a coulomb elsewhere, is the name of an angle."""
    described = describe(('"deg"', '"C"'), (DEGREES.replace('"deg"', '"C"'), '<Unit name="C"><BaseUnit rad="1"/>'),
                         units="deg")  # fmt: skip
    assert scales(bind(described, "car.fmu"))["psi"] == 1.0


# Declared ---------------------------------------------------------------------------------------------------


def test_roles_that_are_declared_and_roles_that_are_not(describe: Describe, bound: Bound) -> None:
    described = describe(names={"x": "chassis.r[1]", "tau_drive": "drive torque", "v": "speed"})
    roles = '<role name="x" variable="chassis.r[1]"/><role name="tau_drive" variable="drive torque"/>'
    binding = bound(described, roles)
    assert binding.described()["x"] == "chassis.r[1]", "a name, if a variable has it, and no element"
    assert binding.described()["tau_drive"] == "drive torque"
    assert binding.described()["y"] == "y"
    assert "v" not in binding.bound


def test_sign_and_offset(describe: Describe, bound: Bound) -> None:
    binding = bound(describe(units="deg"), '<role name="psi" variable="psi" factor="-1" offset="90 deg"/>')
    assert read(binding, "psi", 90.0) == pytest.approx(0.0, abs=1e-15)
    assert read(binding, "psi", 0.0) == pytest.approx(math.pi / 2)
    assert binding.described()["psi"] == "-0.0174533 * psi +1.5708 rad"


def test_a_factor_with_a_unit_makes_another_quantity(describe: Describe, bound: Bound) -> None:
    described = describe(
        ('name="tau_drive" valueReference="12" causality="input" variability="continuous"><Real unit="N.m"',
         'name="tau_drive" valueReference="12" causality="input" variability="continuous"><Real unit="kN"'),
    )  # fmt: skip
    binding = bound(described, '<role name="tau_drive" variable="tau_drive" factor="50 cm"/>')
    assert read(binding, "tau_drive", 2.0) == pytest.approx(1000.0), "2 kN on a lever of 0.5 m"


@pytest.mark.parametrize("fmi", FMI)
def test_initial_values_through_parameters(describe: Describe, bound: Bound, fmi: str) -> None:
    described = describe(fmi=fmi, units="deg", initial="parameters")
    roles = "".join(f'<role name="{name}" variable="{name}" initial="{name}0"/>' for name in ("x", "y", "gamma"))
    roles += '<role name="psi" variable="psi" initial="psi0" factor="-1" offset="0.5 rad"/>'
    binding = bound(described, roles)
    assert binding.described()["gamma"] == "0.0174533 * gamma, started by gamma0"
    assert initial_values(described, binding) == {
        "x0": (1.0,), "y0": (2.0,), "psi0": (pytest.approx(-0.5 / DEGREE),), "gamma0": (pytest.approx(0.1 / DEGREE),),
    }  # fmt: skip


def initial_values(described: Any, binding: Binding) -> dict[str, tuple[float, ...]]:
    """Return the start values for the pose (1 m, 2 m, 1 rad, 0.1 rad), by variable."""

    fmu: Any = SimpleNamespace(binding=binding, description=described)
    return {value.name: value.values for value in _initial_values(fmu, (1.0, 2.0, 1.0, 0.1))}  # type: ignore[misc]


def test_constants_for_the_geometry(describe: Describe, bound: Bound) -> None:
    described = describe(names={"a": "L"}, drive=False)
    roles = '<role name="a" value="1500 mm"/><role name="drive" value="rear_wheel"/>'
    binding = bound(described, roles)
    assert (binding.bound["a"].constant, binding.bound["drive"].constant) == (1.5, "rear_wheel")
    assert binding.described()["a"] == "1.5 m"
    assert binding.described()["drive"] == "rear_wheel"
    fmu: Any = SimpleNamespace(binding=binding, description=described)
    assert geometry(fmu, (), HERE) == {"wheelbase": 1.5, "drive": "rear_wheel"}


# Elements of arrays -----------------------------------------------------------------------------------------

ARRAYS = {"x": "pose[1]", "y": "pose[2]", "psi": "pose[3]", "gamma": "pose[4]"}
TORQUES = '<role name="tau_drive" variable="torque[1]"/><role name="tau_steer" variable="torque[2]" factor="-1"/>'
POSE_UNITS = {"x": "m", "y": "m", "psi": "rad", "gamma": "rad"}


def roles_of(elements: dict[str, str], more: str = TORQUES) -> str:
    return more + "".join(
        f'<role name="{role}" variable="{variable}" unit="{POSE_UNITS[role]}"/>' for role, variable in elements.items()
    )


def test_elements_of_arrays_are_counted_from_one(describe: Describe, bound: Bound) -> None:
    described = describe(fmi="3.0", arrays=True)
    binding = bound(described, roles_of(ARRAYS))
    assert {role: one.played_by.element for role, one in binding.bound.items() if one.played_by and role in ARRAYS} == {
        "x": 0, "y": 1, "psi": 2, "gamma": 3,
    }  # fmt: skip
    assert binding.described()["tau_steer"] == "-1 * torque[2]"
    assert initial_values(described, binding) == {"pose": (1.0, 2.0, 1.0, 0.1)}, "an array is set as a whole"


def test_two_dimensions_are_in_row_major_order(describe: Describe, bound: Bound) -> None:
    square = ('<Dimension start="4"/>', '<Dimension start="2"/><Dimension start="2"/>')
    described = describe(square, fmi="3.0", arrays=True)
    elements = {"x": "pose[1,1]", "y": "pose[2,1]", "psi": "pose[1, 2]", "gamma": "pose[2,2]"}
    binding = bound(described, roles_of(elements))
    assert {role: one.played_by.element for role, one in binding.bound.items() if one.played_by and role in ARRAYS} == {
        "x": 0, "y": 2, "psi": 1, "gamma": 3,
    }  # fmt: skip
    assert binding.described()["y"] == "pose[2,1]"
    assert initial_values(described, binding) == {"pose": (1.0, 1.0, 2.0, 0.1)}


def test_a_dimension_may_be_a_structural_parameter(describe: Describe, bound: Bound) -> None:
    structural = '<UInt64 name="n" valueReference="99" causality="structuralParameter" variability="fixed" start="4"/>'
    described = describe(
        ('<Dimension start="4"/>', '<Dimension valueReference="99"/>'),
        ("  <ModelVariables>\n", f"  <ModelVariables>\n{structural}\n"),
        fmi="3.0",
        arrays=True,
    )
    assert bound(described, roles_of(ARRAYS)).bound["gamma"].played_by.element == 3  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("variable", "sentence"),
    [
        ("pose", "has 'pose' as an array: name one of its elements, such as 'pose[1]'"),
        ("pose[0]", "has 'pose' with the dimensions (4,), so that there is no 'pose[0]'; the first index is 1"),
        ("pose[5]", "so that there is no 'pose[5]'"),
        ("pose[1,1]", "so that there is no 'pose[1,1]'"),
        ("pose[1234567890]", "has no variable 'pose[1234567890]'"),
        ("v[1]", "has 'v' as a scalar, so there is no 'v[1]'"),
        ("poses[1]", "has no variable 'poses[1]': did you mean 'pose'?"),
    ],
)
def test_elements_that_are_not_there(describe: Describe, bound: Bound, variable: str, sentence: str) -> None:
    with pytest.raises(InputError, match=re.escape(sentence)):
        bound(describe(fmi="3.0", arrays=True), roles_of(ARRAYS | {"x": variable}))


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('<Dimension start="4"/>', '<Dimension start="2000000"/>', "has 'pose' with an unknown dimension"),
        (
            '<Dimension start="4"/>',
            '<Dimension start="100000"/><Dimension start="100000"/>',
            "has 'pose' with 10000000000 elements; at most are 1000000",
        ),
        ('start="0 0 0 0"', 'start="0 0 0"', "has 3 start values of 'pose', which has 4 elements"),
        ('start="0 0 0 0"', 'start="0 0 0 up"', "has the start value '0 0 0 up' of 'pose', which is no number"),
    ],
)
def test_arrays_that_cannot_be_exchanged(describe: Describe, bound: Bound, old: str, new: str, sentence: str) -> None:
    with pytest.raises(InputError, match=re.escape(sentence)):
        bound(describe((old, new), fmi="3.0", arrays=True), roles_of(ARRAYS))


def test_one_start_value_may_be_that_of_all_elements(describe: Describe, bound: Bound) -> None:
    described = describe(('start="0 0 0 0"', 'start="7"'), fmi="3.0", arrays=True)
    elements = {role: variable for role, variable in ARRAYS.items() if role != "gamma"}
    binding = bound(
        described, roles_of(elements, TORQUES + '<role name="gamma" variable="omega" unit="rad/s" factor="1 s"/>')
    )
    assert initial_values(described, binding)["pose"] == (1.0, 2.0, 1.0, 7.0)


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
@pytest.mark.parametrize(("initial", "known"), [("exact", True), ("approx", False)])
def test_a_length_that_the_fmu_computes_is_not_known(
    describe: Describe, bound: Bound, fmi: str, initial: str, known: bool
) -> None:
    """Its start value is but a guess."""
    before = 'name="a" valueReference="14" causality="parameter" variability="tunable" initial="exact"'
    described = describe((before, before.replace("parameter", "local").replace("exact", initial)), fmi=fmi)
    role = '<role name="a" variable="a"/>'
    if known:
        fmu: Any = SimpleNamespace(binding=bound(described, role), description=described)
        assert geometry(fmu, (), HERE)["wheelbase"] == 1.2
    else:
        with pytest.raises(InputError, match="computes the value of 'a' itself, so that it is not known before"):
            bound(described, role)


# What is refused --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("roles", "sentence"),
    [
        ('<role name="speed" variable="v"/>', "a car_like vehicle has no role 'speed': "),
        ('<role name="tau_dive" variable="v"/>', "vehicle has no role 'tau_dive': did you mean 'tau_drive'?"),
        ('<role name="x" variable="X"/>', "the FMU car.fmu has no variable 'X': "),
        ('<role name="x" variable="omga"/>', "has no variable 'omga': did you mean 'omega'?"),
        ('<role name="x" variable="tau_drive"/>', "has 'tau_drive' as input, which cannot play the output 'x'"),
        ('<role name="tau_drive" variable="x"/>', "has 'x' as output, which cannot play the input 'tau_drive'"),
        ('<role name="a" variable="x"/>', "has 'x' as output, which cannot play the parameter 'a'"),
        ('<role name="x" variable="events"/>', "has 'events' without a unit: a binding states it"),
        ('<role name="a" variable="drive"/>', "has 'drive' as Enumeration, not as Real"),
        ('<role name="drive" variable="a"/>', "has 'a' as Real, not as Enumeration"),
        ('<role name="drive" variable="drive" unit="m"/>', "which takes no unit, factor or offset"),
        ('<role name="x" variable="psi"/>', "offers a unit that does not fit: 'psi' is in rad, not in m"),
        ('<role name="x" variable="y" unit="mm"/>', "has 'y' in m, not in mm as the binding states"),
        ('<role name="x" variable="y" unit="furlong"/>', ":2:1: unit=\"furlong\" of the role 'x': "),
        ('<role name="x" variable="y" factor="2 s"/>', "'y' is in m times 2 s, not in m"),
        ('<role name="x" variable="y" factor="0"/>', "factor=\"0\" of the role 'x': it must be finite and not zero"),
        ('<role name="x" variable="y" factor="1e999"/>', "it must be finite and not zero"),
        ('<role name="x" variable="y" factor="twice"/>', "of the role 'x': 'twice' is not a number with a unit"),
        ('<role name="x" variable="y" offset="1 rad"/>', "offset=\"1 rad\" of the role 'x': '1 rad': rad does not fit"),
        ('<role name="x" variable="y" offset="1"/>', "'1': the unit is missing"),
        ('<role name="x" variable="y" unit="m" offset="1"/>', "the unit is missing: write '1 m'"),
        ('<role name="x" variable="y" initial="z0"/>', "has no variable 'z0'"),
        ('<role name="x" variable="y" initial="v"/>', "has 'v' as output, which cannot give the initial value of 'x'"),
        ('<role name="x" variable="y" initial="when"/>', "offers a unit that does not fit: 'when' is in s, not in m"),
        ('<role name="v" variable="v" initial="a"/>', "initial=\"a\" of the role 'v': only a pose entry has"),
        ('<role name="x" value="1 m"/>', "value=\"1 m\" of the role 'x': only a parameter has a constant value, and"),
        ('<role name="a" value="1 s"/>', "value=\"1 s\" of the role 'a': '1 s': s does not fit"),
        ('<role name="a" value="-1 m"/>', "value=\"-1 m\" of the role 'a': '-1 m' is no length"),
        ('<role name="drive" value="asprinted"/>', "value=\"asprinted\" of the role 'drive': 'asprinted' is none of "),
        ('<role name="x" variable="x" initial="a"/>', "cannot be given 'x' and 'a' through the same number, 'a'"),
        ('<role name="a" value="long"/>', "'long' is not a number with a unit"),
        ('<role name="tau_steer" variable="tau_drive"/>', "'tau_drive' and 'tau_steer' through the same number"),
        ('<role name="y" variable="x"/>', "cannot be given 'x' and 'y' through the same number, 'x'"),
        ('<role name="y" variable="y" initial="a"/><role name="x" variable="x" initial="a"/>', "the same number, 'a'"),
        # What the reader finds.
        ('<role name="x" variable="x"/>\n<role name="x" variable="y"/>', "the role 'x' is given twice"),
        ('<role name="a" variable="a" value="1 m"/>', "a <role> needs either a variable or a value"),
        ('<role name="x"/>', "a <role> needs either a variable or a value"),
        ('<role name="a" value="1 m" unit="m"/>', "a <role> with a value takes no other attribute but its name"),
        ('<role name="a" value="1 m" sign="-1"/>', "has no attribute 'sign'"),
        ('<role variable="a"/>', "name"),
        ('<rule name="a" variable="a"/>', "<rule>"),
    ],
)  # fmt: skip
def test_refusals(describe: Describe, bound: Bound, tmp_path: Path, roles: str, sentence: str) -> None:
    """Each with the place of the role, which is in line 2, or in line 3 if there are two lines."""
    with pytest.raises(InputError) as caught:
        bound(describe(end_stop=0.5), roles)
    assert sentence in str(caught.value)
    where = caught.value.where
    assert where is not None
    assert (where.file, where.line) == (str(tmp_path / "binding.xml"), 2 + roles.count("\n"))
    assert where.column >= 1


def test_all_problems_are_told(describe: Describe, bound: Bound, tmp_path: Path) -> None:
    roles = '<role name="y" variable="Y"/>\n<role name="psi" variable="tau_drive"/>'
    with pytest.raises(InputError) as caught:
        bound(describe(names={"x": "px"}), roles)
    file = tmp_path / "binding.xml"
    first, second, third = str(caught.value).splitlines()
    assert first == f"{file}:1:1: the FMU car.fmu lacks the output 'x' [m]"
    assert second.startswith(f"  {file}:2:1: the FMU car.fmu has no variable 'Y': known: ")
    assert third == f"  {file}:3:1: the FMU car.fmu has 'tau_drive' as input, which cannot play the output 'psi'"


def test_a_role_that_is_not_mentioned_is_refused_at_the_binding(
    describe: Describe, bound: Bound, tmp_path: Path
) -> None:
    with pytest.raises(InputError) as caught:
        bound(describe(names={"x": "px"}), '<role name="y" variable="y"/>')
    assert str(caught.value) == f"{tmp_path / 'binding.xml'}:1:1: the FMU car.fmu lacks the output 'x' [m]"


def test_of_many_variables_only_some_are_shown(describe: Describe, bound: Bound) -> None:
    with pytest.raises(InputError, match=r"has no variable 'filler_77777': did you mean 'filler_7777'\?") as caught:
        bound(describe(fillers=10_000), '<role name="x" variable="filler_77777"/>')
    assert "and 9971 more" in str(caught.value)
    assert len(str(caught.value)) < 2000


# Files with bindings ----------------------------------------------------------------------------------------

ROLE = '<role name="x" variable="px"/>'


def with_plant(path: Path, attributes: str, inner: str = "") -> Path:
    """Write a scenario with another plant."""
    text = EXAMPLE.read_text(encoding="utf-8")
    plant = re.search(r"<plant id=\"(\w+)\".*?</plant>", text, re.DOTALL)
    assert plant is not None
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(
        text.replace(plant[0], f'<plant id="{plant[1]}" fmu="car.fmu" {attributes}>{inner}</plant>'), "utf-8"
    )
    return path


def variables_of(path: Path) -> list[str]:
    [plant] = read_scenario(path).plants.values()
    assert plant.binding is not None
    return [role.variable for role in plant.binding.roles]


def test_a_binding_is_in_the_scenario_or_in_a_file_of_its_own(tmp_path: Path) -> None:
    write(tmp_path / "bindings" / "car.xml", ROLE)
    inside = f'<binding vehicle="car_like">{ROLE}</binding>'
    assert variables_of(with_plant(tmp_path / "a.xml", "", inside)) == ["px"]
    path = with_plant(tmp_path / "b.xml", 'binding="bindings/car.xml"')
    assert variables_of(path) == ["px"]
    [plant] = read_scenario(path).plants.values()
    assert plant.binding is not None
    assert str(plant.binding.roles[0].where) == f"{tmp_path / 'bindings' / 'car.xml'}:2:1"


def test_paths_are_relative_to_the_file_that_names_them(tmp_path: Path) -> None:
    """Base and variant in folders of their own: each names a binding beside it."""
    write(tmp_path / "base" / "car.xml", '<role name="x" variable="of_the_base"/>')
    write(tmp_path / "variants" / "car.xml", '<role name="x" variable="of_the_variant"/>')
    with_plant(tmp_path / "base" / "scenario.xml", 'binding="car.xml"')
    variant = tmp_path / "variants" / "v.xml"
    head = f'<variant xmlns="{NAMESPACE}" name="v" of="../base/scenario.xml"><title>V</title>'
    variant.write_text(f"{head}</variant>", encoding="utf-8")
    assert variables_of(variant) == ["of_the_base"]
    [plant] = read_scenario(variant).plants.values()
    assert plant.fmu is not None
    assert plant.fmu.resolve() == tmp_path / "base" / "car.fmu"
    variant.write_text(f'{head}<set select="plant/@binding" value="car.xml"/></variant>', encoding="utf-8")
    assert variables_of(variant) == ["of_the_variant"]


def test_a_binding_twice(tmp_path: Path) -> None:
    write(tmp_path / "car.xml", ROLE)
    path = with_plant(tmp_path / "a.xml", 'binding="car.xml"', f'<binding vehicle="car_like">{ROLE}</binding>')
    with pytest.raises(InputError, match=r'the <plant> has binding="\.\.\." and a <binding>: remove'):
        read_scenario(path)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (None, 'binding="car.xml" of <plant>: '),
        ("", "car.xml:1:1: "),
        ("no XML", "car.xml:1:1: "),
        (f'<binding xmlns="{NAMESPACE}" vehicle="car_like">\n<role name="x"', "car.xml:2:"),
        (f'<binding xmlns="{NAMESPACE}" vehicle="boat"/>', "car.xml:1:1: "),
        (f'<binding xmlns="{NAMESPACE}"/>', "car.xml:1:1: "),
        ('<binding vehicle="car_like"/>', "car.xml:1:1: the root element is binding; expected <binding xmlns="),
        (f'<scenario xmlns="{NAMESPACE}" name="x"/>', "car.xml:1:1: this is a scenario: "),
        (f'<!DOCTYPE a []>\n<binding xmlns="{NAMESPACE}" vehicle="car_like"/>', "car.xml:1:13: "),
        (f'<binding xmlns="{NAMESPACE}" vehicle="car_like">\n\n<role name="x" name="y"/></binding>', "car.xml:3:"),
        (f'<binding xmlns="{NAMESPACE}" vehicle="car_like">\n  <x xmlns="urn:x"/></binding>', "car.xml:2:3: the"),
    ],
)  # fmt: skip
def test_broken_files(tmp_path: Path, text: str | None, sentence: str) -> None:
    if text is not None:
        (tmp_path / "car.xml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_scenario(with_plant(tmp_path / "a.xml", 'binding="car.xml"'))
    assert sentence in str(caught.value)
    assert ("a.xml:" in str(caught.value)) == (text is None), "the place is in the file that is wrong"
