"""The short drive of ``formation swap``: the movements under each input, and contradictions to the names."""

from pathlib import Path

import pytest

from cosim.cli import main

from .stub.stub import make_fmu
from .test_swap import SCENARIO

SWAPPED = {"tau_drive": "steer_torque", "tau_steer": "drive_torque"}
"""Names that say the opposite of what the stub does."""


@pytest.fixture
def printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Return a function that swaps a stub in and returns what is printed, and the binding."""

    def run(*arguments: str, status: int = 0, **options: object) -> tuple[str, str]:
        scenario = tmp_path / "two.xml"
        scenario.write_text(SCENARIO, encoding="utf-8")
        fmu = make_fmu(tmp_path, drive=False, **options)
        assert main(["swap", str(scenario), "--plant", f"car={fmu}", "--force", *arguments]) == status
        binding = tmp_path / "stub.binding.xml"
        return " ".join(capsys.readouterr().out.split()), binding.read_text(encoding="utf-8")

    return run


@pytest.mark.parametrize("fmi", ["1.0", "2.0", "3.0"])
def test_it_shows_what_moves(printed, fmi: str) -> None:
    names = {"tau_drive": "u1", "tau_steer": "u2", "psi": "heading"}
    text, binding = printed(fmi=fmi, names=names, initial="parameters")
    assert "Movement in 1 s, compared with no input" in text
    assert "output u1 = 1 u2 = 1 all together" in text
    assert "gamma 0 0.049 0.049 v 0.1 0 0.1" in text
    assert "short drive" not in binding


def test_what_contradicts_the_names_is_a_doubt(printed) -> None:
    text, binding = printed(names=SWAPPED)
    for role, torque in (("gamma", "steer"), ("v", "drive")):
        assert f"{role}: in a short drive {role!r} does not move under '{torque}_torque' = 1 alone, but {role}" in text
    assert "check names and signs -->" in binding


def test_it_can_be_left_out(printed) -> None:
    text, binding = printed("--no-probe", names=SWAPPED)
    assert "Movement in" not in text
    assert "short drive" not in binding


def test_what_runs_without_doubt_is_not_driven(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cosim.swap.replacement.probed", lambda *_: pytest.fail("nothing is in doubt"))
    scenario = tmp_path / "two.xml"
    scenario.write_text(SCENARIO, encoding="utf-8")
    assert main(["swap", str(scenario), "--plant", f"car={make_fmu(tmp_path)}"]) == 0
    assert "Movement in" not in capsys.readouterr().out


@pytest.mark.parametrize(("behaviour", "reason"), [("segfault", "crashed"), ("error", "did not complete the step")])
def test_an_fmu_that_fails_costs_a_line(printed, behaviour: str, reason: str) -> None:
    text, _ = printed(behaviour=behaviour, when=0.5)
    assert "the short drive to see which outputs move gave no answer: " in text
    assert reason in text
    assert "once the binding is complete" in text


def test_nothing_moves(printed) -> None:
    text, binding = printed(behaviour="nothing", when=0.0)
    assert "outputs that do not move: x, y, psi, gamma, v, omega" in text
    assert "short drive" not in binding, "which tells nothing of one role"
