"""Who knows whom, and no arrow more."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def imports_of(room: Path) -> Iterator[tuple[Path, str]]:
    for path in room.rglob("*.py"):
        if "tests" in path.parts:
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                yield from ((path, alias.name) for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
                yield path, node.module


@pytest.mark.parametrize(
    ("room", "forbidden"),
    [
        ("plants", ("cosim", "formation_controllers")),
        ("controllers/formation_controllers", ("cosim", "plants", "fmpy", "lxml", "xml")),
        (
            "cosim",
            ("plants.car_like", "plants.factory", "plants.ode", "plants.nonholonomic", "plants.numeric", "sympy"),
        ),
    ],
)
def test_rooms(room: str, forbidden: tuple[str, ...]) -> None:
    found = list(imports_of(ROOT / room))
    assert found
    wrong = [(str(p), name) for p, name in found if any(name == f or name.startswith(f + ".") for f in forbidden)]
    assert wrong == []


@pytest.mark.parametrize(
    ("package", "expected"),
    [
        (
            "fmpy",
            {
                "fmu/binaries.py",
                "fmu/description.py",
                "fmu/replay.py",
                "plant/cvode.py",
                "plant/instance.py",
                "plant/log.py",
            },
        ),
        (
            "formation_controllers",
            {
                "cli/listing.py",
                "compiled.py",
                "control/compiled_teams.py",
                "control/exchange.py",
                "control/host.py",
                "control/hosts.py",
                "control/installed_laws.py",
                "control/law.py",
                "control/leader_view.py",
                "control/team.py",
                "control/team_elsewhere.py",
                "control/team_here.py",
                "master/recorded_signals.py",
                "master/robot.py",
                "master/robots.py",
                "master/setup.py",
                "master/ticks.py",
                "master/wiring.py",
                "signals/trajectory.py",
                "team_fmu/law_in_host.py",
                "team_fmu/laws.py",
                "team_fmu/leader_in_c.py",
                "team_fmu/model.py",
                "team_fmu/ports.py",
                "vehicle",
            },
        ),
    ],
)
def test_few_modules_know_fmpy_or_the_controllers(package: str, expected: set[str]) -> None:
    room = ROOT / "cosim"
    found = {path.relative_to(room) for path, name in imports_of(room) if name.split(".")[0] == package}
    knows = {"vehicle" if path.parts[0] == "vehicle" else path.as_posix() for path in found}  # a file a kind
    assert knows == expected


def test_a_cached_run_imports_no_symbolic_mathematics(scenarios: Path) -> None:
    program = f"""
import sys, cosim
short = {{"horizon": 1.0, "expectations": False}}
cosim.run({str(scenarios / "clmr_line.xml")!r}, **short)
cosim.run({str(scenarios / "clmr_line.xml")!r}, **short)
print(sorted({{"sympy", "matplotlib", "plants.factory.generate"}} & set(sys.modules)))
"""
    command = [sys.executable, "-c", program]
    subprocess.run(command, check=True, timeout=300, capture_output=True)  # builds the FMU if it is not in the cache
    printed = subprocess.run(command, check=True, timeout=300, capture_output=True, text=True).stdout
    assert printed == "[]\n"


def test_a_run_at_the_command_line_imports_no_library_of_data_frames_or_figures(
    scenarios: Path, tmp_path: Path
) -> None:
    """It draws its figure in another process; Numba alone imports the top of SciPy, to read its version."""
    heavy = ("xarray", "pandas", "scipy.linalg", "matplotlib", "dask", "h5netcdf", "sympy", "jinja2")
    program = f"""
import sys
from cosim.cli import main
line = {str(scenarios / "clmr_line.xml")!r}
status = main(["run", line, "--out", {str(tmp_path)!r}, "--horizon", "0.2 s", "--no-expectations"])
print(status, [name for name in {heavy!r} if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", program], check=True, timeout=300, capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == "0 []"
    assert done.stderr == ""
    assert (tmp_path / "clmr_line" / "figure.png").exists()
    assert (tmp_path / "clmr_line" / "report.html").exists()
