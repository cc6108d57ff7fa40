"""The message about a fault in a user's control law names file and line of that law."""

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import cosim
from cosim.cli import main

from .commands import failed

LAW = '''"""A law of one's own."""

from dataclasses import dataclass

import numpy as np
from formation_controllers import Signal
from formation_controllers.controller import Controller
from formation_controllers.gains import Gains, gain


@dataclass(frozen=True)
class MyGains(Gains):
    K: float = gain(1.0, "K", "N/m", "a gain", above=0)


class MyLaw(Controller[MyGains]):
    interface = "1.1"
    vehicles = ("car_like", "tractor_trailer")
    gains_type = MyGains
    signals = (Signal("det_R", "1", "determinant of R", (), "it cannot be steered"),)

    def state_shapes(self):
        return {}

    def on_start(self, pose, leader, desired):
        pass

    def on_step(self, pose, leader, desired):
        return torques(pose)


def torques(pose):
    return np.zeros((len(pose), 2))
'''


@pytest.fixture
def law(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., str]]:
    """Return a function that installs the law with a part replaced, and returns FILE:LINE of a text in it."""
    site = tmp_path / "site"
    about = site / "my_law-1.0.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: my-law\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[formation.controllers]\nmine = my_law:MyLaw\n")
    monkeypatch.syspath_prepend(str(site))

    def install(old: str, new: str, marked: str) -> str:
        assert old in LAW
        text = LAW.replace(old, new)
        (site / "my_law.py").write_text(text)
        number = next(n for n, line in enumerate(text.splitlines(), start=1) if marked in line)
        return f"{site / 'my_law.py'}:{number}"

    yield install
    sys.modules.pop("my_law", None)


@pytest.fixture
def fails(scenarios: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    def run(status: int, *options: str) -> str:
        line = str(scenarios / "clmr_line.xml")
        arguments = ["run", line, "--controller", "pid=mine", "--out", str(tmp_path / "runs"), "--no-figure", *options]
        return failed(capsys, status, *arguments)

    return run


@pytest.mark.parametrize(
    ("old", "new", "marked", "sentence"),
    [
        ("np.zeros((len(pose), 2))", "[1 // 0]", "1 // 0", "ZeroDivisionError: integer division or modulo by zero"),
        ("np.zeros((len(pose), 2))", "np.linalg.inv(np.zeros((2, 2)))", "linalg", "LinAlgError: Singular matrix"),
        ("        pass", "        self.pose = pose.nowhere", "nowhere", "AttributeError: "),
        ("on_step(self, pose, leader, desired)", "on_step(self, pose)", "class MyLaw", "MyLaw.on_step() takes 2 posi"),
    ],
    ids=["in a helper", "in a library", "at the start", "called"],
)  # fmt: skip
def test_a_law_that_fails_in_a_run(law, fails, old: str, new: str, marked: str, sentence: str) -> None:
    place = law(old, new, marked)
    printed = fails(3)
    assert "at t = 0 s: the controller 'mine' failed: " in printed
    assert sentence in printed
    assert printed.strip().endswith(f", at {place}")


@pytest.mark.parametrize(
    ("old", "new", "marked", "sentence"),
    [
        ("        return {}", "        return {}[1]", "{}[1]", "controller 'pid': KeyError: 1"),
        ("import numpy as np", "import numpi as np", "numpi", "cannot be imported: No module named 'numpi'"),
        ("np.zeros(", "np.zeros((", "np.zeros((", "cannot be imported: '(' was never closed"),
    ],
)
def test_a_law_that_cannot_be_started(law, fails, old: str, new: str, marked: str, sentence: str) -> None:
    place = law(old, new, marked)
    printed = fails(2)
    assert sentence in printed
    assert printed.strip().endswith(f", at {place}")


def test_a_law_that_writes_to_what_it_gets_changes_nothing(law, scenarios: Path, tmp_path: Path) -> None:
    """Neither what is recorded and judged, nor what another law gets."""
    text = (scenarios / "clmr_line.xml").read_text(encoding="utf-8")
    begin, end = text.index("<controller"), text.index("</controller>") + len("</controller>")
    mine = 'name="mine" package="my-law" version="==1.0"'
    both = "".join(
        f'<controller id="{name}" {mine}><gain name="K" value="{gain}"/></controller>'
        for name, gain in (("writes", 2), ("pid", 1))
    )
    text = text[:begin] + both + text[end:].replace('controller="pid"', 'controller="writes"', 2)
    scenario = tmp_path / "mine.xml"
    scenario.write_text(text, encoding="utf-8")
    results = []
    for write in ("pass", "leader.pose[0] += 100; leader.velocity[:] = 1e3; desired.q[:] = 1e3; pose[:] = 1e3"):
        step = f"""
        command = desired.q * leader.velocity[0] + leader.pose[0]
        if self.robot_gains[0].K == 2:
            {write}
        return command
"""
        law("\n        return torques(pose)\n", step, "on_step")
        sys.modules.pop("my_law", None)
        results.append(cosim.run(scenario, horizon=0.2, expectations=False))
    for name in ("range_error", "bearing_error", "torque", "pose", "leader_pose"):
        np.testing.assert_array_equal(results[1][name], results[0][name], err_msg=name)


def test_gains_that_fail(law, scenarios: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    check = "\n\n    def __post_init__(self):\n        super().__post_init__()\n        assert self.K < 2, 'too much'\n"
    place = law("above=0)\n", "above=0)" + check, "assert")
    text = (scenarios / "clmr_line.xml").read_text(encoding="utf-8")
    begin, end = text.index("<controller"), text.index("</controller>")
    mine = '<controller id="pid" name="mine" package="my-law" version="==1.0"><gain name="K" value="3"/>'
    scenario = tmp_path / "mine.xml"
    scenario.write_text(text[:begin] + mine + text[end:], encoding="utf-8")
    assert main(["check", str(scenario)]) == 2
    printed = capsys.readouterr().err
    assert printed.strip().endswith(f"error: controller 'pid': AssertionError: too much, at {place}")


@pytest.mark.parametrize("command", ["check", "run"])
def test_a_vehicle_that_a_law_does_not_serve(
    law, scenarios: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    law("", "", "class MyLaw")
    scenario = str(scenarios / "differential_drive.xml")
    to_runs = ["--out", str(tmp_path / "runs")] if command == "run" else []
    printed = failed(capsys, 2, command, scenario, "--controller", "pid=mine", *to_runs)
    assert printed.startswith(f"{scenario}:")
    assert "the controller 'mine' serves vehicles of kind car_like, tractor_trailer, not differential_drive" in printed
