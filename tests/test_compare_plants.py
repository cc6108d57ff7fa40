"""``formation compare-plants``: equal plants show no difference, others the true one; failures are reported."""

import io
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

import cosim
import plants
from cosim import PlantFile, compare_plants
from cosim.cli import main
from cosim.cli.comparing import _print
from cosim.compare.comparison import TOLERANCE
from cosim.compare.figure import draw_comparison
from cosim.vehicle.car_like import CAR_LIKE

from .commands import command
from .fmus import NAMES, renamed
from .stub.stub import make_fmu

SHORT = {"duration": 3.0}


@pytest.fixture
def compare(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Return a function that compares for 2 s and returns what is printed, each space once, and to standard error."""

    def run(*arguments: object, status: int = 0, duration: str = "2 s") -> tuple[str, str]:
        options = ["--out", str(tmp_path / "out"), "--no-figure", "--duration", duration]
        printed, warned = command(capsys, "compare-plants", *arguments, *options, status=status)
        return " ".join(printed.split()), warned

    return run


def bound(folder: Path, **roles: str) -> Path:
    """Return a binding of a car: the attributes of each role."""
    path = folder / "binding.xml"
    lines = "".join(f'<role name="{name}" {attributes}/>' for name, attributes in roles.items())
    path.write_text(f'<binding xmlns="urn:formation-cosim:scenario:1" vehicle="car_like">{lines}</binding>')
    return path


def largest(comparison: cosim.PlantComparison) -> dict[str, float]:
    return {found.role.name: found.largest for found in comparison.roles}


# What they do -----------------------------------------------------------------------------------------------


def test_a_plant_does_what_it_does() -> None:
    comparison = compare_plants("car_like", "car_like", **SHORT)
    assert set(largest(comparison)) == {"x", "y", "psi", "gamma", "v", "omega"}
    assert not any(largest(comparison).values())
    assert comparison.within
    assert comparison.reached == 3.0
    assert comparison.time.tolist() == pytest.approx(np.arange(151) * 0.02)
    assert comparison.states[0].shape == (151, 6)
    assert comparison.torque.shape == (150, 2)
    assert comparison.geometry == {"wheelbase": (1.2, 1.2), "drive": ("as_printed", "as_printed")}


@pytest.mark.parametrize("kind", [{"fmi": "3.0"}, {"interface": "model_exchange"}])
def test_kinds_of_fmus_of_one_plant_agree(tmp_path: Path, kind: dict[str, str]) -> None:
    """To rounding, with one method: Model Exchange is integrated here."""
    fmu = plants.build("car_like", fmi=kind.get("fmi", "2.0"), out=tmp_path)
    other = PlantFile(fmu, interface=kind.get("interface", ""), solver="euler" if "interface" in kind else "")
    assert max(largest(compare_plants("car_like", other, **SHORT)).values()) < 1e-12


def test_units_signs_and_initial_values_are_those_of_the_binding(tmp_path: Path) -> None:
    """Deg and km/h, clockwise: the same robot, up to rounding of conversions."""
    plain = make_fmu(tmp_path, name="plain")
    other = make_fmu(tmp_path, name="other", units="deg", initial="parameters", names={"psi": "heading"})
    binding = bound(
        tmp_path,
        x='variable="x" initial="x0"',
        y='variable="y" initial="y0"',
        psi='variable="heading" initial="psi0"',
        gamma='variable="gamma" initial="gamma0"',
    )
    assert max(largest(compare_plants(plain, PlantFile(other, binding), **SHORT)).values()) < 1e-12
    mirrored = bound(
        tmp_path,
        y='variable="y" initial="y0" factor="-1"',
        x='variable="x" initial="x0"',
        psi='variable="heading" initial="psi0" factor="-1"',
        gamma='variable="gamma" initial="gamma0" factor="-1"',
        omega='variable="omega" factor="-1"',
        tau_steer='variable="tau_steer" factor="-1"',
    )
    assert max(largest(compare_plants(plain, PlantFile(other, mirrored), **SHORT)).values()) < 1e-12


def test_a_wrong_sign_shows_at_once(tmp_path: Path) -> None:
    binding = bound(tmp_path, gamma='variable="gamma" factor="-1"')
    comparison = compare_plants("car_like", PlantFile(plants.build("car_like"), binding), **SHORT)
    (gamma,) = [found for found in comparison.roles if found.role.name == "gamma"]
    assert gamma.first_beyond <= 0.04
    assert gamma.largest > math.radians(10)


def test_angles_differ_by_less_than_half_a_turn(tmp_path: Path) -> None:
    """One brings its heading back to within half a turn; the torques make it turn round and round."""
    plain, bounded = make_fmu(tmp_path, name="plain"), make_fmu(tmp_path, name="bounded", step_event=True)
    torques = np.tile([30.0, 0.0], (1500, 1))
    comparison = compare_plants(plain, bounded, duration=30.0, torque=torques, pose={"gamma": math.radians(60)})
    psi = [states[:, 2] for states in comparison.states]
    assert np.ptp(psi[0]) > 2 * math.pi
    assert np.abs(psi[1]).max() < 1.1 * math.pi
    assert max(largest(comparison).values()) < 1e-9


def test_figures_are_those_of_the_courses() -> None:
    comparison = compare_plants(
        "car_like", PlantFile("car_like", parameters={"a": "1.5 m"}), within=["x=1 cm"], **SHORT
    )
    assert comparison.geometry["wheelbase"] == (1.2, 1.5)
    for column, found in enumerate(comparison.roles):
        course = comparison.states[1][:, column] - comparison.states[0][:, column]
        np.testing.assert_allclose(comparison.difference[:, column], course, atol=1e-15)
        assert found.largest == pytest.approx(np.abs(course).max())
        assert abs(course[round(found.at / 0.02)]) == pytest.approx(found.largest)
        assert found.rms == pytest.approx(np.sqrt(np.mean(course**2)))
        assert found.span == pytest.approx(np.ptp(comparison.states[0][:, column]))
    x, y, *_ = comparison.roles
    assert x.tolerance == 0.01
    first = round(x.first_beyond / 0.02)
    assert abs(comparison.difference[first, 0]) > 0.01 >= np.abs(comparison.difference[:first, 0]).max()
    assert y.tolerance == math.inf
    assert y.first_beyond is None
    assert not comparison.within


def test_torques_from_a_table(tmp_path: Path) -> None:
    table = tmp_path / "torques.csv"
    table.write_text("time [s],tau_drive [N.m]\n0,0\n1,20\n2,20\n")
    comparison = compare_plants("car_like", "car_like", torque=table, duration=2.0, pose={"gamma": 0.0, "psi": 0.0})
    np.testing.assert_allclose(comparison.torque[:, 0], np.minimum(comparison.time[:-1], 1.0) * 20)
    assert not comparison.torque[:, 1].any()
    assert not comparison.states[0][:, 3].any()
    assert comparison.torque_from == f"the table {table} (without tau_steer, which is 0)"


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        ("0,5,3\n2,6,3\n", ""),
        ("-1,5,3\n1.98,6,3\n", ""),
        ("0,5,3\n0.5,6,3\n", " (its last row, at 0.5 s, holds until the end)"),
    ],
)
def test_a_table_that_ends_early_is_told(tmp_path: Path, rows: str, told: str) -> None:
    table = tmp_path / "torques.csv"
    rows = "".join(f"{row},7\n" for row in rows.splitlines())  # one more column, as a recorded run has
    table.write_text("time [s],tau_drive [N.m],tau_steer [N.m],x [m]\n" + rows)
    comparison = compare_plants("car_like", "car_like", torque=table, duration=2.0)
    assert comparison.to_dict()["torque"]["from"] == f"the table {table}{told}"


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        (
            "time [s],tau_drive [N.m],tau_stear [N.m]\n0,5,3\n",
            ".csv:1: error: the column 'tau_stear' is no command of a car_like vehicle: did you mean 'tau_steer'? ",
        ),
        ("time [s],tau_drive [N.m]\n100,5\n101,6\n", "begins at 100 s, after the drive begins, at 0 s"),
        ("time [s],tau_drive [N.m]\n-2,5\n-1,6\n", "ends at -1 s, before the drive begins, at 0 s"),
    ],
)
def test_a_table_that_does_not_drive_them_is_refused(compare, tmp_path: Path, table: str, sentence: str) -> None:
    (tmp_path / "torques.csv").write_text(table)
    _, warned = compare("car_like", "car_like", "--torque", tmp_path / "torques.csv", status=2)
    assert sentence in warned


def test_velocities_that_are_not_offered_are_not_compared(tmp_path: Path) -> None:
    comparison = compare_plants(make_fmu(tmp_path), make_fmu(tmp_path, name="b", velocities=False), **SHORT)
    assert list(largest(comparison)) == ["x", "y", "psi", "gamma"]
    assert comparison.to_dict()["not_offered"] == ["v", "omega"]


@pytest.mark.parametrize("within", ["v=1 mm/s", "1 mm/s"])
def test_a_tolerance_of_what_a_plant_does_not_offer_is_refused(compare, tmp_path: Path, within: str) -> None:
    """It would hold whatever the plants do. One that limits something else besides is a limit of that."""
    silent = make_fmu(tmp_path, name="silent", velocities=False)
    _, warned = compare("car_like", silent, "--within", within, status=2)
    assert f"within {within}: plant B (silent.fmu) offers no v, so it would hold whatever they do" in warned
    compare("car_like", silent, "--within", "0", status=1)
    compare(silent, silent, "--within", "1 cm", "--within", "1 mm/s", status=0)


def test_what_an_fmu_logs_is_kept(tmp_path: Path) -> None:
    comparison = compare_plants("car_like", make_fmu(tmp_path, behaviour="warning"), **SHORT)
    assert comparison.messages
    assert comparison.messages[0].startswith("B, t = ")


# The torques by default -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "parameters",
    [
        {},
        {"m_c": "1500 kg", "I_f": "500 kg.m2", "I_c": "2000 kg.m2"},
        {"m_c": "1 kg", "I_f": "0.2 kg.m2", "d_x": "1 N.s/m", "d_y": "1 N.s/m", "d_gamma": "1 N.m.s/rad"},
        {"d_gamma": "0 N.m.s/rad", "d_x": "0 N.s/m", "d_y": "0 N.s/m", "d_psi": "0 N.m.s/rad"},
    ],
)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_they_move_any_car_well_but_keep_it_far_from_90_degrees(parameters: dict[str, str], seed: int) -> None:
    car = PlantFile("car_like", parameters=parameters | {"drive": "rear_wheel", "solver": "runge_kutta_4"})
    comparison = compare_plants(car, car, seed=seed)
    assert not comparison.failures
    bent = np.abs(comparison.states[0][:, 3])
    assert math.radians(15) < bent.max() < math.radians(75)
    assert np.abs(comparison.states[0][:, 4]).max() > 0.3
    steering = comparison.torque[:, 1]
    assert 0.2 < (steering > 0).mean() < 0.8


def test_they_keep_a_trailer_far_from_90_degrees() -> None:
    comparison = compare_plants("tractor_trailer", "tractor_trailer")
    hitch = comparison.states[0][:, 3] - comparison.states[0][:, 2]
    assert math.radians(15) < np.abs(hitch).max() < math.radians(75)
    assert not comparison.failures


def test_the_seed_tells_them() -> None:
    one, again, other = (compare_plants("car_like", "car_like", seed=seed, **SHORT).torque for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, again)
    assert not np.array_equal(one, other)


def test_a_plant_that_does_not_move_gets_them_as_they_are(tmp_path: Path) -> None:
    comparison = compare_plants(make_fmu(tmp_path, behaviour="nothing"), "car_like", **SHORT)
    assert np.abs(comparison.torque).max() < 25


# At the command line ----------------------------------------------------------------------------------------


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fmu = renamed(tmp_path / "[red]vendor.fmu")
    roles = {role: f'variable="{name}"' for role, name in NAMES.items() if role != "m_c"}
    out = tmp_path / "out" / "deep"
    arguments = [
        "compare-plants",
        "car_like",
        str(fmu),
        "--binding-b",
        str(bound(tmp_path, **roles)),
        "--out",
        str(out),
    ]
    arguments += ["--duration", "2 s", "--parameter-b", "a=1.3 m", "--pose", "psi=90 deg"]
    arguments += ["--parameter", "drive=rear_wheel"]
    assert main(arguments) == 0
    printed = " ".join(capsys.readouterr().out.split())
    for text in (
        "A the built-in model car_like (FMI 2.0, co_simulation, Formation 0.1.0)",
        "[red]vendor.fmu (FMI 2.0",
        "2 s in steps of 0.02 s, from x = 1 m, y = -2 m, psi = 90 deg, gamma = 10 deg",
        "they differ: the wheelbase of A is 1.2 m, of B 1.3 m",
        "at A's own beyond",
        "role unit largest [s] RMS range tolerance from [s]",
        "results in ",
    ):
        assert text in printed
    assert "they differ: the drive" not in printed
    assert (out / "compare.png").read_bytes().startswith(b"\x89PNG")
    report = json.loads((out / "compare.json").read_text())
    assert report["vehicle"] == "car_like"
    assert report["geometry"] == {"wheelbase": [1.2, 1.3], "drive": ["rear_wheel", "rear_wheel"]}
    assert report["plants"][1]["binding"]["psi"] == "Chassis.yaw"
    assert report["plants"][1]["parameters"] == {"drive": "rear_wheel", "a": "1.3 m"}
    assert len(report["plants"][0]["sha256"]) == 64
    assert report["pose"]["psi"] == pytest.approx(math.pi / 2)
    assert report["differences"]["psi"]["unit"] == "rad"
    assert report["differences"]["psi"]["largest"] > 1e-3
    assert report["differences"]["psi"]["tolerance"] == TOLERANCE
    assert not report["within"]
    assert report["reached"] == 2.0


@pytest.mark.parametrize("number", [1, 2, 3])
def test_the_figure_has_all_commands(number: int) -> None:
    """As many as the kind of vehicle takes."""
    comparison = compare_plants("car_like", "car_like", duration=0.2)
    roles = tuple(replace(CAR_LIKE.command[0], name=f"command {k}") for k in range(number))
    torque = np.zeros((10, number))
    figure = draw_comparison(replace(comparison, kind=replace(CAR_LIKE, command=roles), torque=torque))
    drawn = [axes.get_ylabel() for axes in figure.axes if axes.get_ylabel().startswith("command")]
    assert drawn == [f"command {k} [N.m]" for k in range(number)]


@pytest.mark.parametrize(("unit", "called"), [("N.m", "torques"), ("m/s", "commands")])
def test_commands_are_called_torques_if_they_are(unit: str, called: str) -> None:
    comparison = compare_plants("car_like", "car_like", duration=0.2)
    command = (replace(CAR_LIKE.command[0], unit=unit), CAR_LIKE.command[1])
    comparison = replace(comparison, kind=replace(CAR_LIKE, command=command))
    console = Console(file=io.StringIO(), width=200)
    _print(console, comparison)
    figure = draw_comparison(comparison)
    titles = [axes.get_title() for axes in figure.axes]
    assert f"; {called}: steps and sines of " in console.file.getvalue()
    assert figure.get_suptitle().endswith(f" under the same {called}")
    assert any(title.startswith(f"{called}: steps and sines of ") for title in titles)


def test_within(compare) -> None:
    wider = ("car_like", "car_like", "--parameter-b", "a=1.3 m")
    assert "never" in compare("car_like", "car_like", "--within", "1e-12 m")[0]
    compare("car_like", "car_like", "--within", "0")
    compare(*wider, "--within", "0.5 m")
    compare(*wider, "--within", "0.5 m", "--within", "0.1 deg/s", status=1)
    compare(*wider, "--within", "psi=0.001 deg", "--within", "0.5 m", status=1)
    printed, _ = compare(*wider, "--within", "0", status=1)
    assert "results in" in printed


NEITHER = "warning: neither plant moves by more than the tolerance in {}: this shows nothing, so they are not within it"


def test_plants_that_do_not_move_prove_nothing(compare, tmp_path: Path) -> None:
    still = make_fmu(tmp_path, behaviour="nothing")
    printed, _ = compare(still, still, "--within", "1 mm", "--within", "0.1 deg", status=1)
    assert NEITHER.format("x, y, psi, gamma") in printed
    assert "warning: the torques move A at 0 m/s at most and turn it by 0 deg, far less than the 1 m/s" in printed
    report = json.loads((tmp_path / "out" / "compare.json").read_text())
    assert not report["within"]
    assert len(report["warnings"]) == 2


def test_plants_too_heavy_to_move_prove_nothing(compare) -> None:
    heavy = ("car_like", "car_like", "--parameter", "m_c=1e15 kg", "--parameter-b", "a=2 m")
    printed, _ = compare(*heavy, "--within", "1 mm", status=1)
    assert NEITHER.format("x, y") in printed
    assert "warning: the torques move A at " in printed
    compare(*heavy, status=0)


def test_a_role_in_which_a_does_not_move_is_told(compare, tmp_path: Path) -> None:
    """Straight on, a heading is within any tolerance; x still counts."""
    table = tmp_path / "torques.csv"
    table.write_text("time [s],tau_drive [N.m]\n0,20\n2,20\n")
    straight = ("car_like", "car_like", "--torque", table, "--pose", "gamma=0 deg", "--pose", "psi=0 deg")
    printed, _ = compare(*straight, "--within", "1 mm", "--within", "0.1 deg")
    told = (
        "warning: A moves by no more than the tolerance in y, psi, gamma: a plant that stands still is within it, too"
    )
    assert told in printed
    assert "warning" not in compare(*straight, "--within", "x=1 mm")[0]
    printed, _ = compare(*straight, "--within", "psi=0.1 deg", status=1)
    assert NEITHER.format("psi") in printed


@pytest.mark.parametrize("duration", [0.2, 20.0])
@pytest.mark.parametrize("model", ["car_like", "tractor_trailer", "differential_drive"])
def test_plants_that_move_well_cause_no_warning(model: str, duration: float) -> None:
    assert compare_plants(model, model, duration=duration).warnings == ()


@pytest.mark.parametrize("behaviour", ["segfault", "exit", "error", "nan"])
def test_a_plant_that_fails(compare, tmp_path: Path, behaviour: str) -> None:
    """In a process of its own, it does not end the harness; the motion up to then is compared."""
    fmu = make_fmu(tmp_path, behaviour=behaviour, when=1.0)
    printed, warned = compare("car_like", fmu, "--within", "1 m", status=3)
    assert "compared up to 1 s" in warned or "compared up to 0.98 s" in warned
    assert "error: B at t = 1" in warned
    assert "role unit largest" in printed
    report = json.loads((tmp_path / "out" / "compare.json").read_text())
    assert 0.9 < report["reached"] < 1.1
    assert len(report["failures"]) == 1
    assert not report["within"]


def test_a_first_plant_that_fails_whatever_the_torques(compare, tmp_path: Path) -> None:
    _, warned = compare(make_fmu(tmp_path, behaviour="error", when=1.0), "car_like", status=3)
    assert "error: A at t = 1 s" in warned


def test_a_plant_that_fails_at_once(compare, tmp_path: Path) -> None:
    fmu = make_fmu(tmp_path, behaviour="error", when=0.0)
    printed, warned = compare("car_like", fmu, status=3)
    assert "largest" not in printed, "there is nothing to compare"
    assert "warning: nothing was compared: a plant failed" in warned
    assert "error: B at t = 0 s" in warned
    main(["compare-plants", "car_like", str(fmu), "--out", str(tmp_path / "out"), "--duration", "1 s"])
    assert (tmp_path / "out" / "compare.png").exists()


def test_a_plant_that_cannot_be_started(compare, tmp_path: Path) -> None:
    _, warned = compare("car_like", make_fmu(tmp_path, behaviour="error", place="instantiate"), status=2)
    assert "cannot be started as B" in warned


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["car_like", "tractor_trailer"], "is a car_like vehicle, but tractor_trailer.fmu is a tractor_trailer"),
        (["car_like", "none.fmu"], "none.fmu cannot be read: there is no such file"),
        (["car_lke", "car_like"], "no built-in model 'car_lke', and no FMU of that name: did you mean 'car_like'?"),
        (["car_like", "{renamed}"], '"formation swap" writes one to complete'),
        (["car_like", "car_like", "--binding-b", "none.xml"], "none.xml: error: there is no such file"),
        (["car_like", "car_like", "--pose", "phi=1 deg"], "there is no pose entry 'phi'"),
        (["car_like", "car_like", "--pose", "theta_1=1 deg"], "a car_like vehicle has no pose entry 'theta_1'"),
        (["car_like", "car_like", "--pose", "psi=1 m"], "m does not fit"),
        (["car_like", "car_like", "--pose", "psi"], "--pose psi: expected NAME=VALUE"),
        (["car_like", "car_like", "--step", "20"], "--step: '20': the unit is missing"),
        (["car_like", "car_like", "--step", "30 ms"], "are not a whole number of steps of 0.03 s"),
        (["car_like", "car_like", "--step", "1 us"], "from 1 to 1000000 of them"),
        (["car_like", "car_like", "--parameter", "mass=1 kg"], "has no parameter 'mass'"),
        (["car_like", "car_like", "--parameter-a", "a=1 kg"], "kg does not fit"),
        (["car_like", "car_like", "--torque", "none.csv"], "there is no such file"),
        (["car_like", "car_like", "--torque", "{table}"], "has none of the columns tau_drive and tau_steer"),
        (["car_like", "car_like", "--within", "1 kg"], "within 1 kg: expected a number that is not negative, in a"),
        (["car_like", "car_like", "--within", "z=1 m"], "has no role 'z' to compare"),
        (["car_like", "car_like", "--within", "x=1 deg"], "in a unit such as m"),
        (["car_like", "car_like", "--within", "-1 m"], "is not negative"),
        (["car_like", "car_like", "--within", "wide"], "'wide' is not a number with a unit"),
        (
            ["car_like", "car_like", "--within", "1"],
            "within 1: has no unit; it may be meant as '1 m' and '1 rad' and '1",
        ),
        (["car_like", "car_like", "--within", "psi=0.1"], "psi=0.1: has no unit; it may be meant as '0.1 rad'\n"),
        (
            ["car_like", "car_like", "--within", "1 m", "--within", "2 m"],
            "within 2 m: a tolerance of x, y is given ",
        ),
        (
            ["car_like", "car_like", "--parameter-a", "a=1 m", "--parameter-a", "a=2 m"],
            "a is given twice, first as ",
        ),
        (["car_like", "car_like", "--seed", "-1"], "the seed -1 is not a whole number from 0 on"),
        (
            ["car_like", "car_like", "--parameter", "a=1"],
            "--parameter a=1: error: parameter a of car_like.fmu: ",
        ),
        (["{both}", "car_like", "--solver-a", "cvode"], "plant A: error: the FMU {both} runs in Co-Simulation with "),
        (["{both}", "car_like", "--solver-a", "cvode"], 'or state interface="model_exchange", whose solver takes it'),
        (["{fixed}", "car_like"], "has a fixed internal step of 0.03 s, which does not divide"),
        (["car_like", "{fixed}"], "has a fixed internal step of 0.03 s, which does not divide"),
    ],
)
def test_bad_input(compare, tmp_path: Path, arguments: list[str], sentence: str) -> None:
    table = tmp_path / "table.csv"
    table.write_text("time [s],wind [N]\n0,1\n")
    made = {"renamed": renamed(tmp_path / "r.fmu"), "table": table}
    made["fixed"] = make_fmu(tmp_path, fmi="3.0", fixed_step=0.03)
    made["both"] = make_fmu(tmp_path / "both", interface="both")
    _, warned = compare(*(argument.format(**made) for argument in arguments), status=2)
    assert sentence.replace("{both}", str(made["both"])) in warned
    assert not (tmp_path / "out").exists()


def test_a_folder_that_cannot_be_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").touch()
    arguments = ["compare-plants", "car_like", "car_like", "--duration", "1 s", "--out", str(tmp_path / "file" / "x")]
    assert main(arguments) == 2
    printed = capsys.readouterr()
    file = tmp_path / "file"
    assert f"cannot be written to {file / 'x'}: {file} is no folder; choose another --out" in printed.err
    assert printed.out == "", "before anything is computed"


def test_a_folder_that_was_there_stays(compare, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    main(["compare-plants", "car_like", "none.fmu", "--out", str(tmp_path / "out")])
    assert (tmp_path / "out").exists()


def test_an_interface_or_solver_that_there_is_not() -> None:
    with pytest.raises(cosim.InputError, match="there is no solver 'rk4': known: cvode, euler, runge_kutta_4"):
        PlantFile("car_like", solver="rk4")
    with pytest.raises(cosim.InputError, match="there is no interface 'cosimulation': did you mean 'co_simulation'"):
        PlantFile("car_like", interface="cosimulation")


def test_the_table_fits_80_columns() -> None:
    out = io.StringIO()
    different = compare_plants("car_like", PlantFile("car_like", parameters={"a": "1.3 m"}), **SHORT)
    _print(Console(file=out, width=80, force_terminal=True, color_system=None), different)
    text = out.getvalue()
    assert "…" not in text
    for role in different.roles:
        assert f" {role.role.name} " in text


def test_from_python() -> None:
    assert cosim.compare_plants is compare_plants
    with pytest.raises(cosim.InputError, match=r"the torques are an array \(3, 2\); expected \(50, 2\)"):
        compare_plants("car_like", "car_like", duration=1.0, torque=np.zeros((3, 2)))
    comparison = compare_plants("car_like", "car_like", duration=1.0, torque=np.zeros((50, 2)))
    assert comparison.kind is CAR_LIKE
    assert comparison.torque_from == "an array"
