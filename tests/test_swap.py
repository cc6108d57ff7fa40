"""``formation swap``: the variant runs, parts that do not carry over are listed, and nothing is overwritten unasked."""

import os
from pathlib import Path

import numpy as np
import pytest

import cosim
import plants
from cosim.cli import main
from cosim.scenario.reader import read_binding, read_scenario

from .commands import command
from .fmus import NAMES, renamed
from .stub.stub import make_fmu
from .two_followers import two_followers

SCENARIO = two_followers(
    """<plant id="car" model="car_like">
    <parameter name="m_c" value="31 kg"/>
    <parameter name="a" value="1.3 m"/>
    <parameter name="drive" value="rear_wheel"/>
  </plant>
  <plant id="other" model="car_like"/>""",
    team='<sensor><noise x="1 mm" y="1 mm"/></sensor><input name="tau_d_x"><constant value="1 N"/></input>',
    leader='<parameter name="m_c" value="32 kg"/><parameter name="d_x" value="26 N.s/m"/>',
    one="""<parameter name="a" value="1.4 m"/>
    <input name="tau_d_y"><constant value="2 N"/></input><input name="tau_steer"><constant value="0.1 N.m"/></input>""",
    second_plant="other",
    end="""<event at="1 s" robots="one two">
    <parameter name="m_c" value="45 kg"/><parameter name="d_x" value="27 N.s/m"/>
  </event>""",
)


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    path = tmp_path / "scenarios" / "two.xml"
    path.parent.mkdir()
    path.write_text(SCENARIO, encoding="utf-8")
    return path


@pytest.fixture
def swap(capsys: pytest.CaptureFixture[str]):
    """Return a function that swaps and returns what is printed to standard output and to standard error."""

    def run(*arguments: object, status: int = 0) -> tuple[str, str]:
        return command(capsys, "swap", *arguments, status=status)

    return run


def simplified(path: Path, *removed: str) -> Path:
    """Remove the parts of the scenario that an FMU will lack."""
    text = path.read_text(encoding="utf-8")
    for piece in removed:
        assert piece in text
        text = text.replace(piece, "")
    path.write_text(text, encoding="utf-8")
    return path


# What works -------------------------------------------------------------------------------------------------


def test_what_is_written_runs_and_moves_as_the_original(swap, scenario: Path, tmp_path: Path) -> None:
    """The FMU is ours under other names; its mass is no role, so that the original must not change it either."""
    simplified(scenario, '<parameter name="m_c" value="31 kg"/>', '<parameter name="m_c" value="32 kg"/>')
    simplified(
        scenario, '<parameter name="m_c" value="45 kg"/>', '<input name="tau_d_y"><constant value="2 N"/></input>'
    )
    fmu = renamed(tmp_path / "fmus" / "vendor.fmu")
    printed, warned = swap(scenario, "--plant", f"car={fmu}")
    written = scenario.with_name("two_vendor.xml")
    assert printed.splitlines() == [
        f"wrote {scenario.with_name('vendor.binding.xml')}",
        f"wrote {written}",
        f"next, to run it: formation run {written}",
    ]
    assert warned == ""
    text = written.read_text(encoding="utf-8")
    assert 'of="two.xml"' in text
    assert 'fmu="../fmus/vendor.fmu" binding="vendor.binding.xml"' in text
    before, after = cosim.run(scenario), cosim.run(written)
    for name in ("leader_pose", "pose", "torque"):
        np.testing.assert_array_equal(before[name], after[name])
    assert main(["check", str(written)]) == 0


def test_what_does_not_carry_over_is_left_out_and_said(swap, scenario: Path, tmp_path: Path) -> None:
    fmu = renamed(tmp_path / "vendor.fmu", NAMES | {"tau_d_x": "Wind.longitudinal"})
    _, warned = swap(scenario, "--plant", f"car={fmu}")
    assert " ".join(warned.split()) == (
        "warning: Left out, as vendor.fmu has no such parameter: plant car: m_c = 31 kg; leader: m_c = 32 kg; "
        "one at 1 s: m_c = 45 kg "
        "warning: Left out, as vendor.fmu has no such input: one: tau_d_y, tau_d_x"
    )
    changed = read_scenario(scenario.with_name("two_vendor.xml"))
    assert {setting.name: setting.value for setting in changed.plants["car"].parameters} == {
        "a": "1.3 m",
        "drive": "rear_wheel",
    }
    assert [setting.name for setting in changed.leader.parameters] == ["d_x"]
    one, two = changed.followers
    assert [setting.name for setting in one.parameters] == ["a"]
    assert [source.name for source in one.inputs] == ["tau_steer"]
    assert [source.name for source in two.inputs] == ["tau_d_x"]
    assert changed.inputs == ()
    assert {(event.robot, setting.name) for event in changed.events for setting in event.parameters} == {
        ("one", "d_x"),
        ("two", "m_c"),
        ("two", "d_x"),
    }
    result = cosim.run(changed)
    assert result.attrs["status"] == "completed"
    assert "one at 1 s: m_c = 45 kg" in " ".join(changed.text.split())


def test_what_contradicts_a_constant_of_the_binding_is_left_out(swap, scenario: Path, tmp_path: Path) -> None:
    fmu = renamed(tmp_path / "vendor.fmu", NAMES | {"tau_d_x": "Wind.longitudinal", "drive": "kind"})
    roles = "".join(f'<role name="{role}" variable="{name}"/>' for role, name in NAMES.items() if role != "m_c")
    for constant, reason in (
        ("rear_wheel", None),
        (
            "as_printed",
            "as 'rear_wheel' contradicts the binding, which states as_printed: plant car: drive = rear_wheel",
        ),
    ):
        binding = tmp_path / f"{constant}.xml"
        binding.write_text(
            '<binding xmlns="urn:formation-cosim:scenario:1" vehicle="car_like">'
            f'{roles}<role name="drive" value="{constant}"/></binding>'
        )
        _, warned = swap(scenario, "--plant", f"car={fmu}", "--binding", f"car={binding}", "--force")
        assert ("drive" in warned) == (reason is not None)
        assert (reason or "") in " ".join(warned.split())


def test_a_folder_is_no_file(swap, scenario: Path, tmp_path: Path) -> None:
    _, warned = swap(scenario, "--plant", f"car={renamed(tmp_path / 'v.fmu')}", "--out", tmp_path, "--force", status=2)
    assert f"--out {tmp_path} is a folder: name the file of the variant, such as {tmp_path / 'swapped.xml'}" in warned


def test_an_event_of_which_nothing_is_left_is_removed(swap, scenario: Path, tmp_path: Path) -> None:
    simplified(scenario, '<parameter name="d_x" value="27 N.s/m"/>')
    fmu = renamed(tmp_path / "vendor.fmu")
    swap(scenario, "--plant", f"car={fmu}", "--plant", f"other={fmu}")
    assert read_scenario(scenario.with_name("two_vendor.xml")).events == ()


def test_a_parameter_keeps_the_name_of_its_role(swap, scenario: Path, tmp_path: Path) -> None:
    """As the binding knows the unit, which the FMU does not state."""
    swap(scenario, "--plant", f"car={make_fmu(tmp_path, units='none', names={'a': 'wheelbase'})}")
    text = scenario.with_name("two_stub.xml").read_text(encoding="utf-8")
    assert '<parameter name="a" value="1.3 m"/>' in text
    assert "follower[@id='one']/parameter" not in text


def test_another_parameter_of_the_name_of_a_role(swap, scenario: Path, tmp_path: Path) -> None:
    """The scenario's a is Wheelbase in the FMU, which has another a."""
    fmu = renamed(tmp_path / "vendor.fmu", {"a": "wheelbase", "I_c": "a"})
    swap(scenario, "--plant", f"car={fmu}")
    written = read_scenario(scenario.with_name("two_vendor.xml"))
    assert "wheelbase" in [setting.name for setting in written.plants["car"].parameters]
    assert [setting.name for setting in written.followers[0].parameters] == ["wheelbase"]


def test_no_binding_where_none_is_needed(swap, scenario: Path, tmp_path: Path) -> None:
    fmu = plants.build("car_like", out=tmp_path)
    printed, warned = swap(scenario, "--plant", f"car={fmu}")
    assert "car_like.fmu needs no binding" in printed
    assert warned == ""
    assert sorted(path.name for path in scenario.parent.iterdir()) == ["two.xml", "two_car_like.xml"]
    np.testing.assert_array_equal(
        cosim.run(scenario)["pose"], cosim.run(scenario.with_name("two_car_like.xml"))["pose"]
    )


def test_a_binding_that_is_there_is_used(swap, scenario: Path, tmp_path: Path) -> None:
    fmu = renamed(tmp_path / "vendor.fmu")
    binding = tmp_path / "mine.xml"
    roles = "".join(f'<role name="{role}" variable="{name}"/>' for role, name in NAMES.items() if role != "m_c")
    binding.write_text(f'<binding xmlns="urn:formation-cosim:scenario:1" vehicle="car_like">{roles}</binding>')
    printed, warned = swap(scenario, "--plant", f"car={fmu}", "--binding", f"car={binding}")
    assert "mine.xml" not in printed
    assert "tau_d_y" not in warned, "it is a role in this binding"
    assert not list(tmp_path.rglob("vendor.binding.xml"))
    assert 'binding="../mine.xml"' in scenario.with_name("two_vendor.xml").read_text(encoding="utf-8")


def test_what_is_open_is_said_and_refused_until_it_is_filled_in(
    swap, scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fmu = make_fmu(tmp_path / "fmus", units="none", drive=False, names={"psi": "heading"}, initial="parameters")
    out = tmp_path / "elsewhere" / "mine.xml"
    out.parent.mkdir()
    printed, _ = swap(scenario, "--plant", f"car={fmu}", "--out", out)
    binding = out.with_name("stub.binding.xml")
    assert f"to fill in, in {binding}:\n  x: the FMU states no unit of 'x'" in printed
    assert "  drive: state how the drive torque acts" in printed
    assert f"next, once the binding is complete: formation check {out}" in printed
    assert main(["check", str(out)]) == 2
    printed = capsys.readouterr().err
    assert printed.startswith(f"{binding}:")
    assert """error: the role 'x' has unit="...", which is to be filled in""" in printed

    text = binding.read_text(encoding="utf-8")
    for role, unit in {
        "x": "m",
        "y": "m",
        "psi": "rad",
        "gamma": "rad",
        "v": "m/s",
        "omega": "rad/s",
        "tau_drive": "N.m",
    }.items():
        lines = [line.replace('"..."', f'"{unit}"') if f'name="{role}"' in line else line for line in text.splitlines()]
        text = "\n".join(lines)
    text = text.replace(
        'name="tau_steer" variable="tau_steer" unit="..."', 'name="tau_steer" variable="tau_steer" unit="N.m"'
    )
    text = text.replace('name="a" variable="a" unit="..."', 'name="a" variable="a" unit="m"').replace(
        'value="..."', 'value="rear_wheel"'
    )
    assert '"..."/>' not in text
    binding.write_text(text, encoding="utf-8")
    assert main(["check", str(out)]) == 0
    result = cosim.run(out)
    assert float(result["pose"].sel(robot="one", pose_component="x")[0]) == -5.0


@pytest.mark.parametrize(
    ("names", "reason"),
    [
        (
            {"tau_drive": "motor_right", "tau_steer": "motor_left", "gamma": "battery"},
            "as a car_like vehicle, its inputs 'motor_right' and 'motor_left' are for a right and a left wheel, and no "
            "input steers. If that is wrong, assign its variables to roles with --binding car=FILE.xml",
        ),
        ({"tau_steer": "der(tau)"}, "it has only 'tau_drive' that could be a torque, in N.m, N, a pure number or"),
    ],
)
def test_another_kind_of_vehicle_is_refused(
    swap, scenario: Path, tmp_path: Path, names: dict[str, str], reason: str
) -> None:
    fmu = make_fmu(tmp_path, names=names)
    printed, warned = swap(scenario, "--plant", f"car={fmu}", status=2)
    assert f"error: the FMU {fmu} cannot be the plant 'car': as a car_like vehicle, " in warned
    assert reason in warned
    assert printed == ""
    assert [path.name for path in scenario.parent.iterdir()] == ["two.xml"]
    assert main(["inspect", str(fmu)]) == 0


def test_what_the_check_refuses_is_said(swap, scenario: Path, tmp_path: Path) -> None:
    fmu = make_fmu(tmp_path, velocities=False)
    printed, warned = swap(scenario, "--plant", f"car={fmu}", status=2)
    assert "wrote " in printed
    assert "offers no v and no omega, but its followers need the leader's velocities" in warned


def test_a_variant_is_swapped_too(swap, scenario: Path, tmp_path: Path) -> None:
    variant = scenario.with_name("longer.xml")
    variant.write_text(
        '<variant xmlns="urn:formation-cosim:scenario:1" name="longer" of="two.xml"><title>Longer</title>'
        '<set select="simulation/@horizon" value="3 s"/></variant>',
        encoding="utf-8",
    )
    swap(variant, "--plant", f"car={renamed(tmp_path / 'vendor.fmu')}")
    changed = read_scenario(scenario.with_name("longer_vendor.xml"))
    assert changed.horizon == 3.0
    assert changed.title == "Longer; car: vendor.fmu"


def test_what_is_asked_of_isolation_stays(swap, scenario: Path, tmp_path: Path) -> None:
    text = scenario.read_text(encoding="utf-8")
    scenario.write_text(
        text.replace('id="car" model="car_like"', 'id="car" model="car_like" isolate="process" time_limit="3 s"')
    )
    swap(scenario, "--plant", f"car={renamed(tmp_path / 'vendor.fmu')}")
    plant = read_scenario(scenario.with_name("two_vendor.xml")).plants["car"]
    assert plant.isolated
    assert plant.time_limit == 3.0


@pytest.mark.skipif(os.name != "posix", reason="needs symbolic links")
def test_paths_through_a_link(swap, scenario: Path, tmp_path: Path) -> None:
    deep = tmp_path / "a" / "b" / "c"
    deep.mkdir(parents=True)
    link = tmp_path / "link"
    link.symlink_to(deep)
    swap(scenario, "--plant", f"car={renamed(tmp_path / 'vendor.fmu')}", "--out", link / "mine.xml")
    assert main(["check", str(link / "mine.xml")]) == 0
    assert main(["check", str(deep / "mine.xml")]) == 0


def test_a_binding_is_not_listed_as_a_scenario(
    swap, scenario: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    swap(scenario, "--plant", f"car={renamed(tmp_path / 'vendor.fmu')}")
    monkeypatch.chdir(tmp_path)
    assert main(["list"]) == 0
    printed = capsys.readouterr().out
    assert "two_vendor.xml" in printed
    assert "vendor.binding.xml" not in printed


# Bad input --------------------------------------------------------------------------------------------------


def test_nothing_is_overwritten_unasked(swap, scenario: Path, tmp_path: Path) -> None:
    fmu = renamed(tmp_path / "vendor.fmu")
    arguments = (scenario, "--plant", f"car={fmu}", "--out", tmp_path / "mine.xml")
    binding = tmp_path / "vendor.binding.xml"
    binding.write_text("mine")
    printed, warned = swap(*arguments, status=2)
    assert printed == ""
    assert warned == f"error: {binding} exists: --force overwrites it, --binding car={binding} takes it unchanged\n"
    assert binding.read_text() == "mine"
    assert not (tmp_path / "mine.xml").exists(), "all or nothing"
    swap(*arguments, "--force")
    assert read_binding(binding).vehicle == "car_like"
    _, warned = swap(*arguments[:-1], tmp_path / "mine.xml", "--binding", f"car={binding}", status=2)
    assert warned == f"error: {tmp_path / 'mine.xml'} exists: --force overwrites it, --out names another file\n"


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--plant", "cat={fmu}"], "has no plant 'cat': did you mean 'car'? Known: car, other"),
        (["--plant", "car"], "--plant car: expected ID=FILE.fmu"),
        (["--plant", "car={fmu}", "--binding", "other={fmu}"], "there is a binding for the plant 'other', but no FMU"),
        (["--plant", "car={folder}/none.fmu"], "none.fmu cannot be read: there is no such file"),
        (["--plant", "car={scenario}"], "is not an FMU: File is not a zip file"),
        (["--plant", "car={fmu}", "--out", "{scenario}"], "is the scenario itself"),
        (["--plant", "car={fmu}", "--out", "{folder}/none/a.xml"], "cannot be written: No such file or directory"),
        (["--plant", "car={fmu}", "--binding", "car={scenario}"], "this is a scenario: "),
        (["--plant", "car={fmu}", "--binding", "car={folder}/none.xml"], "there is no such file"),
    ],
)
def test_bad_input(swap, scenario: Path, tmp_path: Path, options: list[str], sentence: str) -> None:
    fmu = renamed(tmp_path / "vendor.fmu")
    filled = [option.format(fmu=fmu, folder=tmp_path, scenario=scenario) for option in options]
    _, warned = swap(scenario, *filled, status=2)
    assert sentence in warned
    assert [path.name for path in scenario.parent.iterdir()] == ["two.xml"]


def test_a_bad_scenario(swap, tmp_path: Path) -> None:
    _, warned = swap(tmp_path / "none.xml", "--plant", "car=a.fmu", status=2)
    assert "none.xml: error: there is no such file" in warned


def test_two_fmus_of_one_name(swap, scenario: Path, tmp_path: Path) -> None:
    one, other = renamed(tmp_path / "1" / "v.fmu"), renamed(tmp_path / "2" / "v.fmu", NAMES | {"psi": "heading"})
    _, warned = swap(scenario, "--plant", f"car={one}", "--plant", f"other={other}", status=2)
    assert "two FMUs would have the binding" in warned


def test_the_other_kind_of_our_vehicles_is_refused(swap, scenario: Path, tmp_path: Path) -> None:
    fmu = plants.build("tractor_trailer", out=tmp_path)
    _, warned = swap(scenario, "--plant", f"car={fmu}", status=2)
    assert "as a car_like vehicle, its inputs 'tau_right' and 'tau_left' are for a right and a left wheel" in warned


def test_velocities_under_names_that_tell_nothing(
    swap, scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fmu = make_fmu(tmp_path, names={"v": "Tempo", "omega": "rates[2]"})
    printed, warned = swap(scenario, "--plant", f"car={fmu}", status=2)
    assert '\'Tempo\' could be it; if so, add <role name="v" variable="Tempo"/>' in printed
    assert "offers no v and no omega, but its followers need the leader's velocities" in warned
    assert '\'rates[2]\' could be omega: add to the binding <role name="omega" variable="rates[2]"/>' in warned
    assert main(["inspect", str(fmu)]) == 0
    assert "'rates[2]'" in " ".join(capsys.readouterr().out.split())
    binding = scenario.with_name("stub.binding.xml")
    text = binding.read_text(encoding="utf-8")
    roles = '<role name="v" variable="Tempo"/><role name="omega" variable="rates[2]"/>'
    binding.write_text(text.replace("</binding>", f"{roles}</binding>"), encoding="utf-8")
    assert main(["check", str(scenario.with_name("two_stub.xml"))]) == 0


def test_a_name_that_no_path_in_xml_can_have(swap, scenario: Path, tmp_path: Path) -> None:
    path = renamed(tmp_path / "line\nbreak.fmu")
    _, warned = swap(scenario, "--plant", f"car={path}", status=2)
    assert "its white space would not be kept" in warned


def test_names_with_two_spaces(swap, scenario: Path, tmp_path: Path) -> None:
    """Of a file, and of a variable that a binding names."""
    path = renamed(tmp_path / "two  spaces.fmu", {"psi": "yaw  angle"})
    swap(scenario, "--plant", f"car={path}")
    variant = scenario.with_name(f"{scenario.stem}_two  spaces.xml")
    binding = scenario.with_name("two  spaces.binding.xml")
    assert 'variable="yaw  angle"' in binding.read_text("utf-8")
    binding.write_text(binding.read_text("utf-8").replace('value="..."', 'value="as_printed"'), "utf-8")
    assert main(["check", str(variant)]) == 0
