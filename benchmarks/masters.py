"""Masters compared on the same plants in one run: the cost per FMU and step, and of the whole closed loop.

    pip install -e controllers -e ".[bench]"
    python benchmarks/masters.py [--robots N...] [--followers N...] [--rounds N] [--masters NAME...] [--out DIR]

Compared are our master, FMPy's own methods in a Python loop, ecos and libcosim (both C++, by their Python packages) and
CoFmuPy; and a loop in C without any master, which none can beat. Each runs in a process of its own, on one processor
core, the same for all, and sees no other: ecos (TBB) and libcosim have as many threads as they see cores, and waiting
for those costs more than such plants do. Both are also measured on all cores, as they come. The wheels are what their
projects release; logging is off; all step by a fixed-step algorithm.

1. A plant that does nothing, idle_plant/: set 2 inputs, step, get 6 outputs, record. What it takes is the master's own.
2. The same with the car-like robot in its FMU, by Euler's method.
   In both a master runs by its own loop with torques that are held, but set at every step, and records in its own way:
   our master and the C loop in an array, FMPy's loop, libcosim and CoFmuPy in memory. ecos can record in a text file
   alone ("ecos, CSV"); as "ecos" it fetches the outputs at every step and records nothing. "ours, tick by tick" is
   called once a tick from Python. Before, all compute the same motion, and what they have recorded of it is compared.
3. The closed loop of scenarios/clmr_line.xml: the same noise, control law, saturation and records around each master,
   by its Python interface, tick by tick; and the harness as `formation run` runs it, in compiled code. closed_loop.py
   measures its parts, and the same loop in C. Larger teams are copies of the four followers. All must have the
   harness's motion.

Not compared: start-up, memory, step-size control, algebraic loops, plants large enough for several cores, and other
features of masters. CoFmuPy needs an older FMPy: it has a virtual environment of its own in the cache folder.

CoFmuPy sets all inputs of an FMU, so four more of the car-like robot. libcosim rounds time to nanoseconds, which the
motion tells by 1e-14.

Figures are medians over rounds in which the masters take turns. Written are masters.json and masters.png. All of it
takes about five minutes.
"""

import argparse
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from field import Entry, Field, Worker
from teams import STEP, sensor_noise, team_scenario

import plants
from cosim.master.setup import set_up
from cosim.scenario.reader import read_scenario
from plants.factory import store
from plants.factory.compile import compile_library, find_compiler
from plants.factory.platforms import host

HERE = Path(__file__).parent
ROUND = 0.1  # duration of a round of one master, about [s]
MOST_SAMPLES = 200_000  # FMUs times ticks in a round
LOOP_TICKS = {1: 500, 10: 300, 100: 60, 1000: 12}  # of a round of the closed loop, from that many followers on

FLOOR, OURS = "C loop, no master", "ours"
HARNESS = "formation run"
_COFMU = {"most": 101, "why": "it unpacks the FMU once for each robot"}
ENTRIES = (
    Entry(FLOOR, "c_loop"),
    Entry(OURS, "ours"),
    Entry("ours, tick by tick", "ours", {"by_tick": True}),
    Entry("FMPy", "fmpy_methods"),
    Entry("ecos", "ecos"),
    Entry("ecos, CSV", "ecos", {"csv": True}, agreement=1e-4),  # of the six digits that it writes
    Entry("ecos, all cores", "ecos", all_cores=True),
    Entry("libcosim", "libcosim"),
    Entry("libcosim, all cores", "libcosim", all_cores=True),
    Entry("CoFmuPy", "cofmu", **_COFMU),
)
LOOP_ENTRIES = (
    Entry(HARNESS, "simulation"),
    Entry(FLOOR, "c_loop"),
    Entry(OURS, "ours"),
    Entry("FMPy", "fmpy_methods"),
    Entry("ecos", "ecos", {"closed_loop": True}),
    Entry("libcosim", "libcosim", {"closed_loop": True}),
    Entry("CoFmuPy", "cofmu", **_COFMU),
)

COLOURS = {
    OURS: "C0",
    HARNESS: "black",
    FLOOR.partition(",")[0]: "C7",
    "FMPy": "C1",
    "ecos": "C2",
    "libcosim": "C3",
    "CoFmuPy": "C4",
}

Costs = dict[int, dict[str, float]]  # by number of robots and by master


def say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


# Plants -----------------------------------------------------------------------------------------------------


def idle_plant(folder: Path) -> Path:
    """Return an FMU, made in a folder, that is like the car-like robot's but whose step does nothing."""
    root = folder / "idle_plant"
    shutil.copytree(HERE / "idle_plant", root)
    headers = Path(fmpy.__file__).parent / "c-code"
    library = compile_library(find_compiler(), host(), root, ["idle_car.c"], "idle_car", [f"-I{headers}"])
    path = folder / "idle_car.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.write(root / "modelDescription.xml", "modelDescription.xml")
        archive.writestr(f"binaries/{host().fmi2}/idle_car{host().suffix}", library)
    return path


def cofmupy_python() -> str:
    """Return the interpreter of CoFmuPy's environment, made now or before; nothing if it cannot be made."""
    folder = store.folder() / "benchmarks" / "cofmupy"
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    check = [str(python), "-c", "import cofmupy, formation_controllers"]
    if python.exists() and subprocess.run(check, capture_output=True, check=False).returncode == 0:
        return str(python)
    say(f"installing CoFmuPy in {folder}")
    for command in (
        [sys.executable, "-m", "venv", "--clear", str(folder)],
        [str(python), "-m", "pip", "install", "--quiet", "cofmupy", str(HERE.parent / "controllers")],
        check,
    ):
        result = subprocess.run(command, capture_output=True, text=True, check=False)
        if result.returncode != 0:
            lines = result.stderr.strip().splitlines() or ["no message"]
            why = next((line for line in lines if line.strip().startswith("ERROR")), lines[-1]).strip()
            print(f"CoFmuPy is left out: {' '.join(command[:4])} ... failed: {why}")
            return ""
    return str(python)


# One and two: the master's own cost, and with the real plant ------------------------------------------------


def held_job(fmu: Path, robots: int, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the job of every master: robots that drive on circles, each its own."""
    start = [{"x": float(i), "psi": 0.01 * (i % 100), "gamma": 0.1 + 0.001 * (i % 10)} for i in range(robots)]
    torque = [[8.0 + 0.1 * (i % 7), 0.0] for i in range(robots)]
    samples = max(MOST_SAMPLES // robots, 50)
    return {
        "fmu": str(fmu),
        "start": start,
        "torque": torque,
        "step": STEP,
        "samples": samples,
        "options": dict(options),
    }


def check_motion(fmu: Path, pythons: Mapping[str, str], entries: Sequence[Entry]) -> None:
    """Say how far the motions are apart that the masters have computed and recorded."""
    robots, ticks = 4, 500
    with Field(entries, pythons, robots) as field:

        def motion(worker: Worker) -> dict[str, np.ndarray]:
            worker.ask("start", job=held_job(fmu, robots, worker.entry.options))
            worker.seconds(ticks)
            return worker.record(ticks)

        motions = field.each(motion)
        agreements = {name: worker.entry.agreement for name, worker in field.workers.items()}
    if FLOOR not in motions:
        raise SystemExit("without the C loop there is nothing to compare with")
    expected = motions[FLOOR]["recorded"]
    moved = np.abs(expected[-1] - expected[0]).max(axis=0)
    print(f"the same motion of {robots} robots over {ticks} steps, whose outputs change by {moved.min():.2g} and more:")
    for name, own in motions.items():
        last = np.abs(own["outputs"] - expected[-1]).max()
        if "recorded" not in own:
            print(f"  {name:22} last outputs apart by {last:.1g}; nothing recorded")
        else:
            apart = np.abs(own["recorded"] - expected).max()
            print(f"  {name:22} last outputs apart by {last:.1g}, records by {apart:.1g}")
            last = max(last, apart)
        if not last <= agreements[name]:
            raise SystemExit(f"{name} has computed another motion: a comparison would mean nothing")


def plant_costs(
    fmu: Path, robots: int, rounds: int, pythons: Mapping[str, str], entries: Sequence[Entry]
) -> tuple[dict[str, float], dict[str, str]]:
    """Return the seconds per FMU and step of every master, and why some have none."""
    with Field(entries, pythons, robots) as field:
        field.each(lambda worker: worker.ask("start", job=held_job(fmu, robots, worker.entry.options)))
        ticks = field.each(lambda worker: enough_ticks(worker, samples_of(robots)))

        def measure(worker: Worker) -> float:
            n = ticks[worker.entry.name]
            return worker.seconds(n) / n / robots

        return field.take_turns(rounds, measure), field.out


def samples_of(robots: int) -> int:
    return max(MOST_SAMPLES // robots, 100)


def enough_ticks(worker: Worker, most: int) -> int:
    """Return how many ticks make a round; the master is warm then."""
    ticks, seconds = 2, worker.seconds(2)
    while (seconds := worker.seconds(ticks)) < ROUND / 4 and ticks < most:
        ticks = min(4 * ticks, most)
    return min(max(round(ticks * ROUND / seconds), 2), most)


# Three: the closed loop -------------------------------------------------------------------------------------


def loop_job(scenario_path: Path, ticks: int, folder: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the scenario's plants as a job, and the rest of its closed loop as numbers."""
    scenario = read_scenario(scenario_path)
    with ExitStack() as cleanup:
        setup = set_up(scenario, cleanup, {})
        robots = (setup.leader, *setup.followers)
        noise = sensor_noise(scenario, robots, ticks)
        (controller,) = scenario.controllers.values()
        vehicle = setup.followers[0].vehicle
        limit = setup.followers[0].actuator[0].amount
        job = {
            "fmu": str(setup.leader.fmu.path),
            "start": [dict(zip((role.name for role in robot.kind.pose), robot.pose, strict=True)) for robot in robots],
            "torque": [[0.0, 0.0]] * len(robots),
            "step": scenario.step,
            "samples": 1,
        }
        loop = {
            "controller": controller.name,
            "gains": {gain.name: float(gain.value) for gain in controller.gains},
            "vehicle": {name: getattr(vehicle, name) for name in setup.leader.kind.geometry},
            "desired": setup.desired.q[0].tolist(),
            "leader_torque": setup.leader.torque[0].tolist(),
            "limit": limit,
            "step": scenario.step,
            "noise": str(folder / "noise.npy"),
        }
    np.save(loop["noise"], noise)
    return job, loop


def loop_costs(
    followers: int, rounds: int, pythons: Mapping[str, str], entries: Sequence[Entry], folder: Path
) -> tuple[dict[str, float], dict[str, str]]:
    """Return the seconds per tick of the closed loop under every master, and why some have none."""
    ticks = LOOP_TICKS[max(least for least in LOOP_TICKS if least <= followers)]
    total = (rounds + 1) * ticks
    scenario = team_scenario(followers, total + 1, folder)
    job, loop = loop_job(scenario, total, folder)
    with Field(entries, pythons, 1 + followers) as field:

        def measure(worker: Worker) -> float:
            return worker.seconds(ticks) / ticks

        def begin(worker: Worker) -> None:
            own = {**job, "options": {**worker.entry.options, "scenario": str(scenario)}}
            worker.ask("start", job=own, loop=None if worker.entry.driver == "simulation" else loop)
            measure(worker)  # warm

        field.each(begin)
        costs = field.take_turns(rounds, measure)
        motions = field.each(lambda worker: worker.record(total)["recorded"])
    apart = {name: float(np.abs(own - motions[HARNESS]).max()) for name, own in motions.items()}
    print(
        f"{followers} followers, {total} ticks: motions apart from the harness's by at most {max(apart.values()):.1g}"
    )
    for name, distance in apart.items():
        if not distance <= 1e-9:
            raise SystemExit(f"{name} has another motion, by {distance:.2g}: a comparison would mean nothing")
    return costs, field.out


# The report ------------------------------------------------------------------------------------------------


def print_table(title: str, costs: Costs, base: str) -> None:
    """Print microseconds, each with its ratio to one of them."""
    names = list(dict.fromkeys(name for own in costs.values() for name in own))
    print(f"\n{title} [us], and as a ratio to {base!r}\n")
    print(f"{'':22}" + "".join(f"{n:>22}" for n in costs))
    for name in names:
        cells = ""
        for own in costs.values():
            ratio = f"{own[name] / own[base]:.3g}" if name in own and base in own else ""
            cells += f"{own[name] * 1e6:>12.3f} {ratio:>9}" if name in own else f"{'-':>22}"
        print(f"{name:22}{cells}")


def print_absences(absences: dict[int, dict[str, str]]) -> None:
    for n, out in absences.items():
        for name, why in out.items():
            print(f"{name}, {n}: {why}")


def print_targets(idle: Costs, loop: Costs) -> None:
    """Print the targets of the master next to the measured costs."""
    print()
    for name, times in (("ecos", 5), ("FMPy", 30)):
        ratios = {n: own[name] / own[OURS] for n, own in idle.items() if {name, OURS} <= own.keys()}
        if ratios:
            told = ", ".join(f"{ratio:.3g} with {n}" for n, ratio in ratios.items())
            print(f"{_verdict(min(ratios.values()) >= times)}  {name} costs at least {times} times ours: {told}")
    if len(idle) > 1 and all(OURS in own for own in idle.values()):
        few, many = sorted(idle)[-2:]
        growth, floor = (idle[many][name] / idle[few][name] for name in (OURS, FLOOR))
        told = f"per FMU {growth:.2f} times what it is with {few}; the C loop {floor:.2f} times"
        print(f"{_verdict(growth < 1.5 * max(floor, 1.0))}  linear up to {many}, but for the memory's speed: {told}")
    ours = {HARNESS, OURS, FLOOR}  # the C loop is no master
    others = {n: min(own[name] for name in own.keys() - ours) for n, own in loop.items() if own.keys() - ours}
    if others:
        ratios = {n: cost / loop[n][HARNESS] for n, cost in others.items()}
        told = ", ".join(f"{ratio:.3g} with {n} followers" for n, ratio in ratios.items())
        print(
            f"{_verdict(min(ratios.values()) >= 2)}  the loop around any other master costs at least twice ours: {told}"
        )


def _verdict(holds: bool) -> str:
    return "holds    " if holds else "not held "


def draw(panels: Mapping[str, Costs], path: Path) -> None:
    """Draw cost over number of robots, one line a master."""
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    names = list(dict.fromkeys(n for costs in panels.values() for own in costs.values() for n in own))
    figure, axes = plt.subplots(1, len(panels), figsize=(5.2 * len(panels), 5.6), squeeze=False, layout="constrained")
    for ax, (title, costs) in zip(axes[0], panels.items(), strict=True):
        for name in names:
            points = [(n, own[name] * 1e6) for n, own in costs.items() if name in own]
            if not points:
                continue
            base, _, variant = name.partition(",")
            style = {"": "-", " CSV": ":", " all cores": "--"}.get(variant, "-.")
            width = 2.6 if name in (OURS, HARNESS) else 1.5
            ax.loglog(*zip(*points, strict=True), style, marker="o", ms=4, lw=width, color=COLOURS[base], label=name)
        ax.set_title(title, fontsize=11)
        ax.set_xticks(list(costs), [f"{n:,}" for n in costs])
        ax.minorticks_off()
        ax.grid(alpha=0.3)
        ax.set_ylabel("cost per robot and step [µs]")
        ax.set_xlabel("followers, and a leader" if "loop" in title else "robots")
    handles = {label: handle for ax in axes[0] for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=2 + len(panels), fontsize=9)
    figure.savefig(path, dpi=150)


def machine() -> str:
    """Return the machine of this run and its load."""
    model = platform.processor() or platform.machine()
    if (about := Path("/proc/cpuinfo")).exists():
        model = next((x.partition(":")[2].strip() for x in about.read_text().splitlines() if "model name" in x), model)
    load = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    return f"{model}, {os.cpu_count()} cores{load}, Python {platform.python_version()}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", type=int, nargs="*", default=[1, 4, 10, 100, 1000])
    parser.add_argument("--followers", type=int, nargs="*", default=[4, 10, 100, 1000])
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--masters", nargs="+", metavar="NAME", help="only these, besides ours")
    parser.add_argument("--out", type=Path, default=HERE / "results", metavar="DIR")
    options = parser.parse_args()

    def wanted(entries: Sequence[Entry]) -> list[Entry]:
        always = {FLOOR, OURS, HARNESS}
        return [e for e in entries if not options.masters or e.name in always | {*options.masters}]

    pythons = {}
    if any(entry.driver == "cofmu" for entry in wanted(ENTRIES)):
        pythons["cofmu"] = cofmupy_python()
    print(machine())
    idle, real, loop = {}, {}, {}
    out: dict[str, dict[int, dict[str, str]]] = {"idle": {}, "real": {}, "loop": {}}
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        plant, nothing = plants.build("car_like"), idle_plant(folder)
        check_motion(plant, pythons, wanted(ENTRIES))
        for n in options.robots:
            for which, costs, fmu in (("idle", idle, nothing), ("real", real, plant)):
                say(f"{n} robots, {which} plant")
                costs[n], out[which][n] = plant_costs(fmu, n, options.rounds, pythons, wanted(ENTRIES))
        for n in options.followers:
            say(f"closed loop, {n} followers")
            loop[n], out["loop"][n] = loop_costs(n, options.rounds, pythons, wanted(LOOP_ENTRIES), folder)

    if idle:
        print_table("1. A plant that does nothing, per FMU and step, by number of robots", idle, OURS)
        print_absences(out["idle"])
        print_table("2. The car-like robot, per FMU and step, by number of robots", real, OURS)
        print_absences(out["real"])
    if loop:
        print_table("3. The closed loop, per tick, by number of followers", loop, HARNESS)
        print_absences(out["loop"])
    print_targets(idle, loop)

    options.out.mkdir(parents=True, exist_ok=True)
    panels = {
        "A plant that does nothing: the master alone": idle,
        "The car-like robot, Euler step": real,
        "The closed loop, controllers included": {
            n: {name: seconds / (1 + n) for name, seconds in own.items()} for n, own in loop.items()
        },
    }
    draw({title: costs for title, costs in panels.items() if costs}, options.out / "masters.png")
    results = {"machine": machine(), "seconds": {"idle": idle, "real": real, "loop": loop}, "absent": out}
    (options.out / "masters.json").write_text(json.dumps(results, indent=1) + "\n")
    print(f"\nwritten: {options.out}/masters.png, masters.json")


if __name__ == "__main__":
    main()
