"""``formation inspect``: the content of an FMU, valid or broken, and the kinds of vehicle that it could be."""

from pathlib import Path

import pytest

import plants

from .commands import command
from .fmus import rewritten
from .stub.broken import BROKEN, make_broken
from .stub.stub import make_fmu

UNREADABLE = {
    "empty_file",
    "no_zip",
    "empty_zip",
    "truncated",
    "crc",
    "description_crc",
    "encrypted",
    "no_description",
    "no_xml",
    "no_utf8",
    "fmi_4",
    "entity_bomb",
    "external_entity",
    "parent_entry",
    "backslash_entry",
    "absolute_entry",
    "link_entry",
    "two_descriptions",
}
"""Broken files that are no FMUs at all, or not to be unpacked."""


@pytest.fixture
def inspect(capsys: pytest.CaptureFixture[str]):
    """Return a function that inspects an FMU and returns what is printed, each space once, and the warnings."""

    def run(path: Path, *options: str, status: int = 0) -> tuple[str, str]:
        printed, warned = command(capsys, "inspect", path, *options, status=status)
        return " ".join(printed.split()), warned

    return run


def test_our_own(inspect) -> None:
    path = plants.build("car_like")
    printed, warned = inspect(path)
    assert warned == ""
    for text in (
        "car_like.fmu",
        "FMI version 2.0",
        "made by Formation 0.1.0",
        "SHA-256 ",
        " is among them; it brings its C sources",
        "Co-Simulation supported",
        "Model Exchange supported",
        "variable communication step",
        "directional derivatives",
        "saved states",
        "tau_drive input continuous Real N.m 0.0 Drive torque",
        "drive parameter fixed Enumeration as_printed",
        "As a car_like vehicle: it can be driven as it is",
        "gamma rad the steering angle, counter-clockwise from the body gamma",
        "As a tractor_trailer vehicle: no, its input 'tau_steer' steers, and no two inputs are for a right and a left",
    ):
        assert text in printed
    assert "more: --all" not in printed


@pytest.mark.parametrize(
    ("options", "texts"),
    [
        (
            {"fmi": "3.0", "event_mode": True, "intermediate_update": True, "early_return": "allowed", "arrays": True},
            ["event mode", "intermediate update", "may return early from a step", "pose output continuous Float64[4]"],
        ),
        (
            {"fmi": "3.0", "fixed_step": 0.01},
            [
                "constant communication step, fixed internal step of 0.01 s, which must divide the communication step",
                "default experiment start 0 s, stop 2 s, step 0.01 s",
            ],
        ),
        ({"fmi": "3.0", "interface": "model_exchange"}, ["Model Exchange supported", "states 6"]),
        (
            {"once": True, "save": True},
            ["only once per process (each robot then has a process of its own)", ", saved states"],
        ),
        (
            {"execution_tool": True, "variable_step": False},
            ["constant communication step, needs the tool"],
        ),
        ({"fmi": "1.0", "once": True}, ["FMI version 1.0", "Co-Simulation supported", "only once per process"]),
        ({"velocities": False}, ["not offered, but not every controller needs them: v, omega, tau_d_x"]),
    ],
)
def test_capabilities(inspect, tmp_path: Path, options: dict[str, object], texts: list[str]) -> None:
    printed, _ = inspect(make_fmu(tmp_path, **options))
    for text in texts:
        assert text in printed


def test_an_interface_that_cannot_be_used(inspect, tmp_path: Path) -> None:
    fmu = make_fmu(tmp_path, fmi="3.0")
    printed, warned = inspect(rewritten(fmu, tmp_path / "s.fmu", ("<CoSimulation", "<ScheduledExecution")))
    assert "Scheduled Execution not supported" in printed
    assert "is FMI 3.0 Scheduled Execution; expected Co-Simulation or Model Exchange of" in warned


def test_model_exchange_of_fmi_1(inspect, tmp_path: Path) -> None:
    printed, warned = inspect(make_fmu(tmp_path, fmi="1.0", interface="model_exchange"))
    assert "Model Exchange supported" in printed
    assert "As a car_like vehicle: it can be driven as it is" in printed
    assert warned == ""


def test_no_binary_for_this_machine(inspect, tmp_path: Path) -> None:
    printed, warned = inspect(make_broken(tmp_path, "other_platforms"))
    assert " is not among them" in printed
    assert "has no binary for this machine" in warned
    assert "it can be driven as it is" in printed


def test_a_binding_is_proposed(inspect, tmp_path: Path) -> None:
    names = {"x": "pos_x", "psi": "heading", "tau_drive": "drive_torque", "a": "wheelbase"}
    path = make_fmu(tmp_path, names=names, units="deg", initial="parameters")
    printed, _ = inspect(path)
    for text in (
        "As a car_like vehicle: it can be driven with a binding role",
        'x m the rear axle\'s midpoint along X pos_x initial="x0"',
        'psi rad the heading, counter-clockwise from X heading initial="psi0"',
        "tau_drive N.m the drive torque, forward drive_torque",
        f'"formation swap SCENARIO.xml --plant ID={path}" writes the binding to a file',
    ):
        assert text in printed


def test_what_is_to_be_filled_in(inspect, tmp_path: Path) -> None:
    printed, _ = inspect(make_fmu(tmp_path, units="none", drive=False))
    assert "it can be driven with a binding, once it is complete" in printed
    assert "x unit=\"...\" the FMU states no unit of 'x'" in printed
    assert 'value="..." state how the drive torque acts' in printed


def test_many_variables_are_cut_unless_all_are_asked_for(inspect, tmp_path: Path) -> None:
    path = make_fmu(tmp_path, fillers=10_000)
    printed, _ = inspect(path)
    assert "filler_40" in printed
    assert "filler_400" not in printed
    assert "more: --all shows them" in printed
    printed, _ = inspect(path, "--all")
    assert "filler_10000" in printed
    assert "more: --all" not in printed


def test_complaints_of_fmpy_are_warnings(inspect, tmp_path: Path) -> None:
    printed, warned = inspect(make_broken(tmp_path, "undefined_unit"))
    assert "it can be driven as it is" in printed
    (warning,) = (line for line in warned.splitlines() if "unit" in line)  # alike, and so told once
    assert 'undefined_unit.fmu breaks a rule of FMI: The unit "m" of variable "x" (line ' in warning
    assert warning.endswith("more like it)")


def test_two_variables_of_one_name(inspect, tmp_path: Path) -> None:
    printed, warned = inspect(make_broken(tmp_path, "duplicate_names"))
    assert 'The variable name "x"' in warned
    assert 'variable="..."' in printed


@pytest.mark.parametrize("fmi", ["1.0", "2.0", "3.0"])
@pytest.mark.parametrize("kind", BROKEN)
def test_broken_files(inspect, tmp_path: Path, kind: str, fmi: str) -> None:
    path = make_broken(tmp_path, kind, fmi=fmi)
    refused = kind in UNREADABLE
    printed, warned = inspect(path, status=2 if refused else 0)
    if refused:
        assert printed == ""
        assert "error: " in warned
    else:
        assert "As a car_like vehicle" in printed


def test_texts_of_strangers(inspect, tmp_path: Path) -> None:
    evil = 'generationTool="[red]\N{RIGHT-TO-LEFT OVERRIDE}&#x9b;31m [/]'
    path = rewritten(make_fmu(tmp_path), tmp_path / "[blue].fmu", ('generationTool="', evil))
    printed, _ = inspect(path)
    assert "[red]??31m [/]" in printed
    assert "[blue].fmu" in printed


def test_no_file(inspect, tmp_path: Path) -> None:
    _, warned = inspect(tmp_path / "none.fmu", status=2)
    assert "none.fmu cannot be read: there is no such file" in warned


def test_a_folder(inspect, tmp_path: Path) -> None:
    _, warned = inspect(tmp_path, status=2)
    assert "is no unpacked FMU: it holds no modelDescription.xml" in warned


def test_a_time_limit_is_about_the_self_test(inspect, tmp_path: Path) -> None:
    _, refusal = inspect(tmp_path / "none.fmu", "--time-limit", "5", status=2)
    assert refusal == "error: --time-limit is about the reference experiments: add --self-test, or leave it out\n"
