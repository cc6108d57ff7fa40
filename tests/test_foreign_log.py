"""Messages of a failing FMU of PythonFMU: it names its exception only with full logging."""

from pathlib import Path

import pytest

from cosim.cli import main

from .foreign import vehicles

BINDING = """<binding xmlns="urn:formation-cosim:scenario:1" vehicle="car_like">
  <role name="x" variable="pos_x" unit="m" initial="x0"/>
  <role name="y" variable="pos_y" unit="m" initial="y0"/>
  <role name="psi" variable="heading" unit="deg" initial="heading0"/>
  <role name="gamma" variable="steer" unit="deg" initial="steer0"/>
  <role name="v" variable="speed" unit="km/h"/>
  <role name="omega" variable="steer_rate" unit="deg/s"/>
  <role name="tau_drive" variable="drive_torque" unit="N.m"/>
  <role name="tau_steer" variable="steer_torque" unit="N.m"/>
  <role name="a" variable="wheelbase" unit="mm"/>
  <role name="drive" value="as_printed"/>
</binding>
"""


@pytest.mark.parametrize(
    ("log", "said"),
    [("", 'the FMU gives no reason; log="on" in its <plant> may show one'), ('log="on"', "out of fuel")],
    ids=["off", "on"],
)
def test_log(tmp_path: Path, scenarios: Path, capsys: pytest.CaptureFixture[str], log: str, said: str) -> None:
    vehicles.require("pythonfmu")
    source = (vehicles.HERE / "rover.py").read_text(encoding="utf-8")
    step = source.index("        axles = ")
    broken = (
        source[:step] + '        if current_time > 0.19:\n            raise ValueError("out of fuel")\n' + source[step:]
    )
    (tmp_path / "rover.py").write_text(broken, encoding="utf-8")
    vehicles.run(tmp_path, "Rover.fmu", "-m", "pythonfmu", "build", "-f", "rover.py", "-d", ".")
    (tmp_path / "rover.xml").write_text(BINDING, encoding="utf-8")
    files = f'fmu="{tmp_path}/Rover.fmu" binding="{tmp_path}/rover.xml"'
    (tmp_path / "broken.xml").write_text(
        f"""<variant xmlns="urn:formation-cosim:scenario:1" name="broken" of="{scenarios / "clmr_line.xml"}">
  <title>Breaks down</title>
  <replace select="plant"><plant id="clmr" {files} isolate="process" {log}/></replace>
</variant>
""",
        encoding="utf-8",
    )
    assert main(["run", str(tmp_path / "broken.xml"), "--out", str(tmp_path), "--no-figure"]) == 3
    printed = " ".join(capsys.readouterr().err.split())
    assert "leader at t = 0.2 s: the plant Rover.fmu did not complete the step (status Fatal)" in printed
    assert said in printed
