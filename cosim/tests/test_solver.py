"""Checks before the start that an FMU fits solver and communication step: refusals and warnings."""

from pathlib import Path

import pytest

import cosim
from cosim.cli import main
from tests.fmus import rewritten
from tests.stub.stub import make_fmu

from .driving import scenario


def checked(path: Path, capsys: pytest.CaptureFixture[str], status: int = 0) -> str:
    assert main(["check", str(path)]) == status
    return capsys.readouterr().err


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_a_constant_step_that_does_not_fit_is_told(
    tmp_path: Path, fmi: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """FMI 2.0 cannot state a fixed step; the default experiment hints at one, and the run may still succeed."""
    fmu = make_fmu(tmp_path, fmi=fmi, variable_step=False)
    path = scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{fmu}"/>', step="50 ms")
    said = "plant car: stub.fmu takes steps of constant length only, and of 0.02 s in its default experiment, which do "
    said += 'not divide the communication step of 0.05 s: if it does not complete its steps, state step="0.02 s" or a'
    said += " multiple in <simulation>, or try it with --set 'simulation/@step=0.02 s' of formation run, "
    assert checked(path, capsys) == f"warning: {said}--step '0.02 s' of compare-plants\n"
    cosim.run(path)
    for other in ("20 ms", "100 ms"):
        assert checked(scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{fmu}"/>', step=other), capsys) == ""
    free = make_fmu(tmp_path / "free", fmi=fmi)
    assert checked(scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{free}"/>', step="50 ms"), capsys) == ""


def test_a_model_exchange_fmu_takes_any_step(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fmu = make_fmu(tmp_path, interface="model_exchange")
    assert checked(scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{fmu}"/>', step="50 ms"), capsys) == ""


def clocked(folder: Path, clock: str, **options: str) -> Path:
    fmu = make_fmu(folder, fmi="3.0", **options)
    clock = f'<Clock name="tick" valueReference="900" {clock}/>'
    return rewritten(fmu, folder / "clocked.fmu", ("<ModelVariables>", f"<ModelVariables>{clock}"))


@pytest.mark.parametrize("interface", ["co_simulation", "model_exchange"])
def test_clocks_that_the_importer_must_let_tick(
    tmp_path: Path, interface: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Told by the file alone, not at the start."""
    fmu = clocked(
        tmp_path, 'causality="input" intervalVariability="constant" intervalDecimal="0.1"', interface=interface
    )
    said = "clocked.fmu has the input clock 'tick', which the importer must tick: input clocks are not supported here"
    assert said in checked(scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{fmu}"/>'), capsys, status=2)
    assert main(["inspect", str(fmu)]) == 0
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("causality", ["input", "output"])
def test_clocks_that_need_not_tick(tmp_path: Path, causality: str) -> None:
    fmu = clocked(tmp_path, f'causality="{causality}" intervalVariability="triggered"')
    result = cosim.run(scenario(tmp_path / "s.xml", f'<plant id="car" fmu="{fmu}"/>'))
    assert result.attrs["status"] == "completed"
