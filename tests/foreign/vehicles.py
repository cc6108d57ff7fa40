"""Car-like robots made by tools of others: how each is built, and which of its variables plays which role.

`VEHICLES` is the table that bindings follow. Each FMU is made by its tool in a process of its own, as a user of that
tool would make it; none of the tools, and none of their search paths, gets into the tests' process.
"""

import importlib.util
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import fmpy
import pytest

import plants
from plants import units

HERE = Path(__file__).parent
UNITS = {
    "x": "m",
    "y": "m",
    "psi": "rad",
    "gamma": "rad",
    "v": "m/s",
    "omega": "rad/s",
    "tau_drive": "N.m",
    "tau_steer": "N.m",
    "a": "m",
}
"""The roles of the kind with its units."""


@dataclass(frozen=True)
class Variable:
    """How a variable of an FMU plays a role: ``value = sign * (the role's value in unit) + offset``.

    Attributes
    ----------
    name, unit
        The variable, and what its values are in, as `plants.units` writes it.
    declared
        What the FMU says of the unit: "defined" (with base units), "named" (not defined) or "missing".
    sign, offset
        Where conventions differ; the offset is in `unit`.
    element
        Index in an array variable, counted from 0.
    start
        The parameter that holds the initial value, in the same unit; without one, the variable's own start value does.
    """

    name: str
    unit: str
    declared: str = "defined"
    sign: float = 1.0
    offset: float = 0.0
    element: int | None = None
    start: str | None = None

    def to_fmu(self, role: str, value: float) -> float:
        """Return the variable's value for a value of the role, in the kind's unit."""
        return self.sign * units.convert(value, UNITS[role], self.unit) + self.offset

    def from_fmu(self, role: str, value: float) -> float:
        """Return the role's value, in the kind's unit."""
        return units.convert(self.sign * (value - self.offset), self.unit, UNITS[role])


def to_variables(
    roles: dict[str, Variable], values: dict[str, float], *, start: bool = False
) -> dict[str, list[float]]:
    """Return what the FMU's variables are to be, by name, for values of roles; of an array all elements must be given.

    With `start`, the initial values go where they are set: to parameters, or to the variables themselves.
    """
    elements: dict[str, dict[int, float]] = {}
    for role, value in values.items():
        variable = roles[role]
        name = (start and variable.start) or variable.name
        elements.setdefault(name, {})[variable.element or 0] = variable.to_fmu(role, value)
    return {name: [of_one[i] for i in range(len(of_one))] for name, of_one in elements.items()}


@dataclass(frozen=True)
class Vehicle:
    """A foreign FMU.

    Attributes
    ----------
    tool, signature
        The package that makes it, as it is imported, and how the FMU's generation tool begins.
    fmi, interface
        What it is: "2.0" or "3.0"; "CoSimulation" or "ModelExchange", that which is driven here.
    methods
        The solver of our plant that moves as it does; all there are for Model Exchange, where the importer integrates.
    build
        Makes the FMU in a folder.
    roles
        Which variable plays which role; a role that is missing is not offered.
    problems
        How each of the problems that FMPy finds begins; the README says why they are there.
    """

    tool: str
    signature: str
    fmi: str
    interface: str
    methods: tuple[str, ...]
    build: Callable[[Path], Path]
    roles: dict[str, Variable]
    problems: tuple[str, ...] = ()


def require(package: str) -> None:
    """Skip the test where a tool is not installed, or fail it if FORMATION_REQUIRE_FOREIGN is set."""
    if importlib.util.find_spec(package) is None:
        if os.environ.get("FORMATION_REQUIRE_FOREIGN"):
            pytest.fail(f"{package} is not installed: it comes with the extra 'foreign'")
        pytest.skip(f"{package} is not installed")


def run(folder: Path, fmu: str, *command: str) -> Path:
    """Run a tool in a folder, and return the path of the FMU that it makes there."""
    done = subprocess.run([sys.executable, *command], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder / fmu


def pythonfmu(folder: Path, *options: str) -> Path:
    """Package rover.py with PythonFMU; its options say what the FMU claims, as "--only-one-per-process"."""
    return run(folder, "Rover.fmu", "-m", "pythonfmu", "build", *options, "-f", str(HERE / "rover.py"), "-d", ".")


def pythonfmu3(folder: Path) -> Path:
    """Package ugv.py with PythonFMU3."""
    return run(folder, "Ugv.fmu", "-m", "pythonfmu3", "build", "-f", str(HERE / "ugv.py"), "-d", ".")


def casadi(folder: Path) -> Path:
    """Let CasADi write C, compile it with the system's compiler and pack it; FMPy has the headers."""
    return run(folder, "Agv.fmu", str(HERE / "agv.py"), str(Path(fmpy.__file__).parent / "c-code"))


def repackaged(folder: Path, fmi: str = "2.0") -> Path:
    """Repackage our own FMU with the FMU Manipulation Toolbox."""
    return run(folder, "Supplied.fmu", str(HERE / "repackage.py"), str(plants.build("car_like", fmi=fmi)))


METHODS = ("euler", "runge_kutta_4")

CASADI = {
    "x": Variable("px", "mm", "named"),
    "y": Variable("py", "mm", "named"),
    "psi": Variable("yaw", "mrad", "named"),
    "gamma": Variable("delta", "mrad", "named"),
    "v": Variable("u", "mm/s", "named"),
    "omega": Variable("delta_dot", "mrad/s", "named"),
    "tau_drive": Variable("M_drive", "N.mm", "named"),
    "tau_steer": Variable("M_steer", "N.mm", "named"),
    "a": Variable("L", "mm", "named"),
}
SUPPLIED = {
    "x": Variable("Chassis.rearAxle.x", "m"),
    "y": Variable("Chassis.rearAxle.y", "m"),
    "psi": Variable("Chassis.yaw", "rad"),
    "gamma": Variable("Steering.angle", "rad"),
    "v": Variable("Chassis.speed", "m/s"),
    "omega": Variable("Steering.rate", "rad/s"),
    "tau_drive": Variable("Driveline.torque", "N.m"),
    "tau_steer": Variable("Steering.torque", "N.m"),
    "a": Variable("Chassis.wheelbase", "m"),
}
UNKNOWNS = "ModelStructure/InitialUnknowns does not contain the expected set of variables"

VEHICLES = {
    "pythonfmu": Vehicle(
        tool="pythonfmu",
        signature="PythonFMU 0",
        fmi="2.0",
        interface="CoSimulation",
        methods=("euler",),
        build=pythonfmu,
        roles={
            "x": Variable("pos_x", "m", "missing", start="x0"),
            "y": Variable("pos_y", "m", "missing", start="y0"),
            "psi": Variable("heading", "deg", "missing", start="heading0"),
            "gamma": Variable("steer", "deg", "missing", start="steer0"),
            "v": Variable("speed", "km/h", "missing"),
            "omega": Variable("steer_rate", "deg/s", "missing"),
            "tau_drive": Variable("drive_torque", "N.m", "missing"),
            "tau_steer": Variable("steer_torque", "N.m", "missing"),
            "a": Variable("wheelbase", "mm", "missing"),
        },
        problems=(UNKNOWNS,),
    ),
    "pythonfmu3": Vehicle(
        tool="pythonfmu3",
        signature="PythonFMU3 0",
        fmi="3.0",
        interface="CoSimulation",
        methods=("runge_kutta_4",),
        build=pythonfmu3,
        roles={
            "x": Variable("vehicle.position", "m", element=1),
            "y": Variable("vehicle.position", "m", element=0),
            "psi": Variable("vehicle.heading", "deg", sign=-1.0, offset=90.0),
            "gamma": Variable("vehicle.steering.angle", "deg", sign=-1.0),
            "tau_drive": Variable("vehicle.torque", "N.m", element=0),
            "tau_steer": Variable("vehicle.torque", "N.m", sign=-1.0, element=1),
            "a": Variable("vehicle.geometry.wheelbase", "m"),
        },
    ),
    "casadi": Vehicle(
        tool="casadi",
        signature="CasADi",
        fmi="3.0",
        interface="ModelExchange",
        methods=METHODS,
        build=casadi,
        roles=CASADI,
        problems=(
            *(f'"__assign__der({role.name})__"' for role in list(CASADI.values())[:6]),
            *(f'The unit "{role.unit}" of variable "{role.name}"' for role in CASADI.values()),
            'The unit "kg" of variable "m"',
            UNKNOWNS,
        ),
    ),
    "repackaged": Vehicle(
        tool="fmu_manipulation_toolbox",
        signature="Formation",
        fmi="2.0",
        interface="CoSimulation",
        methods=("euler",),
        build=repackaged,
        roles=SUPPLIED,
    ),
    "repackaged_3": Vehicle(
        tool="fmu_manipulation_toolbox",
        signature="Formation",
        fmi="3.0",
        interface="ModelExchange",
        methods=METHODS,
        build=partial(repackaged, fmi="3.0"),
        roles=SUPPLIED,
    ),
}
