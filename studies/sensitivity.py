"""How much each reading of the paper matters, for the first three simulations.

    python studies/sensitivity.py            # all of them
    python studies/sensitivity.py clmr_line  # of these scenarios only

prints, for each scenario, the worst of four followers and of the seeds 1 to 3 with one reading changed at a time, and
in the end the same in short. Changes that no scenario can state are patched into the controller.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FunctionType, ModuleType
from typing import Any
from unittest.mock import patch

import numba
from formation_controllers import Desired, kinematics, neural_adaptive_pid, projection, robot_view
from formation_controllers.interface import Floats
from formation_controllers.kinematics import PostureError
from formation_controllers.neural_adaptive_pid import NeuralAdaptivePid
from formation_controllers.observer_pid import ObserverPid
from variation import HEADER, SCENARIOS, Outcome, gain, heading, outcome, parameter, row, worst

import cosim
from cosim.scenario.edits import Change, set_horizon
from cosim.scenario.grammar import NAMESPACE

SEEDS = range(1, 4)
FILES = ("clmr_line_as_printed", "clmr_line", "clmr_circle_as_printed", "clmr_circle")
TRACTOR_TRAILER = "tractor_trailer_circle"


@dataclass(frozen=True)
class Reading:
    """A reading: its edits of the scenario, and of the controller.

    Attributes
    ----------
    changes
        As `cosim.read_scenario` takes them.
    patches
        Replacements of attributes, by object and name.
    scenario
        A variant of the scenario, in its place.
    """

    changes: Sequence[str | Change] = ()
    patches: Mapping[tuple[object, str], Any] = field(default_factory=dict)
    scenario: Path | None = None


# In a scenario ----------------------------------------------------------------------------------------------


def noise(millimetres: float) -> Reading:
    """Return another standard deviation of the noise: [mm] of positions, [mrad] of angles."""
    angles = '//noise/@*[name() != "x" and name() != "y"]'
    return Reading(
        [f"//noise/@x={millimetres:g} mm", f"//noise/@y={millimetres:g} mm", f"{angles}={millimetres:g} mrad"]
    )


def damping(value: float) -> list[str]:
    """Return the changes to another damping of every coordinate of the tractor-trailer."""
    units = ("N.s/m", "N.s/m", "N.m.s/rad", "N.m.s/rad")
    return [change for j, unit in enumerate(units, 1) for change in parameter(f"d_m{j}", f"{value:g} {unit}")]


def step(milliseconds: float) -> Reading:
    """Return another step of plants and controllers [ms]."""
    return Reading(
        [f"//simulation/@step={milliseconds:g} ms", *parameter("solver_step", f"{milliseconds:g} ms")],
    )


def steady_leader(path: Path, folder: Path) -> Reading:
    """Return a leader that moves along a given path at its final speed and curvature from the start on."""
    scenario = cosim.read_scenario(path)
    result = cosim.run(scenario)
    x, y, psi, _ = (float(value) for value in result["leader_pose"].values[0])
    v = float(result["leader_velocity"].sel(time=slice(0.8 * scenario.horizon, None)).values[:, 0].mean())
    *_, body, last = result["leader_pose"].values[-1]
    turn = math.tan(last) / 1.2 if "gamma" in result["pose_component"].values else math.tan(last - body) / 1.5
    waypoints = []
    for time in range(0, round(scenario.horizon) + 1, 2):
        angle = turn * v * time / 2
        chord = v * time * (math.sin(angle) / angle if angle else 1.0)
        x_t, y_t = x + chord * math.cos(psi + angle), y + chord * math.sin(psi + angle)
        waypoints.append(f'<waypoint at="{time} s" x="{x_t:.9f} m" y="{y_t:.9f} m"/>')
    file = folder / f"{path.stem}_steady_leader.xml"
    file.write_text(
        f"""<variant xmlns="{NAMESPACE}" name="{file.stem}" of="{path}">
  <title>The leader on a given path</title>
  <remove select="leader/pose | leader/torque"/>
  <insert into="leader"><trajectory>{"".join(waypoints)}</trajectory></insert>
</variant>""",
        encoding="utf-8",
    )
    return Reading(scenario=file)


# In the controller ------------------------------------------------------------------------------------------


def _with(module: ModuleType, **others: object) -> ModuleType:
    """Return a copy of a module with other things in the place of some of its own."""
    copy = ModuleType(module.__name__)
    copy.__dict__.update(vars(module), **others)
    return copy


def _rebuilt(function: Any, **others: object) -> Any:
    """Return a compiled function that knows other things by the names that it uses."""
    plain = getattr(function, "py_func", function)
    return numba.njit(error_model="numpy")(FunctionType(plain.__code__, {**plain.__globals__, **others}))


def law(**others: object) -> Reading:
    """Return the paper's law with some functions of its tick replaced."""
    return Reading(patches={(NeuralAdaptivePid, "tick"): staticmethod(_rebuilt(NeuralAdaptivePid.tick, **others))})


def network_input(chosen: Callable[..., None]) -> Reading:
    """Return another input of the network."""
    return law(network_input=numba.njit(error_model="numpy")(chosen))


def weight_step(chosen: Callable[..., None]) -> Reading:
    """Return another step of the weights."""
    return law(projection=_with(projection, step_weights=numba.njit(error_model="numpy")(chosen)))


def _error_alone(
    x: Floats, error: PostureError, steering_d: float, v_d: Floats, rate: Floats, rate_d: Floats, acceleration_d: Floats
) -> None:
    x[:] = 0.0
    x[0], x[1], x[2], x[3] = error.e_1, error.e_2, error.e_3, error.e_4


def _desired_rate(
    x: Floats, error: PostureError, steering_d: float, v_d: Floats, rate: Floats, rate_d: Floats, acceleration_d: Floats
) -> None:
    _fill(x, error, steering_d, v_d, rate_d, rate_d, acceleration_d)


def _no_steering(
    x: Floats, error: PostureError, steering_d: float, v_d: Floats, rate: Floats, rate_d: Floats, acceleration_d: Floats
) -> None:
    _fill(x, error, 0.0, v_d, rate, rate_d, acceleration_d)


_fill = neural_adaptive_pid.network_input


def _never_scaled(W: Floats, trace: float, s: Floats, sigma: Floats, gamma_w: float, W_m: float, period: float) -> None:
    c = _outward(W, trace, s, sigma, W_m)
    for m in range(W.shape[0]):
        for k in range(W.shape[1]):
            W[m, k] += period * gamma_w * (s[m] * sigma[k] - c * W[m, k])


def _only_scaled(W: Floats, trace: float, s: Floats, sigma: Floats, gamma_w: float, W_m: float, period: float) -> None:
    for m in range(W.shape[0]):
        for k in range(W.shape[1]):
            W[m, k] += period * gamma_w * s[m] * sigma[k]
    scaled = _norm_squared(W)
    if scaled > W_m:
        W *= math.sqrt(W_m / scaled)


_outward, _norm_squared = projection.outward, projection.norm_squared


@numba.njit(error_model="numpy")
def _wrapped(angle: float, previous: float) -> float:
    return angle - 2 * math.pi * math.floor((angle + math.pi) / (2 * math.pi))


@numba.njit(error_model="numpy")
def _tractor_heading(pose: Floats, vehicle: Any) -> float:
    return pose[3]


def _start_at_zero(controller: ObserverPid, q: Floats, desired: Desired) -> None:
    """Start the observer at zero instead of at q; no gain of the law does that."""


# All of them ------------------------------------------------------------------------------------------------

LINE = gain(gamma_theta=0.5, theta_m=10, gamma_w=10, W_m=1000)
EXPONENTS = {
    "exponent over 2 λ² (λ²)": Reading(gain(widths=10 * math.sqrt(2))),
    "exponent over λ": Reading(gain(widths=math.sqrt(10))),
}
LAW = {
    "x_w: e alone (all 13 entries)": network_input(_error_alone),
    "x_w: q̇_d in place of the estimated rate": network_input(_desired_rate),
    "weights beyond their bound: not scaled back, (29) alone (scaled)": weight_step(_never_scaled),
    "weights beyond their bound: scaled back, without (29)": weight_step(_only_scaled),
    "bearing within ±180° (unwrapped)": law(
        robot_view=_with(robot_view, see=_rebuilt(robot_view.see, kinematics=_with(kinematics, unwrapped=_wrapped)))
    ),
    "observer: q̂(0) = 0 (q(0))": Reading(patches={(ObserverPid, "start_states"): _start_at_zero}),
}
HORIZON = {"horizon 150 s (100 s)": Reading([set_horizon(150)])}


def car_like_readings(path: Path, folder: Path) -> dict[str, Reading]:
    """Return the readings of the car-like robots' scenarios."""
    return {
        "as read": Reading(),
        "drive: front wheel (as printed)": Reading(parameter("drive", "front_wheel")),
        "drive: rear wheel": Reading(parameter("drive", "rear_wheel")),
        "leader at its final speed from the start (at rest)": steady_leader(path, folder),
        **HORIZON,
        "no noise (1 mm, 1 mrad)": noise(0),
        "noise 10 mm, 10 mrad": noise(10),
        "plant by Dormand-Prince 4(5) (Euler 20 ms)": Reading(parameter("solver", "dormand_prince_45")),
        "plant by Runge-Kutta 4, step 20 ms": Reading(parameter("solver", "runge_kutta_4")),
        "plant and controller at 10 ms (20 ms)": step(10),
        "plant and controller at 5 ms": step(5),
        "no saturation (200 N.m)": Reading(["//saturation/@limit=1e9 N.m"]),
        "saturation 100 N.m": Reading(["//saturation/@limit=100 N.m"]),
        "adaptation and integrals held beyond 200 N.m (go on)": Reading(gain(torque_limit=200)),
        **EXPONENTS,
        **LAW,
    }


def tractor_trailer_readings(path: Path, folder: Path) -> dict[str, Reading]:
    """Return the readings of the tractor-trailers' scenario."""
    return {
        "as read": Reading(),
        "damping 5 (25)": Reading(damping(5)),
        "damping 10": Reading(damping(10)),
        "damping 50": Reading(damping(50)),
        "gains of the line (of the circle)": Reading(LINE),
        "gains of the line, damping 5": Reading([*LINE, *damping(5)]),
        "leader at its final speed from the start (at rest)": steady_leader(path, folder),
        **HORIZON,
        "no noise (1 mm, 1 mrad)": noise(0),
        "noise 10 mm, 10 mrad": noise(10),
        "plant by Runge-Kutta 4, step 20 ms (Euler)": Reading(parameter("solver", "runge_kutta_4")),
        "plant and controller at 10 ms (20 ms)": step(10),
        "plant and controller at 5 ms": step(5),
        **EXPONENTS,
        "x_w: θ_0d in place of γ_d (θ_0d − θ_1d)": law(steering_angle=_tractor_heading),
        "x_w: nothing in place of γ_d": network_input(_no_steering),
        **LAW,
    }


def outcome_of(path: Path, reading: Reading) -> Outcome:
    """Return the worst outcome of the seeds with one reading changed."""
    try:
        for (place, name), other in reading.patches.items():
            patcher = patch.object(place, name, other)
            patcher.start()
        return worst(outcome(reading.scenario or path, reading.changes, seed) for seed in SEEDS)
    finally:
        patch.stopall()


def short(found: Outcome) -> str:
    """Return an outcome as one cell of a table."""
    if not found.followers:
        return "diverged"
    last = f" ({found.last:.0f} s)" if math.isfinite(found.last) else ""
    out = ", out" if min(found.drive_gain, found.det_R) < 0 else ""
    lost = f", {found.diverged} of {len(SEEDS)} runs diverged" if found.diverged else ""
    return f"{found.settled} of {found.followers}{last}, {found.range_rms:.3f} m{out}{lost}"


def main() -> None:
    """Print a table for each scenario, and one of all scenarios of car-like robots."""
    parser = argparse.ArgumentParser(description="How much each reading of the paper matters.")
    parser.add_argument("files", nargs="*", default=[*FILES, TRACTOR_TRAILER], metavar="SCENARIO")
    cells: dict[str, list[str]] = {}
    files = parser.parse_args().files
    with TemporaryDirectory() as folder:
        for file in files:
            path = SCENARIOS / f"{file}.xml"
            print(f"\n{file}\n\n{heading('reading', *HEADER)}")
            readings = tractor_trailer_readings if file == TRACTOR_TRAILER else car_like_readings
            for label, reading in readings(path, Path(folder)).items():
                found = outcome_of(path, reading)
                print(row(label, *found.cells()), flush=True)
                if file != TRACTOR_TRAILER:
                    cells.setdefault(label, []).append(short(found))
    print(f"\nIn short\n\n{heading('reading (as read)', *(file for file in files if file != TRACTOR_TRAILER))}")
    for label, own in cells.items():
        print(row(label, *own))


if __name__ == "__main__":
    main()
