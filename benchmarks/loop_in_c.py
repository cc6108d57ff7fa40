"""The closed loop in C, closed_loop.c: compiled, given the numbers of a run, called, and its records by their names."""

import ctypes
import subprocess
import tempfile
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from teams import sensor_noise

import cosim
from plants.factory.compile import find_compiler

SOURCE = Path(__file__).parent / "closed_loop.c"
FLAGS = ("-std=c11", "-O3", "-ffp-contract=off", "-shared", "-fPIC")  # never -flto, with which GCC 12 contracts
CENTRES = 9

Array = NDArray[Any]


def _record(*fields: str, **sizes: int) -> np.dtype[Any]:
    """Return a struct of numbers and, where a size is given, of arrays of numbers."""
    return np.dtype([(name, float, sizes[name]) if name in sizes else (name, float) for name in fields])


# The structs of closed_loop.c
STATE = _record("pose", "velocity", pose=4, velocity=2)
PLANT = _record("a", "m_c", "I_c", "I_f", "d_x", "d_y", "d_psi", "d_gamma")
GAINS = _record(
    *("K_p", "Lambda_0", "Lambda_1", "k_d", "epsilon_t", "gamma_theta", "theta_m", "gamma_w", "W_m"),
    *("centres", "widths"),
    K_p=2,
    Lambda_0=2,
    Lambda_1=2,
    centres=CENTRES,
    widths=CENTRES,
)
DESIRED = _record("q", "q_dot", "q_ddot", q=2, q_dot=2, q_ddot=2)
MEMORY = _record("states", states=11 + 2 * CENTRES + 2)
TELEMETRY = _record(
    *("range_estimate", "bearing_estimate", "range_rate_estimate", "bearing_rate_estimate"),
    *("speed_estimate", "steering_rate_estimate", "weight_norm", "gain_estimate", "torque_command"),
    *("drive_gain", "det_R", "relative_range", "cos_bearing", "cos_steering", "guarded", "held"),
    torque_command=2,
)
FORMATION = _record("range", "bearing", "range_error", "bearing_error")


def own_functions(fmu: Path) -> bytes | None:
    """Return the header of the elementary functions that a plant's FMU brings, if it brings any."""
    with zipfile.ZipFile(fmu) as archive:
        name = "sources/elementary.h"
        return archive.read(name) if name in archive.namelist() else None


def compiled(functions: bytes | None = None) -> ctypes.CDLL:
    """Return closed_loop.c as a library, with a header's elementary functions or the C library's."""
    with tempfile.TemporaryDirectory() as scratch:
        library, header = Path(scratch, "closed_loop.so"), Path(scratch, "functions.h")
        header.write_bytes(functions or b"")
        more = [f'-DFUNCTIONS="{header}"'] if functions else []
        command = [*find_compiler().command, *FLAGS, *more, "-o", str(library), str(SOURCE), "-lm"]
        subprocess.run(command, check=True)
        return ctypes.CDLL(str(library))


def call(function: Any, *arguments: int | float | Array) -> None:
    """Call a function in C with whole numbers, numbers and arrays."""

    def as_c(argument: int | float | Array) -> Any:
        if isinstance(argument, np.ndarray):
            assert argument.flags.c_contiguous
            return ctypes.c_void_p(argument.ctypes.data)
        return (ctypes.c_long if isinstance(argument, int) else ctypes.c_double)(argument)

    function(*map(as_c, arguments))


class LoopInC:
    """The loop of a team of clmr_line.xml in C, with the numbers of a simulation that has been set up.

    Parameters
    ----------
    c
        The library.
    simulation
        Of such a team.

    Attributes
    ----------
    states, torques : ndarray
        The records of the last `run` (samples, robots), the leader first.
    measured, telemetry, formation : ndarray
        The same of the followers (samples, followers), the last of `derive`.
    """

    def __init__(self, c: ctypes.CDLL, simulation: cosim.Simulation) -> None:
        setup, scenario = simulation.setup, simulation.scenario
        robots = (setup.leader, *setup.followers)
        self.c, self.step = c, scenario.step
        self.samples, self.n = samples, n = scenario.ticks + 1, len(setup.followers)
        values = {parameter.variable.name: parameter.value for parameter in setup.leader.parameters}
        self.plant = np.array(tuple(values[name] for name in PLANT.names or ()), PLANT)
        self.gains = np.zeros((), GAINS)
        for name in GAINS.names or ():
            self.gains[name] = getattr(setup.gains[0], name)
        self.limit = setup.followers[0].actuator[0].amount
        self.desired = np.zeros((samples, n), DESIRED)
        for name, of_all in zip(DESIRED.names or (), setup.desired, strict=True):
            self.desired[name] = of_all
        self.leader_torque = np.ascontiguousarray(setup.leader.torque)
        self.noise = np.ascontiguousarray(sensor_noise(scenario, robots, samples)[:, 1:])
        self.start = np.zeros(1 + n, STATE)
        self.start["pose"] = [robot.pose for robot in robots]

        self.now, self.memory = self.start.copy(), np.zeros(n, MEMORY)
        self.states = np.full((samples, 1 + n), np.nan, STATE)  # not zeros, whose memory is not there until written
        self.measured = np.full((samples, n, 4), np.nan)
        self.torques = np.full((samples, 1 + n, 2), np.nan)
        self.telemetry = np.full((samples, n), np.nan, TELEMETRY)
        self.formation = np.full((samples, n), np.nan, FORMATION)

    def run(self) -> None:
        """Run from the start to the horizon and record."""
        np.copyto(self.now, self.start)
        given = (self.plant, self.gains, self.limit, self.desired, self.leader_torque, self.noise)
        records = (self.states, self.measured, self.torques, self.telemetry)
        call(self.c.closed_loop, self.samples, self.n, self.step, *given, self.now, self.memory, *records)

    def derive(self) -> None:
        """Compute from the records what a result holds besides."""
        a = float(self.plant["a"])
        call(self.c.formation, self.samples, self.n, a, self.desired, self.states, self.formation)

    def plants_alone(self, torques: NDArray[np.float64], states: Array) -> None:
        """Move the plants from the start by torques (ticks, robots, 2); fill their states after each tick."""
        np.copyto(self.now, self.start)
        ticks, robots = states.shape
        call(self.c.plants_alone, ticks, robots, self.step, self.plant, torques, self.now, states)

    def law_alone(
        self, desired: Array, measured: NDArray[np.float64], leader: Array, commands: NDArray[np.float64]
    ) -> None:
        """Fill the commands (ticks, n, 2) of the law of n robots from their poses and the leader's states."""
        ticks, n = measured.shape[:2]
        memory, telemetry = np.zeros(n, MEMORY), np.zeros(n, TELEMETRY)
        a = float(self.plant["a"])
        call(
            self.c.law_alone, ticks, n, self.step, a, self.gains, desired, measured, leader, memory, commands, telemetry
        )

    def variables(self) -> dict[str, Array]:
        """Return the records by the names that they have in a result."""
        states, torques = self.states, self.torques
        return {
            "leader_pose": states["pose"][:, 0],
            "leader_velocity": states["velocity"][:, 0],
            "leader_torque": torques[:, 0],
            "pose": states["pose"][:, 1:],
            "velocity": states["velocity"][:, 1:],
            "measured_pose": self.measured,
            "torque": torques[:, 1:],
            "desired_range": self.desired["q"][..., 0],
            "desired_bearing": self.desired["q"][..., 1],
            **{name: self.telemetry[name] for name in TELEMETRY.names or ()},
            **{name: self.formation[name] for name in FORMATION.names or ()},
        }
