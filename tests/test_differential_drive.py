"""The differential-drive robot at the command line: it can do all that the other two kinds can."""

from pathlib import Path

import pytest

import cosim
import plants
from cosim.cli import main


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return plants.build("differential_drive", out=tmp_path_factory.mktemp("fmus"))


def test_it_is_inspected(robot: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", str(robot)]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "As a differential_drive vehicle: it can be driven as it is" in printed
    assert "As a car_like vehicle: no, " in printed


def test_it_is_compared_with_itself(robot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["compare-plants", str(robot), str(robot), "--within", "1 mm", "--out", str(tmp_path)]
    assert main(arguments) == 0
    heavier = [*arguments, "--parameter-b", "m_c=60 kg"]
    assert main(heavier) == 1, "a heavier robot moves otherwise"


def test_it_is_swapped_in_a_scenario(robot: Path, scenarios: Path, tmp_path: Path) -> None:
    own, swapped = scenarios / "differential_drive.xml", tmp_path / "swapped.xml"
    assert main(["swap", str(own), "--plant", f"robot={robot}", "--out", str(swapped)]) == 0
    built_in, foreign = (cosim.run(path, horizon=2.0, expectations=False) for path in (own, swapped))
    assert built_in["pose"].identical(foreign["pose"])
    assert list(built_in["pose_component"].values) == ["x", "y", "theta"]
