"""Obvious roles are proposed; the others stay open, and the binding is refused until they are filled in."""

from itertools import product
from pathlib import Path
from typing import Any

import pytest
from lxml import etree

from cosim.errors import InputError
from cosim.fmu.binding import bind
from cosim.fmu.description import read
from cosim.fmu.units import unit_of
from cosim.scenario.reader import read_binding
from cosim.scenario.scenario import OPEN
from cosim.swap import candidates, proposal
from cosim.swap.naming import parts_of
from cosim.swap.proposal import Proposal, Suggestion, binding_xml, proposals, propose
from cosim.vehicle.car_like import CAR_LIKE
from cosim.vehicle.differential_drive import DIFFERENTIAL_DRIVE
from cosim.vehicle.tractor_trailer import TRACTOR_TRAILER

UNITS = """<UnitDefinitions>
  <Unit name="m"><BaseUnit m="1"/></Unit> <Unit name="mm"><BaseUnit m="1" factor="0.001"/></Unit>
  <Unit name="rad"><BaseUnit rad="1"/></Unit> <Unit name="deg"><BaseUnit rad="1" factor="0.017453292519943295"/></Unit>
  <Unit name="m/s"><BaseUnit m="1" s="-1"/></Unit> <Unit name="rad/s"><BaseUnit rad="1" s="-1"/></Unit>
  <Unit name="N.m"><BaseUnit kg="1" m="2" s="-2"/></Unit> <Unit name="N"><BaseUnit kg="1" m="1" s="-2"/></Unit>
  <Unit name="1"><BaseUnit/></Unit> <Unit name="plain_rad"><BaseUnit/></Unit>
</UnitDefinitions>"""
CAR = {
    "pos_x": "output m",
    "pos_y": "output m",
    "heading": "output deg",
    "steer": "output deg",
    "drive_torque": "input N.m",
    "steer_torque": "input N.m",
    "L": "parameter mm",
}


def describe(folder: Path, variables: dict[str, str], units: str = UNITS, texts: dict[str, str] | None = None) -> Any:
    """Return the description of an FMU of FMI 3.0: variables by name, each as "causality unit [size] [calculated]"."""
    lines = []
    for reference, (name, said) in enumerate(variables.items(), 1):
        causality, unit, *rest = said.split()
        size = next((word for word in rest if word.isdecimal()), "")
        calculated = "calculated" in rest
        start = "" if calculated or causality == "local" else f'start="{" ".join(["0"] * int(size or 1))}"'
        initial = {"output": 'initial="calculated"' if calculated else 'initial="exact"'}.get(causality, "")
        measure = "" if unit == "-" else f'unit="{unit}"'
        text = (texts or {}).get(name, "")
        dimension = f'<Dimension start="{size}"/>' if size else ""
        variability = "fixed" if causality == "parameter" else "continuous"
        lines.append(
            f'<Float64 name="{name}" valueReference="{reference}" causality="{causality}" variability="{variability}" '
            f'description="{text}" {initial} {measure} {start}>{dimension}</Float64>'
        )
    path = folder / "modelDescription.xml"
    path.write_text(
        f"""<fmiModelDescription fmiVersion="3.0" modelName="m" instantiationToken="t">
        <CoSimulation modelIdentifier="m"/>{units}
        <ModelVariables>{"".join(lines)}
        <Enumeration name="drive" valueReference="900" causality="parameter" variability="fixed" start="1"/>
        <Float64 name="time" valueReference="901" causality="independent" variability="continuous"/>
        </ModelVariables><ModelStructure/></fmiModelDescription>""",
        encoding="utf-8",
    )
    return read(folder).description


@pytest.fixture
def car(tmp_path: Path):
    """Return a function that proposes for a car with some variables in place of those of `CAR`; None takes one away."""

    def make(changed: dict[str, str | None] | None = None, **more: Any) -> Proposal:
        variables = {name: said for name, said in (CAR | (changed or {})).items() if said is not None}
        return propose(describe(tmp_path, variables, **more), CAR_LIKE)

    return make


def of(proposal: Proposal, role: str) -> Suggestion:
    return next(suggestion for suggestion in proposal.suggestions if suggestion.role.name == role)


def variable(proposal: Proposal, role: str) -> str:
    source = of(proposal, role).source
    assert source is not None
    return source.variable


def test_obvious_names(car: Any) -> None:
    proposal = car({"speed": "output m/s", "steer_rate": "output rad/s"})
    assert not proposal.open
    assert not proposal.needs_no_binding
    assert {s.role.name: s.source.variable for s in proposal.suggestions if s.source} == {
        "x": "pos_x",
        "y": "pos_y",
        "psi": "heading",
        "gamma": "steer",
        "v": "speed",
        "omega": "steer_rate",
        "tau_drive": "drive_torque",
        "tau_steer": "steer_torque",
        "a": "L",
        "drive": "drive",
    }


def test_what_is_proposed_binds(car: Any, tmp_path: Path) -> None:
    proposal = car()
    file = tmp_path / "b.xml"
    file.write_text(binding_xml(proposal, "m.fmu"), encoding="utf-8")
    description = describe(tmp_path, CAR)
    binding = bind(description, "m.fmu", read_binding(file))
    assert binding == bind(description, "m.fmu", proposal.binding)
    assert binding.described()["psi"] == "0.0174533 * heading"
    assert binding.described()["a"] == "0.001 * L"


def test_the_name_of_the_role_goes_before_all_others(car: Any) -> None:
    proposal = car({"x": "output m", "vehicle.x": "output m"})
    assert variable(proposal, "x") == "x"
    assert of(proposal, "x").needs_no_binding
    assert "name='x'" not in binding_xml(proposal, "m.fmu")


def test_two_that_are_equally_good_are_not_obvious(car: Any) -> None:
    proposal = car({"yaw": "output deg"})
    assert variable(proposal, "psi") == OPEN
    assert of(proposal, "psi").open == ("could be played by 'heading', 'yaw'",)
    assert of(proposal, "psi").candidates == ("heading", "yaw")
    assert not proposal.missing


def test_an_output_goes_before_a_local_variable(car: Any) -> None:
    assert variable(car({"yaw": "local deg"}), "psi") == "heading"


def test_a_local_variable_will_do(car: Any) -> None:
    assert variable(car({"heading": None, "yaw": "local deg", "yaw0": "parameter deg"}), "psi") == "yaw"


def test_the_unit_tells_one_from_another(car: Any) -> None:
    assert variable(car({"yaw": "output rad/s"}), "psi") == "heading"


def test_what_measures_something_else_is_told(car: Any) -> None:
    proposal = car({"drive_torque": "input N"})
    assert variable(proposal, "tau_drive") == OPEN
    assert of(proposal, "tau_drive").open[0] == "needs a unit that fits N.m: 'drive_torque' is in N"


def test_what_is_missing_is_left_open_with_what_could_be(car: Any) -> None:
    proposal = car({"steer": None, "bend": "output rad"})
    assert variable(proposal, "gamma") == OPEN
    (sentence,) = of(proposal, "gamma").open
    assert sentence == (
        "no output is obviously the steering angle, counter-clockwise from the body; outputs that could be: "
        "'heading', 'bend'"
    )


def test_a_unit_that_is_not_stated_is_not_guessed(car: Any) -> None:
    proposal = car({"heading": "output -"}, texts={"heading": "Heading [deg]"})
    assert of(proposal, "psi").source.unit == OPEN
    assert of(proposal, "psi").open == (
        "the FMU states no unit of 'heading': state it (rad or the like). The FMU describes it as 'Heading [deg]'",
    )


def test_a_unit_that_is_not_known_is_not_guessed(car: Any) -> None:
    proposal = car({"heading": "output degree"})
    assert of(proposal, "psi").source.unit == OPEN
    assert "the unit 'degree' of 'heading' is not known" in of(proposal, "psi").open[0]


def test_a_unit_that_is_named_and_not_defined(car: Any) -> None:
    assert not car(units="").open


def test_radians_as_a_pure_number(car: Any) -> None:
    units = UNITS.replace('<BaseUnit rad="1"/>', "<BaseUnit/>")
    proposal = car({"heading": "output rad"}, units=units)
    assert of(proposal, "psi").source.factor == ""
    assert not of(proposal, "psi").open
    proposal = car({"heading": "output plain_rad"})
    assert of(proposal, "psi").source.factor == OPEN
    assert "is in plain_rad, a pure number" in of(proposal, "psi").open[0]


ARRAYS = {
    "vehicle.position": "output m 2",
    "heading": "output rad",
    "steer": "output rad",
    "wheelbase": "parameter m",
    "vehicle.torque": "input N.m 2",
}


@pytest.mark.parametrize(
    ("text", "order"), [("Drive and steering torque", (1, 2)), ("Steering, then traction [N.m]", (2, 1))]
)
def test_torques_of_an_array_in_the_order_of_its_description(tmp_path: Path, text: str, order: tuple[int, int]) -> None:
    proposal = propose(describe(tmp_path, ARRAYS, texts={"vehicle.torque": text}), CAR_LIKE)
    assert not proposal.open
    assert [variable(proposal, role) for role in ("x", "y")] == ["vehicle.position[1]", "vehicle.position[2]"]
    assert [variable(proposal, role) for role in ("tau_drive", "tau_steer")] == [f"vehicle.torque[{i}]" for i in order]


def test_torques_of_an_array_are_not_taken_by_their_place(tmp_path: Path) -> None:
    proposal = propose(describe(tmp_path, ARRAYS), CAR_LIKE)
    assert [suggestion.role.name for suggestion in proposal.open] == ["tau_drive", "tau_steer"]
    assert of(proposal, "tau_drive").open == (
        "'vehicle.torque[1]' could be it by its place in 'vehicle.torque', which is no proof: if it is the drive "
        'torque, forward, state variable="vehicle.torque[1]"',
    )
    assert of(proposal, "tau_steer").candidates == ("vehicle.torque[2]",)
    assert not proposal.missing
    assert proposal.plausible


def test_an_array_of_a_pose_in_one_unit_cannot_hold_angles(tmp_path: Path) -> None:
    proposal = propose(describe(tmp_path, {"pose": "output m 4"}), CAR_LIKE)
    assert [variable(proposal, role) for role in ("x", "y", "psi")] == ["pose[1]", "pose[2]", OPEN]


def test_an_array_of_a_pose_without_unit_is_asked_for(tmp_path: Path) -> None:
    proposal = propose(describe(tmp_path, {"pose": "output - 4 calculated", "pose0": "parameter - 4"}), CAR_LIKE)
    for i, role in enumerate(("x", "y", "psi", "gamma"), 1):
        assert variable(proposal, role) == OPEN
        assert of(proposal, role).candidates == (f"pose[{i}]",)
    assert of(proposal, "gamma").open[0].endswith('state variable="pose[4]" unit="..." initial="pose0[4]"')


def test_a_pose_whose_units_fit_is_taken(car: Any) -> None:
    """In elements with units of their own, up to the first that does not fit."""
    no = dict.fromkeys(("pos_x", "pos_y", "heading", "steer"))
    pose = {f"pose[{i}]": f"output {unit}" for i, unit in enumerate(("m", "m", "deg", "deg"))}
    proposal = car(no | pose)
    assert [variable(proposal, role) for role in ("x", "y", "psi", "gamma")] == list(pose)
    assert {s.role.name for s in proposal.doubts} == {"psi", "gamma"}
    proposal = car(no | pose | {"pose[2]": "output m"})  # x, y, z, heading
    assert [variable(proposal, role) for role in ("x", "y", "psi", "gamma")] == ["pose[0]", "pose[1]", OPEN, OPEN]
    assert of(proposal, "psi").candidates == ()
    assert of(proposal, "gamma").candidates == ("pose[3]",)


def test_clear_outputs_go_before_a_series_of_locals(car: Any) -> None:
    """As a real robot has them: the series holds x, y, z and the heading."""
    robot = {f"robot_state[{i}]": "local -" for i in (1, 2, 3, 4)}
    robot |= {f"robot_{name}": "output -" for name in ("x", "y", "z", "theta")}
    proposal = car(dict.fromkeys(("pos_x", "pos_y", "heading", "steer")) | robot)
    assert [variable(proposal, role) for role in ("x", "y", "psi")] == ["robot_x", "robot_y", "robot_theta"]
    assert variable(proposal, "gamma") == OPEN
    assert "which is no proof: if it is the steering angle" in of(proposal, "gamma").open[0]


def test_a_name_that_leaves_nothing_open_goes_before_any_series(car: Any) -> None:
    assert variable(car({"pose": "output rad 4"}), "psi") == "heading"
    assert variable(car({"heading": None, "pose": "output - 4", "yaw": "local deg"}), "psi") == "yaw"


def test_elements_that_are_variables_of_their_own(car: Any) -> None:
    torques = {"drive_torque": None, "steer_torque": None, "u[0]": "input N.m", "u[1]": "input N.m"}
    proposal = car(torques)
    assert [of(proposal, role).candidates for role in ("tau_drive", "tau_steer")] == [("u[0]",), ("u[1]",)]
    proposal = car(torques, texts={"u[0]": "Steering torque", "u[1]": "Drive torque"})
    assert [variable(proposal, role) for role in ("tau_drive", "tau_steer")] == ["u[1]", "u[0]"]


@pytest.mark.parametrize("name", ["heading0", "heading_init", "initial.heading", "start_psi", "psi0", "yaw_start"])
def test_a_parameter_for_the_initial_value(car: Any, name: str) -> None:
    proposal = car({"heading": "output deg calculated", name: "parameter deg"})
    assert of(proposal, "psi").source.initial == name
    assert not proposal.open


def test_no_parameter_for_the_initial_value(car: Any) -> None:
    proposal = car({"heading": "output deg calculated", "speed0": "parameter m/s", "heading_rate0": "parameter deg"})
    assert of(proposal, "psi").source.initial == OPEN
    assert "has no start value that can be set" in of(proposal, "psi").open[0]


def test_the_initial_value_of_the_same_name_is_better(car: Any) -> None:
    names = {"heading": "output deg calculated", "psi0": "parameter deg", "heading0": "parameter deg"}
    assert of(car(names), "psi").source.initial == "heading0"


def test_geometry_that_the_fmu_does_not_have_is_asked_for(car: Any) -> None:
    proposal = car({"L": None, "bumper": "parameter m"})
    assert of(proposal, "a").source.value == OPEN
    assert of(proposal, "a").open == (
        "no parameter is obviously the wheelbase: state its value, or name the variable: 'bumper' could be it",
    )


@pytest.mark.parametrize(
    ("outputs", "element"),
    [
        (("speed m/s", "velocity m/s"), '<role name="v" variable="speed"/>'),
        (("rate[1] -", "rate[2] -"), '<role name="v" variable="rate[1]" unit="..."/>'),
        (("schnell_km_h -", "rate[2] -"), '<role name="v" variable="schnell_km_h" unit="..."/>'),
    ],
)
def test_a_velocity_that_is_not_obvious_is_left_out_and_told(
    car: Any, tmp_path: Path, outputs: tuple[str, ...], element: str
) -> None:
    proposal = car({name: f"output {unit}" for name, unit in map(str.split, outputs)})
    assert of(proposal, "v").source is None
    assert not proposal.open
    (doubt,) = of(proposal, "v").doubts
    assert doubt.startswith("no output is obviously the forward velocity")
    assert doubt.endswith(f"could be it; if so, add {element}")
    file = tmp_path / "b.xml"
    file.write_text(binding_xml(proposal, "m.fmu"), encoding="utf-8")
    assert element in file.read_text(encoding="utf-8")
    assert "v" not in {role.name for role in read_binding(file).roles}


def test_velocities_among_locals(car: Any) -> None:
    proposal = car({"cart.speed": "local m/s", "cab.speed": "local m/s"})
    assert of(proposal, "v").candidates == ("cart.speed", "cab.speed")
    assert '<role name="v" variable="cart.speed"/>' in of(proposal, "v").doubts[0]


def test_without_outputs_that_could_be_velocities_nothing_is_told(car: Any) -> None:
    proposal = car({"power": "output N.m"})
    assert (of(proposal, "v").doubts, of(proposal, "omega").doubts) == ((), ())


NAMES = {
    "de": "LageX LageY Gierwinkel Lenkwinkel Geschwindigkeit Lenkgeschwindigkeit Antriebsmoment Lenkmoment Radstand",
    "fr": "position_x position_y lacet braquage vitesse braquage_vitesse couple.moteur couple.braquage empattement",
    "es": "posición_x posición_y rumbo ángulo_dirección velocidad velocidad_dirección par.drive par.dirección batalla",
    "units": "x_m y_m heading_deg steer_deg speed_km_h steer_rate_deg_s drive_torque_Nm steer_torque_Nm wheelbase_mm",
}


@pytest.mark.parametrize("language", NAMES)
def test_names_in_other_languages_and_with_units(tmp_path: Path, language: str) -> None:
    said = ("output m", "output m", "output deg", "output deg", "output m/s", "output rad/s", "input N.m", "input N.m")
    roles = ("x", "y", "psi", "gamma", "v", "omega", "tau_drive", "tau_steer", "a")
    names = NAMES[language].split()
    proposal = propose(describe(tmp_path, dict(zip(names, (*said, "parameter m"), strict=True))), CAR_LIKE)
    assert [variable(proposal, role) for role in roles] == names
    assert not proposal.open


def test_a_unit_at_the_end_of_a_name_is_a_hint(car: Any) -> None:
    """A unit elsewhere in the text is not taken for the variable's unit."""
    proposal = car({"heading": "output -"} | {"heading": None, "yaw_deg": "output -", "yaw_m": "output -"})
    assert of(proposal, "psi").source.variable == "yaw_deg"
    assert of(proposal, "psi").open == (
        "the FMU states no unit of 'yaw_deg': state it (deg, as its name ends, or the like)",
    )
    assert variable(car({"heading": None, "yaw_m": "output deg"}), "psi") == OPEN, "which m may stand for much else"


def test_a_number_that_would_play_two_roles(car: Any) -> None:
    proposal = car({"pos_x": None, "pos_y": None, "x_y": "output m"})
    for role in ("x", "y"):
        assert variable(proposal, role) == OPEN
        assert of(proposal, role).open == ("'x_y' would play more than one role",)


def test_other_conventions_raise_a_doubt_only(car: Any) -> None:
    proposal = car(texts={"heading": "Clockwise from north"})
    assert not proposal.open
    assert proposal.doubts == (of(proposal, "psi"),)
    assert of(proposal, "psi").doubts == (
        "here it is the heading, counter-clockwise from X; the FMU describes 'heading' as 'Clockwise from north'",
    )


TRAILER = {"trailer.x": "output m", "trailer.y": "output m", "trailer.heading": "output rad"}
TRAILER |= {"tractor.heading": "output rad", "torque_right": "input N.m", "torque_left": "input N.m"}
TRAILER |= {"hitch_length": "parameter m", "wheel_radius": "parameter m", "half_track": "parameter m"}
DIFFERENTIAL = {"x": "output m", "y": "output m", "theta": "output rad", "v": "output m/s"}
DIFFERENTIAL |= {"tau_right": "input N.m", "tau_left": "input N.m", "r": "parameter m", "b": "parameter m"}


def test_the_kind_that_fits_best_comes_first(tmp_path: Path) -> None:
    best, *_ = proposals(describe(tmp_path, CAR))
    assert best.kind is CAR_LIKE
    assert not best.refusal
    steers = "its input 'steer_torque' steers, and no two inputs are for a right and a left wheel"
    assert [propose(describe(tmp_path, CAR), kind).refusal for kind in (TRACTOR_TRAILER, DIFFERENTIAL_DRIVE)] == (
        [steers, steers]
    )
    best, *_ = proposals(describe(tmp_path, TRAILER))
    assert best.kind is TRACTOR_TRAILER
    assert not best.open
    assert not best.refusal
    drives = "its inputs 'torque_right' and 'torque_left' are for a right and a left wheel, and "
    assert [propose(describe(tmp_path, TRAILER), kind).refusal for kind in (CAR_LIKE, DIFFERENTIAL_DRIVE)] == [
        f"{drives}no input steers",
        f"{drives}it mentions a trailer or a hitch: it seems to be a tractor with a trailer",
    ]


def test_a_differential_drive_is_no_car_and_no_tractor(tmp_path: Path) -> None:
    for changed in ({}, {f"state[{i}]": "local -" for i in (1, 2, 3, 4)}):
        best, *others = proposals(describe(tmp_path, DIFFERENTIAL | changed))
        assert best.kind is DIFFERENTIAL_DRIVE
        assert best.needs_no_binding
        for other in others:
            assert "'tau_right' and 'tau_left' are for a right and a left wheel, and no" in other.refusal
            assert not other.plausible
    text = describe(tmp_path, DIFFERENTIAL)
    text.description = "A tractor and its semi-trailer"
    assert not propose(text, TRACTOR_TRAILER).refusal, "it says that there is a trailer"
    assert propose(text, DIFFERENTIAL_DRIVE).refusal


def test_a_foreign_differential_drive_is_recognised(tmp_path: Path) -> None:
    names = {"pose.x": "output m", "pose.y": "output m", "robot.yaw": "output rad", "forward_speed": "output m/s"}
    names |= {"yaw_rate": "output rad/s", "torque_left": "input N.m", "torque_right": "input N.m"}
    names |= {"wheel_radius": "parameter m", "half_track": "parameter m"}
    best, *_ = proposals(describe(tmp_path, names))
    assert best.kind is DIFFERENTIAL_DRIVE
    assert not best.open
    assert {s.role.name: s.source.variable for s in best.suggestions if s.source is not None} == {
        "x": "pose.x",
        "y": "pose.y",
        "theta": "robot.yaw",
        "v": "forward_speed",
        "omega": "yaw_rate",
        "tau_right": "torque_right",
        "tau_left": "torque_left",
        "r": "wheel_radius",
        "b": "half_track",
    }


def test_names_that_tell_nothing_refuse_nothing(tmp_path: Path) -> None:
    """Nor do the roles' own names, nor inputs that brake or disturb."""
    plain = {"q1": "output -", "q2": "output -", "q3": "output -", "q4": "output -", "u1": "input -", "u2": "input -"}
    own = {"x": "output m", "y": "output m", "theta_1": "output rad", "theta_0": "output rad"}
    own |= {"tau_right": "input N.m", "tau_left": "input N.m"}
    brakes = CAR | {"brake_left": "input N.m", "brake_right": "input N.m", "wind.left": "input N"}
    for variables, kind in ((plain, CAR_LIKE), (plain, TRACTOR_TRAILER), (own, TRACTOR_TRAILER)):
        assert not propose(describe(tmp_path, variables), kind).refusal
    assert not propose(describe(tmp_path, brakes), CAR_LIKE).refusal


@pytest.mark.parametrize(
    ("variables", "reason"),
    [
        ({"drive_torque": None, "steer_torque": "input rad"}, "no input that could be a torque, in N.m, N, a pure"),
        (
            {"drive_torque": None, "steer_torque": "input N", "bend_rad": "input -"},
            "only 'steer_torque' that could be a torque",
        ),
    ],
)
def test_what_lacks_inputs_is_no_vehicle(car: Any, variables: dict[str, Any], reason: str) -> None:
    assert reason in car(variables).refusal


def test_the_file_that_is_written_is_refused_until_it_is_filled_in(car: Any, tmp_path: Path) -> None:
    file = tmp_path / "b.xml"
    file.write_text(binding_xml(car({"heading": "output -"}), "m.fmu"), encoding="utf-8")
    with pytest.raises(InputError, match=r"the role 'psi' has unit=\"\.\.\.\", which is to be filled in") as caught:
        read_binding(file)
    line = caught.value.where.line
    lines = file.read_text(encoding="utf-8").splitlines()
    assert '<role name="psi"' in lines[line - 1]
    assert "psi: the FMU states no unit" in lines[line - 2]
    file.write_text(file.read_text(encoding="utf-8").replace('unit="..."', 'unit="deg"'), encoding="utf-8")
    assert read_binding(file).vehicle == "car_like"


def test_texts_of_strangers_cannot_end_a_comment(car: Any) -> None:
    text = binding_xml(
        car({"heading": "output -"}, texts={"heading": "--&gt; &lt;evil/&gt; --- &#x85; -"}), "a--b-.fmu"
    )
    root = etree.fromstring(text.encode())
    assert {etree.QName(child).localname for child in root if isinstance(child.tag, str)} == {"role"}
    assert "\x85" not in text


def test_names_that_occur_twice_are_nobodys(car: Any, tmp_path: Path) -> None:
    description = describe(tmp_path, CAR)
    description.modelVariables.append(description.modelVariables[2])
    assert variable(propose(description, CAR_LIKE), "psi") == OPEN


def test_ten_thousand_variables(tmp_path: Path) -> None:
    many = {f"body.frame_{i}.x": "local m" for i in range(10_000)}
    assert not propose(describe(tmp_path, CAR | many), CAR_LIKE).open


SYLLABLES = ("bdfgkp", "aeiou", "bdfgkp", "aeiou")


@pytest.mark.parametrize(
    "names", [[f"part_{i}.force" for i in range(500)], list(map("".join, product(*SYLLABLES)))[:500]]
)
def test_the_units_of_many_variables_are_looked_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, names: list[str]
) -> None:
    looked: list[str] = []

    def counted(description: Any, variable: Any) -> Any:
        looked.append(variable.name)
        return unit_of(description, variable)

    monkeypatch.setattr(candidates, "unit_of", counted)
    numbers = []
    for count in (10, 500):
        proposals(describe(tmp_path, dict.fromkeys(names[:count], "parameter N")))
        numbers.append(len(looked))
        looked.clear()
    assert numbers[0] == numbers[1]


@pytest.mark.parametrize("name", ["axle[{}].slip", "slip_{}"])
def test_names_that_differ_by_digits_only_are_taken_apart_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    looked: list[str] = []

    def counted(name: str) -> tuple[str, ...]:
        looked.append(name)
        return parts_of(name)

    monkeypatch.setattr(candidates, "parts_of", counted)
    numbers = []
    for count in (10, 500):
        others = {name.format(i): about for i in range(count) for about in [("output -", "parameter m")[i % 2]]}
        proposals(describe(tmp_path, {key: CAR[key] for key in list(CAR)[:4]} | others))
        numbers.append(len(looked))
        looked.clear()
    assert numbers[0] == numbers[1]


def test_numbers_that_are_alike_are_ranked_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ranked: list[str] = []
    rank = proposal._rank

    def counted(role: Any, kind: Any, number: Any, words: Any) -> Any:
        ranked.append(number.name)
        return rank(role, kind, number, words)

    monkeypatch.setattr(proposal, "_rank", counted)
    numbers = []
    for count in (10, 500):
        steering = {f"wheel_{i}.steer": "output deg" for i in range(2, 2 + count)}
        gamma = of(propose(describe(tmp_path, CAR | steering), CAR_LIKE), "gamma")
        assert gamma.source is not None
        assert gamma.source.variable == "steer"  # the better name
        others = {name: said for name, said in CAR.items() if name != "steer"} | steering
        assert of(propose(describe(tmp_path, others), CAR_LIKE), "gamma").candidates == tuple(steering)
        numbers.append(len(ranked))
        ranked.clear()
    assert numbers[0] == numbers[1]


def test_a_unit_that_contradicts_its_name_stays_open(car) -> None:
    contradictory = UNITS.replace('"0.017453292519943295"', '"1"')
    suggestion = of(car(units=contradictory), "psi")
    assert suggestion.source is not None
    assert (suggestion.source.variable, suggestion.source.unit) == ("heading", OPEN)
    assert suggestion.open[0].endswith('by the definition 1 rad: state unit="deg" or unit="rad"')
