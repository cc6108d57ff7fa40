"""Readings that no scenario can state: other functions in the law, and a leader already at its final speed.

    python studies/law_readings.py            # all of them
    python studies/law_readings.py clmr_line  # of these scenarios only

prints, for each scenario, the worst of four followers and of the seeds 1 to 3 with one reading changed at a time, then
two of them in longer runs. All other readings are `readings.xml`, `readings_150_s.xml` and
`readings_tractor_trailer.xml`. Here the law is patched while it runs. A patch that changes no bit of any run ends the
study, unless the reading `may_be_idle`.
"""

from __future__ import annotations

import argparse
import hashlib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FunctionType, ModuleType
from typing import Any
from unittest.mock import patch

import numba
import numpy as np
import xarray as xr
from formation_controllers import (
    kinematics,
    neural_adaptive_pid,
    observer_pid,
    projection,
    robot_view,
    velocity_observer,
)
from formation_controllers.compiled_law import TeamRecords
from formation_controllers.interface import Floats, TickInputs
from formation_controllers.kinematics import PostureError
from formation_controllers.neural_adaptive_pid import NeuralAdaptivePid
from formation_controllers.observer_pid import ObserverPid
from pages import SCENARIOS, heading, number, row

import cosim
from cosim.results.summary import summarise
from cosim.scenario.edits import Change, set_horizon, set_seed
from cosim.scenario.grammar import NAMESPACE

SEEDS = range(1, 4)
PERIOD = 0.02
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
    may_be_idle
        Whether it may leave every number as it is: it is about a case that need not occur in a run.
    """

    changes: Sequence[str | Change] = ()
    patches: Mapping[tuple[object, str], Any] = field(default_factory=dict)
    scenario: Path | None = None
    may_be_idle: bool = False


# Runs -------------------------------------------------------------------------------------------------------

HEADER = ("settled", "last after", "range", "bearing", "drive gain", "det R", "steering")
"""Settled followers, time of the last one, errors (RMS), and the extremes of drive gain, det R and steering angle."""


@dataclass(frozen=True)
class Outcome:
    """The worst follower of a run, or the worst run of several.

    Attributes
    ----------
    followers, settled : int
        How many followers there are, and how many of them settle, as `cosim.results.summary` defines it.
    last : float
        When the last one has settled [s]; infinite if not all do.
    range_rms, bearing_rms : float
        Root mean squares over the last fifth of the horizon [m], [rad].
    drive_gain, det_R : float
        The least over the run; a run that is negative here has left the domain of the theory.
    steering : float
        Largest magnitude of the steering angle [rad].
    diverged : int
        Runs that did not reach the horizon; the other figures leave them out.
    bits : tuple of str
        A checksum of everything recorded, for each run.
    """

    followers: int
    settled: int
    last: float
    range_rms: float
    bearing_rms: float
    drive_gain: float
    det_R: float
    steering: float
    diverged: int = 0
    bits: tuple[str, ...] = ()

    def cells(self) -> tuple[str, ...]:
        """Return the cells of a table's row, as `HEADER` names them."""
        if not self.followers:
            return ("diverged", *("",) * (len(HEADER) - 1))
        last = f"{self.last:.0f} s" if math.isfinite(self.last) else "-"
        note = f" ({self.diverged} diverged)" if self.diverged else ""
        return (
            f"{self.settled} of {self.followers}{note}",
            last,
            f"{self.range_rms:.3f} m",
            f"{math.degrees(self.bearing_rms):.2f}°",
            number(self.drive_gain),
            number(self.det_R),
            f"{math.degrees(self.steering):.0f}°",
        )


def gain(**values: float) -> list[str]:
    """Return the changes that set gains of the controller of a scenario, also gains that it leaves out."""
    return [f'controller/gain[@name="{name}"]/@value={value:g}' for name, value in values.items()]


def outcome(scenario: Path, changes: Sequence[str | Change], seed: int) -> Outcome:
    """Run a scenario with changes and one seed."""
    read = cosim.read_scenario(scenario, [*changes, set_seed(seed)])
    try:
        result = cosim.run(read)
    except cosim.SimulationError as error:
        bits = () if error.result is None else (checksum(error.result),)
        return Outcome(0, 0, math.nan, math.nan, math.nan, math.nan, math.nan, math.nan, diverged=1, bits=bits)
    figures = summarise(read, result).followers
    times = [follower.settling_time for follower in figures]
    settled = [time for time in times if time is not None]
    pose = result["pose"].values
    steering = pose[..., 3] - pose[..., 2] if "theta_1" in result["pose_component"].values else pose[..., 3]
    return Outcome(
        followers=len(figures),
        settled=len(settled),
        last=max(settled) if len(settled) == len(times) else math.inf,
        range_rms=max(follower.range_rms for follower in figures),
        bearing_rms=max(follower.bearing_rms for follower in figures),
        drive_gain=float(result["drive_gain"].min()),
        det_R=float(result["det_R"].min()),
        steering=float(np.abs(steering).max()),
        bits=(checksum(result),),
    )


def checksum(result: xr.Dataset) -> str:
    """Return a checksum of everything that a run has recorded."""
    digest = hashlib.sha256()
    for name, values in result.data_vars.items():
        digest.update(str(name).encode() + values.values.tobytes())
    return digest.hexdigest()


def worst(outcomes: Iterable[Outcome]) -> Outcome:
    """Return the worst of several runs, figure by figure; runs that diverged are only counted."""
    runs = list(outcomes)
    whole = [run for run in runs if not run.diverged]
    bits = tuple(checksum for run in runs for checksum in run.bits)
    if not whole:
        return replace(runs[0], bits=bits)
    return Outcome(
        followers=whole[0].followers,
        settled=min(run.settled for run in whole),
        last=max(run.last for run in whole),
        range_rms=max(run.range_rms for run in whole),
        bearing_rms=max(run.bearing_rms for run in whole),
        drive_gain=min(run.drive_gain for run in whole),
        det_R=min(run.det_R for run in whole),
        steering=max(run.steering for run in whole),
        diverged=len(runs) - len(whole),
        bits=bits,
    )


# In a scenario ----------------------------------------------------------------------------------------------


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
def _as_printed(angle: float, previous: float) -> float:
    return angle


@numba.njit(error_model="numpy")
def _estimate_after(q: Floats, c: Any, r: int, own: Any, g: Any, q_d: Floats, q_d_dot: Floats) -> None:
    """Advance the observer by the pose of this tick, then estimate."""
    for j in range(2):
        q_tilde = q[j] - own["q_hat"][j]
        rate = _rate_estimate(own["p"][j], q_tilde, g["Lambda_0"][j], g["k_d"])
        p_dot = _p_dot(own["zeta"][j], q_tilde, 0.0, g["Lambda_0"][j], g["Lambda_1"][j], g["k_d"])
        own["zeta"][j] += PERIOD * _zeta_dot(q_tilde, g["Lambda_1"][j], g["k_d"])
        own["p"][j] += PERIOD * p_dot
        own["q_hat"][j] += PERIOD * rate
    _estimate(q, c, r, own, g, q_d, q_d_dot)


@numba.njit(error_model="numpy")
def _integrals_alone(c: Any, r: int, own: Any, g: Any, q_d_ddot: Floats, held: bool, period: float) -> None:
    for j in range(2):
        own["epsilon_hat_integral"][j] += period * c["epsilon_hat"][j, r]
        own["epsilon_q_tilde_integral"][j] += period * c["epsilon_q_tilde"][j, r]


_estimate = observer_pid.estimate
_rate_estimate, _p_dot, _zeta_dot = (
    velocity_observer.rate_estimate,
    velocity_observer.p_dot,
    velocity_observer.zeta_dot,
)
OBSERVER_FIRST = law(observer_pid=_with(observer_pid, estimate=_estimate_after, advance=_integrals_alone))


@numba.njit(error_model="numpy")
def _tractor_heading(pose: Floats, vehicle: Any) -> float:
    return pose[3]


def _begin_at_zero(inputs: TickInputs, team: TeamRecords) -> None:
    """Start the observer at zero instead of at q; no gain of the law does that."""
    _begin(inputs, team)
    team.state["q_hat"] = 0.0


_begin = observer_pid.begin


# All of them ------------------------------------------------------------------------------------------------


def bearing(how: Callable[[float, float], float]) -> Reading:
    """Return another way to count the turns of the bearing."""
    see = _rebuilt(robot_view._see, kinematics=_with(kinematics, unwrapped=how))
    own = law(robot_view=_with(robot_view, see=_rebuilt(robot_view.see, _see=see)))
    return replace(own, may_be_idle=True)  # where no follower sees its leader straight behind


WRAPPED, AS_PRINTED = bearing(_wrapped), bearing(_as_printed)
LAW = {
    "x_w: e alone (all 13 entries)": network_input(_error_alone),
    "x_w: q̇_d in place of the estimated rate": network_input(_desired_rate),
    # Idle where a tick never leads beyond the bound
    "weights beyond their bound: not scaled back, (29) alone (scaled)": replace(
        weight_step(_never_scaled), may_be_idle=True
    ),
    "weights beyond their bound: scaled back, without (29)": weight_step(_only_scaled),
    "bearing within ±180° (unwrapped)": WRAPPED,
    "bearing as (7) has it, atan2 less the steering angle": AS_PRINTED,
    "observer updated before the torque (after it)": OBSERVER_FIRST,
    "observer: q̂(0) = 0 (q(0))": Reading(patches={(ObserverPid, "begin"): staticmethod(_begin_at_zero)}),
}
TRACTOR_TRAILER_LAW = {
    "x_w: θ_0d in place of γ_d (θ_0d − θ_1d)": law(steering_angle=_tractor_heading),
    "x_w: nothing in place of γ_d": network_input(_no_steering),
    **LAW,
}
STEADY = "leader at its final speed from the start (at rest)"


def readings(path: Path, folder: Path) -> dict[str, Reading]:
    """Return the readings for a scenario."""
    of_law = TRACTOR_TRAILER_LAW if path.stem == TRACTOR_TRAILER else LAW
    return {"as read": Reading(), STEADY: steady_leader(path, folder), **of_law}


LONG = {
    "observer updated before the torque, 1000 s": Reading([set_horizon(1000)], OBSERVER_FIRST.patches),
    **{
        f"W_m = {W_m:,}{how}, 150 s": replace(reading, changes=(set_horizon(150), *gain(W_m=W_m)))
        for W_m in (3_000, 10_000, 100_000, 1_000_000)
        for how, reading in ((", bearing unwrapped", Reading()), (", bearing as (7) has it", AS_PRINTED))
    },
}
"""Of `clmr_line_as_printed`."""


def outcome_of(path: Path, reading: Reading) -> Outcome:
    """Return the worst outcome of the seeds with one reading changed."""
    try:
        for (place, name), other in reading.patches.items():
            patcher = patch.object(place, name, other)
            patcher.start()
        return worst(outcome(reading.scenario or path, reading.changes, seed) for seed in SEEDS)
    finally:
        patch.stopall()


@cache
def without_patches(path: Path, changes: tuple[str | Change, ...]) -> Outcome:
    """Return the worst outcome of the seeds with the law as it is."""
    return outcome_of(path, Reading(changes))


def checked_outcome(path: Path, label: str, reading: Reading) -> Outcome:
    """Return the worst outcome of the seeds with one reading changed.

    Raises
    ------
    RuntimeError
        If the reading changes no bit of the runs, and must.
    """
    if not (reading.patches or reading.scenario):
        return without_patches(path, tuple(reading.changes))
    own = outcome_of(path, reading)
    if not reading.may_be_idle and own.bits == without_patches(path, tuple(reading.changes)).bits:
        raise RuntimeError(f"{path.stem}, {label}: this reading changes no bit of the runs: does its patch still act?")
    return own


def main() -> None:
    """Print a table for each scenario, and the long runs."""
    parser = argparse.ArgumentParser(description="Readings of the paper that no scenario can state.")
    parser.add_argument("files", nargs="*", default=[*FILES, TRACTOR_TRAILER], metavar="SCENARIO")
    with TemporaryDirectory() as folder:
        for file in parser.parse_args().files:
            path = SCENARIOS / f"{file}.xml"
            print(f"\n{file}\n\n{heading('reading', *HEADER)}")
            for label, reading in readings(path, Path(folder)).items():
                print(row(label, *checked_outcome(path, label, reading).cells()), flush=True)
    print(f"\nThe first simulation as printed, longer\n\n{heading('reading', *HEADER)}")
    for label, reading in LONG.items():
        print(row(label, *checked_outcome(SCENARIOS / f"{FILES[0]}.xml", label, reading).cells()), flush=True)


if __name__ == "__main__":
    main()
