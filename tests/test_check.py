"""``formation check`` shows the content of a scenario, or prints it as a file of its own."""

from pathlib import Path

import pytest

from cosim.cli import main
from cosim.scenario.reader import read_scenario
from cosim.tests.driving import scenario

from .stub.stub import make_fmu


def test_the_overview(scenarios: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(scenarios / "half_power.xml")]) == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert lines[0].endswith("half_power.xml: half_power, 3 followers, 80 s in 4000 steps")
    for line in (
        "robot plant controller place own settings",
        "leader car (car_like) tau_drive 8 N.m, tau_steer 0 N.m",
        "follower_1 car (car_like) pid (neural-adaptive-pid) 2.5 m, 0 deg",
        "follower_2 car (car_like) pid (neural-adaptive-pid) 3 m, 30 deg "
        "actuator: saturation 200 N.m; effectiveness 0.5 (tau_drive) from 35 s",
        "sensor of followers, where no other is shown: noise 0.001 m (x, y); noise 0.001 rad (psi, gamma)",
        "expected: settled by 75 s within 0.1 m, 2 deg",
    ):
        assert line in lines


def test_the_overview_of_what_happens(scenarios: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "v.xml"
    path.write_text(
        f"""<variant xmlns="urn:formation-cosim:scenario:1" name="v" of="{scenarios / "clmr_line.xml"}">
  <title>[bold] and \u202e</title>
  <insert into="follower[1]/desired"><change from="10 s" to="20 s" range="4 m"/></insert>
  <insert into="follower[2]"><parameter name="m_c" value="40 kg"/><sensor/></insert>
  <insert into=".">
    <input name="tau_d_y"><random value="1 N" cutoff="1 Hz"/><sine value="2 N" period="10 s"/></input>
    <event at="50 s" robots="follower_3">
      <parameter name="m_c" value="35 kg"/><input name="tau_d_x" value="1 N"/><stop/>
    </event>
  </insert>
</variant>""",
        encoding="utf-8",
    )
    assert main(["check", str(path)]) == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    for line in (
        "v: [bold] and ?",
        "10 to 20 s: 4 m, 45 deg",
        "follower_2 clmr (car_like) pid (neural-adaptive-pid) 3 m, -45 deg m_c = 40 kg",
        "sensor: none",
        "input tau_d_y: random 1 N + sine 2 N, for every follower",
        "at 50 s, follower_3: m_c = 35 kg, input tau_d_x = 1 N, stops",
        "expected: rms range_error below 0.1 m, 80 to 100 s",
    ):
        assert line in lines


def test_what_is_decided_of_plants(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    roles = '<role name="x" variable="px"/><role name="y" variable="py" factor="-1"/>'
    names = {"x": "px", "y": "py"}
    kinds = {
        "plain": ({}, "", "FMI 2.0 Co-Simulation, supervised"),
        "apart": ({"fmi": "3.0"}, 'isolate="process"', "FMI 3.0 Co-Simulation, its robots in a process of their own"),
        "once": (
            {"once": True},
            "",
            "FMI 2.0 Co-Simulation, each robot in a process of its own, "
            "as it can be instantiated only once in a process",
        ),
        "steps": (
            {"interface": "model_exchange"},
            'solver_step="5 ms"',
            "FMI 2.0 Model Exchange, runge_kutta_4 in steps of 0.005 s, supervised",
        ),
        "cvode": (
            {"interface": "model_exchange"},
            'solver="cvode"',
            "FMI 2.0 Model Exchange, cvode with a tolerance of 1e-06, supervised",
        ),
    }
    plants_ = ""
    for name, (about, attributes, _) in kinds.items():
        fmu = make_fmu(tmp_path / name, names=names, **about)
        plants_ += f'<plant id="{name}" fmu="{fmu}" {attributes}><binding vehicle="car_like">{roles}</binding></plant>'
    plants_ += '<plant id="ours" model="car_like"/><plant id="ours_apart" model="car_like" isolate="process"/>'
    path = scenario(tmp_path / "s.xml", plants_, leader="ours", followers=[*kinds, "ours_apart"])
    assert main(["check", str(path)]) == 0
    printed = capsys.readouterr().out
    for name, (_, _, said) in kinds.items():
        line = f"plant {name}: stub.fmu, {said}; x: px; y: -1 * py; all other roles by their names"
        assert line in printed.splitlines()
    assert "plant ours_apart: its robots in a process of their own" in printed
    assert "plant ours:" not in printed


def test_where_an_fmu_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    path = scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{make_fmu(tmp_path)}" isolate="no"/>')
    assert main(["check", str(path)]) == 0
    assert "FMI 2.0 Co-Simulation, in the harness;" in capsys.readouterr().out
    path.write_text(path.read_text(encoding="utf-8").replace(' isolate="no"', ""), encoding="utf-8")
    monkeypatch.setattr("cosim.master.foreign._SUPERVISES", False)
    assert main(["check", str(path)]) == 0
    assert "FMI 2.0 Co-Simulation, its robots in a process of their own;" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["clmr_line", "half_power"])
def test_what_is_resolved_is_a_scenario_of_its_own(
    scenarios: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    path = scenarios / f"{name}.xml"
    assert main(["check", str(path), "--resolved", "--set", "//simulation/@seed=7"]) == 0
    printed = capsys.readouterr().out
    saved = tmp_path / "saved.xml"
    saved.write_text(printed, encoding="utf-8")
    resolved = read_scenario(saved)
    assert (resolved.name, resolved.seed) == (name, 7)
    assert printed == resolved.text == read_scenario(path, ["//simulation/@seed=7"]).text


def test_a_scenario_is_printed_byte_for_byte(scenarios: Path, capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    path = scenarios / "clmr_line.xml"
    assert main(["check", str(path), "--resolved"]) == 0
    assert capfdbinary.readouterr().out == path.read_bytes()


def test_nothing_is_printed_of_a_bad_scenario(scenarios: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(scenarios / "clmr_line.xml")
    assert main(["check", path, "--resolved", "--set", "//gain[1]/@name=K_P"]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "did you mean 'K_p'?" in printed.err
    assert main(["check", path, path, "--resolved"]) == 2
    assert "--resolved prints one scenario" in capsys.readouterr().err


def test_a_sensor_that_no_follower_has_must_make_sense_too(
    scenarios: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "v.xml"
    path.write_text(
        f"""<variant xmlns="urn:formation-cosim:scenario:1" name="v" of="{scenarios / "clmr_line.xml"}">
  <title>Own sensors</title>
  <insert into="follower"><sensor/></insert>
  <insert into="sensor[1]">
    <dropout probability="1.5"/></insert>
</variant>""",
        encoding="utf-8",
    )
    assert main(["check", str(path)]) == 2
    assert f'{path}:5:5: error: probability="1.5" of <dropout> is not from 0 to 1' in capsys.readouterr().err
