"""How much each reading of the paper matters, for the first three simulations.

    python studies/sensitivity.py

prints, for each scenario, the worst of four followers and of the seeds 1 to 3 with one reading changed at a time.
"""

import math
from unittest.mock import patch

from formation_controllers import Desired, Leader
from formation_controllers.interface import Floats
from formation_controllers.observer_pid import ObserverPid
from variation import HEADER, SCENARIOS, extra_gain, gain, heading, outcome, parameter, row, worst

SEEDS = range(1, 4)
FILES = ("clmr_line_as_printed", "clmr_line", "clmr_circle_as_printed", "clmr_circle")
TRACTOR_TRAILER = "tractor_trailer_circle"


def noise(millimetres: float) -> list[str]:
    """Return the changes to another standard deviation of the noise: [mm] of positions, [mrad] of angles."""
    angles = '//noise/@*[name() != "x" and name() != "y"]'
    return [f"//noise/@x={millimetres:g} mm", f"//noise/@y={millimetres:g} mm", f"{angles}={millimetres:g} mrad"]


def damping(value: float) -> list[str]:
    """Return the changes to another damping of every coordinate of the tractor-trailer."""
    units = ("N.s/m", "N.s/m", "N.m.s/rad", "N.m.s/rad")
    return [change for j, unit in enumerate(units, 1) for change in parameter(f"d_m{j}", f"{value:g} {unit}")]


LINE = gain(gamma_theta=0.5, theta_m=10, gamma_w=10, W_m=1000)
READINGS = {
    "as read": [],
    "drive: front wheel (as printed)": parameter("drive", "front_wheel"),
    "drive: rear wheel": parameter("drive", "rear_wheel"),
    "no noise (1 mm, 1 mrad)": noise(0),
    "noise 10 mm, 10 mrad": noise(10),
    "plant by Dormand-Prince 4(5) (Euler 20 ms)": parameter("solver", "dormand_prince_45"),
    "plant by Runge-Kutta 4, step 20 ms": parameter("solver", "runge_kutta_4"),
    "plant and controller at 10 ms (20 ms)": ["//simulation/@step=10 ms", *parameter("solver_step", "10 ms")],
    "plant and controller at 5 ms": ["//simulation/@step=5 ms", *parameter("solver_step", "5 ms")],
    "no saturation (200 N.m)": ["//saturation/@limit=1e9 N.m"],
    "saturation 100 N.m": ["//saturation/@limit=100 N.m"],
    "adaptation and integrals held beyond 200 N.m (go on)": extra_gain("torque_limit", 200),
    "exponent over 2 λ² (λ²)": extra_gain("widths", 10 * math.sqrt(2)),
    "exponent over λ": extra_gain("widths", math.sqrt(10)),
}


TRACTOR_TRAILER_READINGS = {
    "as read": [],
    "damping 5 (25)": damping(5),
    "damping 10": damping(10),
    "damping 50": damping(50),
    "gains of the line (of the circle)": LINE,
    "gains of the line, damping 5": [*LINE, *damping(5)],
    "no noise (1 mm, 1 mrad)": noise(0),
    "noise 10 mm, 10 mrad": noise(10),
    "plant by Runge-Kutta 4, step 20 ms (Euler)": parameter("solver", "runge_kutta_4"),
}


def main() -> None:
    """Print a table for each scenario."""
    for file in FILES:
        path = SCENARIOS / f"{file}.xml"
        print(f"\n{file}\n")
        print(heading("reading", *HEADER))
        for label, changes in READINGS.items():
            print(row(label, *worst(outcome(path, changes, seed) for seed in SEEDS).cells()), flush=True)
        with patch.object(ObserverPid, "on_start", _start_at_zero):
            runs = [outcome(path, [], seed) for seed in SEEDS]
        print(row("observer: q_hat(0) = 0 (q(0))", *worst(runs).cells()), flush=True)
    print(f"\n{TRACTOR_TRAILER}\n")
    print(heading("reading", *HEADER))
    for label, changes in TRACTOR_TRAILER_READINGS.items():
        runs = [outcome(SCENARIOS / f"{TRACTOR_TRAILER}.xml", changes, seed) for seed in SEEDS]
        print(row(label, *worst(runs).cells()), flush=True)


_on_start = ObserverPid.on_start


def _start_at_zero(controller: ObserverPid, pose: Floats, leader: Leader, desired: Desired) -> None:
    """Start the observer at zero instead of at q; no gain of the law does that."""
    _on_start(controller, pose, leader, desired)
    controller._state["q_hat"] = 0.0


if __name__ == "__main__":
    main()
