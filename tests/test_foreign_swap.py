"""Vehicles made by foreign tools, swapped in: facts without a proposal are asked for, then they move as ours does."""

import re
from pathlib import Path

import pytest

import cosim
from cosim.cli import main
from cosim.fmu.package import open_package
from cosim.scenario.scenario import OPEN
from cosim.swap.proposal import proposals

from .foreign.vehicles import VEHICLES, Vehicle, require

# What the proposals find, of the variables in the table of the vehicles; and what only their vendors know.
FOUND = {
    "pythonfmu": {"x", "y", "psi", "gamma", "v", "omega", "tau_drive", "tau_steer", "a"},
    "pythonfmu3": {"psi", "gamma", "tau_drive", "tau_steer", "a"},  # x and y are there, in the other order
    "casadi": {"x", "y", "psi", "gamma", "v", "omega", "tau_drive", "tau_steer", "a"},
    "repackaged": {"x", "y", "psi", "gamma", "v", "omega", "tau_drive", "tau_steer", "a"},
    "repackaged_3": {"x", "y", "psi", "gamma", "v", "omega", "tau_drive", "tau_steer", "a"},
}
OPEN_ROLES = {
    "pythonfmu": {"x", "y", "psi", "gamma", "v", "omega", "tau_drive", "tau_steer", "a", "drive"},  # it has no units
    "pythonfmu3": {"drive"},
    "casadi": {"drive"},
    "repackaged": set(),
    "repackaged_3": set(),
}
DOUBTFUL = {"pythonfmu3": {"x", "y", "psi", "gamma", "tau_steer"}}


@pytest.fixture(scope="module", params=VEHICLES)
def name(request: pytest.FixtureRequest) -> str:
    require(VEHICLES[request.param].tool)
    return str(request.param)


@pytest.fixture(scope="module")
def vehicle(name: str) -> Vehicle:
    return VEHICLES[name]


@pytest.fixture(scope="module")
def fmu(vehicle: Vehicle, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return vehicle.build(tmp_path_factory.mktemp("foreign"))


def filled_in(binding: str, vehicle: Vehicle) -> str:
    """Return a binding with units, signs, offsets and elements from the table of the vehicles."""
    for name, role in vehicle.roles.items():
        variable = role.name if role.element is None else f"{role.name}[{role.element + 1}]"
        attributes = f'variable="{variable}"'
        if role.declared == "missing":
            attributes += f' unit="{role.unit}"'
        if role.start is not None:
            attributes += f' initial="{role.start}"'
        if role.sign < 0:  # the value is sign * (variable - offset)
            attributes += f' factor="-1" offset="{role.offset} {role.unit}"'
        binding, number = re.subn(rf'<role name="{name}" [^>]*/>', f'<role name="{name}" {attributes}/>', binding)
        assert number == 1
    return binding.replace(f'value="{OPEN}"', 'value="as_printed"')


def test_what_is_proposed(name: str, vehicle: Vehicle, fmu: Path) -> None:
    package = open_package(fmu)
    try:
        proposal = proposals(package.description)[0]
    finally:
        package.close()
    assert proposal.kind.name == "car_like"
    assert not proposal.missing
    sources = {suggestion.role.name: suggestion.source for suggestion in proposal.suggestions if suggestion.source}
    assert {
        role
        for role, variable in vehicle.roles.items()
        if sources[role].variable
        == (variable.name if variable.element is None else f"{variable.name}[{variable.element + 1}]")
        and (sources[role].initial or None) == (variable.start if role in ("x", "y", "psi", "gamma") else None)
    } == FOUND[name]
    assert {suggestion.role.name for suggestion in proposal.open} == OPEN_ROLES[name]
    assert {suggestion.role.name for suggestion in proposal.doubts} == DOUBTFUL.get(name, set())


def test_it_is_inspected(fmu: Path, vehicle: Vehicle, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", str(fmu)]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert vehicle.signature in printed
    assert "As a car_like vehicle: it can be driven with a binding" in printed
    assert "As a tractor_trailer vehicle: no" in printed


def test_swapped_in_it_drives_in_formation_and_moves_as_ours(
    name: str, vehicle: Vehicle, fmu: Path, scenarios: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "swapped.xml"
    assert main(["swap", str(scenarios / "clmr_line.xml"), "--plant", f"clmr={fmu}", "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    binding = tmp_path / f"{fmu.stem}.binding.xml"
    assert ("once the binding is complete" in printed) == bool(OPEN_ROLES[name])
    if OPEN_ROLES[name]:
        assert main(["check", str(out)]) == 2
        assert "which is to be filled in" in capsys.readouterr().err
    binding.write_text(filled_in(binding.read_text(encoding="utf-8"), vehicle), encoding="utf-8")

    method = vehicle.methods[0]
    ours = cosim.PlantFile("car_like", parameters={"solver": method, "a": "1.3 m"})
    solver = method if vehicle.interface == "ModelExchange" and vehicle.signature != "Formation" else ""
    theirs = cosim.PlantFile(fmu, binding, solver=solver, parameters={"a": "1.3 m"})
    comparison = cosim.compare_plants(ours, theirs, within=["1e-9 m", "1e-9 rad", "1e-9 m/s", "1e-9 rad/s"])
    assert comparison.within, comparison.roles
    assert comparison.geometry["wheelbase"] == pytest.approx((1.3, 1.3))

    if "v" not in vehicle.roles:  # a leader must offer its velocities
        assert main(["check", str(out)]) == 2
        assert "offers no v and no omega" in capsys.readouterr().err
        return
    assert main(["run", str(out), "--no-figure", "--out", str(tmp_path)]) == 0
    assert "FAILS" not in capsys.readouterr().out
