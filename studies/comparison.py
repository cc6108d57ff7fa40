"""Figure 10's comparison, made fair: both laws tuned alike, and judged on other seeds and conditions.

    python studies/comparison.py             # tables and figures from studies/comparison.json
    python studies/comparison.py --judge     # judge again the gains that were found
    python studies/comparison.py --search    # search again, too: the same seeds, the same numbers

Decided before the first search: the gains to tune (`LAWS`), the cost (`itae`), the seeds of
the noise, and that the law with the smaller ITAE on the other seeds has tracked better. `quadratic` is a second cost of
another kind, searched once, to see whether the verdict depends on the cost. Needs SciPy 1.15 or later.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from scipy.optimize import differential_evolution
from scipy.stats import qmc

import cosim
from cosim.results.summary import summarise
from cosim.scenario.edits import Change, as_changes, set_controller, set_seed

ROOT = Path(__file__).resolve().parent.parent
RESULTS = Path(__file__).with_suffix(".json")
FIGURES = ROOT / "docs" / "figures"

TUNING_SEEDS = (1, 2)
TUNING_HORIZON = 60.0  # s; the runs that judge have the scenario's 100 s
JUDGING_SEEDS = tuple(range(101, 121))
RESTARTS = (1, 2, 3)  # seeds of the search
MEMBERS, GENERATIONS = 16, 20  # 16 * 20 = 320 evaluations a restart, of two runs each
FEEDBACK, ADAPTATION = 10.0, 100.0  # a gain is searched within its start divided and multiplied by this


@dataclass(frozen=True)
class Tuned:
    """A gain that is tuned, one of its entries: where the search starts, and the factor that it may move by."""

    name: str
    start: float
    factor: float


@dataclass(frozen=True)
class Law:
    """A law, its scenario, and its eight tuned entries of gains."""

    label: str
    scenario: str
    colour: str
    tuned: tuple[Tuned, ...]


LAWS = {
    "neural-adaptive-pid": Law(
        "neural adaptive PID",
        "compare_neural_pid",
        "tab:blue",
        (
            Tuned("K_p", 10.0, FEEDBACK),
            Tuned("K_p", 10.0, FEEDBACK),
            Tuned("Lambda_0", 2.0, FEEDBACK),
            Tuned("Lambda_1", 0.05, FEEDBACK),
            Tuned("k_d", 10.0, FEEDBACK),
            Tuned("epsilon_t", 10.0, FEEDBACK),
            Tuned("gamma_w", 10.0, ADAPTATION),
            Tuned("W_m", 1000.0, ADAPTATION),
        ),
    ),
    "neural-high-gain": Law(
        "neural high-gain",
        "compare_high_gain",
        "tab:orange",
        (
            Tuned("K_1", 0.6, FEEDBACK),
            Tuned("K_1", 0.6, FEEDBACK),
            Tuned("K_2", 60.0, FEEDBACK),
            Tuned("K_2", 60.0, FEEDBACK),
            Tuned("epsilon", 0.1, FEEDBACK),
            Tuned("gamma_1", 2.0, FEEDBACK),
            Tuned("Gamma", 10.0, ADAPTATION),
            Tuned("sigma", 0.01, ADAPTATION),
        ),
    ),
}
"""All gains of the comparator are tuned. Of the paper's law, Lambda_0 and Lambda_1 stay multiples of the identity
and gamma_theta and theta_m stay as printed: once theta is at its bound, the robust term acts on small errors as
theta_m^2/epsilon_t, which epsilon_t covers. Gains given twice are pairs (range, bearing).
"""

UNTUNED = ("observer-pid", "feedback-linearisation", "lqg")

CONDITIONS: dict[str, tuple[str, ...]] = {
    "as tuned": (),
    "noise x 5": ("//noise/@x=5 mm", "//noise/@y=5 mm", "//noise/@psi=5 mrad", "//noise/@gamma=5 mrad"),
    "masses +50 %": (
        '//parameter[@name="m_c"]/@value=45 kg',
        '//parameter[@name="I_c"]/@value=7.5 kg.m2',
        '//parameter[@name="I_f"]/@value=15 kg.m2',
    ),
    "damping -50 %": (
        '//parameter[@name="d_x" or @name="d_y"]/@value=12.5 N.s/m',
        '//parameter[@name="d_psi" or @name="d_gamma"]/@value=12.5 N.m.s/rad',
    ),
    "leader on a circle": ("//leader/pose/@gamma=0.1 rad",),
    "other starts": ("//follower/pose/@x=-7 m", "//follower/pose/@psi=30 deg"),
}
"""Conditions of the judgement. The plant is shared: changed masses and damping are the leader's, too."""


# Runs -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Run:
    """A run's scenario and result, and when it failed [s], if it did; None where the law refused its gains."""

    scenario: cosim.Scenario | None
    result: xr.Dataset | None
    failed: float | None


def run(law: str, gains: Mapping[str, str], changes: Iterable[str | Change], seed: int) -> Run:
    """Run a law in its scenario of the comparison; a law without one runs in the scenario of the paper's law."""
    own = LAWS.get(law)
    file = ROOT / "scenarios" / f"{own.scenario if own else LAWS['neural-adaptive-pid'].scenario}.xml"
    other = () if own else (set_controller("law", law, "formation-controllers", version("formation-controllers")),)
    values = [f'//gain[@name="{name}"]/@value={value}' for name, value in gains.items()]
    scenario = cosim.read_scenario(file, [*other, *values, *changes, set_seed(seed)])
    try:
        return Run(scenario, cosim.run(scenario), None)
    except cosim.SimulationError as error:
        return Run(scenario, error.result, error.time)
    except cosim.InputError:
        if not gains:
            raise
        return Run(None, None, 0.0)  # the comparator refuses observers that its Euler steps make unstable


def written(law: str, logarithms: Sequence[float]) -> dict[str, str]:
    """Return the gains as a scenario has them, to three digits."""
    gains: dict[str, str] = {}
    for tuned, value in zip(LAWS[law].tuned, logarithms, strict=True):
        digits = f"{10**value:.3g}"
        gains[tuned.name] = f"{gains[tuned.name]} {digits}" if tuned.name in gains else digits
    return {name: " ".join(format(float(v), "g") for v in value.split()) for name, value in gains.items()}


# Costs ------------------------------------------------------------------------------------------------------


def itae(result: xr.Dataset) -> np.ndarray[Any, Any]:
    """Return the time-weighted absolute error of each follower, as a mean: 1 is one settling band all the time.

    The bands are 0.1 m and 2 degrees, as in a run's summary; range and bearing add up.
    """
    time = result["time"].values
    error = np.abs(result["range_error"].values) / 0.1 + np.abs(result["bearing_error"].values) / math.radians(2)
    return np.asarray((time[:, np.newaxis] * error).sum(axis=0) / time.sum())


def quadratic(result: xr.Dataset) -> np.ndarray[Any, Any]:
    """Return the mean of squared errors and torques of each follower; 1 m, 20 degrees and 100 N.m weigh one each."""
    error = result["range_error"].values ** 2 + (result["bearing_error"].values / math.radians(20)) ** 2
    return np.asarray((error + (result["torque"].values ** 2).sum(axis=2) / 100**2).mean(axis=0))


COSTS: dict[str, Callable[[xr.Dataset], np.ndarray[Any, Any]]] = {"itae": itae, "quadratic": quadratic}
NOT_SETTLED, FAILED = 10.0, 100.0  # added for a follower that does not settle; of a run that fails, the sooner the more


def cost(law: str, kind: str, logarithms: Sequence[float]) -> float:
    """Return the mean cost over followers and tuning seeds, with penalties."""
    total = 0.0
    for seed in TUNING_SEEDS:
        one = run(law, written(law, logarithms), as_changes((), TUNING_HORIZON, expectations=False), seed)
        if one.failed is not None:
            total += FAILED * (2 - one.failed / TUNING_HORIZON)
            continue
        assert one.scenario is not None
        assert one.result is not None
        settled = [follower.settling_time is not None for follower in summarise(one.scenario, one.result).followers]
        total += float(np.mean(COSTS[kind](one.result) + NOT_SETTLED * ~np.array(settled)))
    return total / len(TUNING_SEEDS)


# Search -----------------------------------------------------------------------------------------------------


def search(law: str, kind: str, restart: int) -> dict[str, Any]:
    """Search the gains by differential evolution in logarithms; the first member is where the law starts from."""
    tuned = LAWS[law].tuned
    start = np.log10([one.start for one in tuned])
    reach = np.log10([one.factor for one in tuned])
    members = qmc.scale(
        qmc.Sobol(len(tuned), rng=np.random.default_rng(restart)).random(MEMBERS), start - reach, start + reach
    )
    members[0] = start
    history: list[float] = []

    def evaluate(logarithms: Sequence[float]) -> float:
        history.append(cost(law, kind, logarithms))
        return history[-1]

    found = differential_evolution(
        evaluate,
        list(zip(start - reach, start + reach, strict=True)),
        init=members,
        maxiter=GENERATIONS - 1,
        tol=0,
        polish=False,
        rng=np.random.default_rng(restart),
    )
    assert len(history) == MEMBERS * GENERATIONS
    print(f"{law}, {kind}, restart {restart}: {history[0]:.3f} -> {found.fun:.3f}, {written(law, found.x)}", flush=True)
    return {
        "restart": restart,
        "start": round(history[0], 4),
        "cost": round(float(found.fun), 4),
        "gains": written(law, found.x),
        "failed": sum(value >= FAILED for value in history),
        "best so far": [round(float(value), 4) for value in np.minimum.accumulate(history)[:: MEMBERS // 2]],
    }


def search_all() -> dict[str, Any]:
    """Search for both laws with both costs; the secondary cost once."""
    found: dict[str, Any] = {kind: {law: [] for law in LAWS} for kind in COSTS}
    for kind, restarts in (("itae", RESTARTS), ("quadratic", RESTARTS[:1])):
        for restart in restarts:
            for law in LAWS:
                found[kind][law].append(search(law, kind, restart))
    return found


def best(searches: Mapping[str, Any], kind: str, law: str) -> dict[str, Any]:
    """Return the restart with the least cost."""
    return dict(min(searches[kind][law], key=lambda one: one["cost"]))


# Judging ----------------------------------------------------------------------------------------------------


def figures_of(one: Run) -> dict[str, float | int | None]:
    """Return the figures of a run: means over the followers, except where the name states another figure."""
    if one.failed is not None or one.scenario is None or one.result is None:
        return {"failed": one.failed}
    result, followers = one.result, summarise(one.scenario, one.result).followers
    steady = result.sel(time=slice(0.8 * one.scenario.horizon, None))
    settled = [follower.settling_time for follower in followers if follower.settling_time is not None]
    crossings = sum(
        int(np.count_nonzero(np.diff(np.signbit(signal.values), axis=0)))
        for signal in result.data_vars.values()
        if "singular_at_zero" in signal.attrs
    )
    figures: dict[str, float | int | None] = {
        "failed": None,
        "settled": len(settled),
        "last settles": max(settled) if len(settled) == len(followers) else None,  # s
        "itae": float(itae(result).mean()),
        "worst itae": float(itae(result).max()),
        "quadratic": float(quadratic(result).mean()),
        "range rms": 1000 * float(np.mean([f.range_rms for f in followers])),  # mm
        "bearing rms": math.degrees(float(np.mean([f.bearing_rms for f in followers]))),
        "range rms, whole": rms(result["range_error"]),  # m
        "peak torque": max(f.peak_torque for f in followers),
        "effort": rms(result["torque"]),
        "jitter": rms(steady["torque"].diff("time")),  # N.m from tick to tick
        "crossings": crossings,
    }
    return {name: float(f"{value:.5g}") if isinstance(value, float) else value for name, value in figures.items()}


def rms(signal: xr.DataArray) -> float:
    """Return the root mean square over everything."""
    return float(np.sqrt(np.mean(signal.values**2)))


def judge(searches: Mapping[str, Any]) -> dict[str, Any]:
    """Run every judged case: figures by label, condition and seed."""
    judged: dict[str, Any] = {}

    def runs(label: str, law: str, gains: Mapping[str, str], conditions: Iterable[str], seeds: Iterable[int]) -> None:
        judged[label] = {
            name: {str(seed): figures_of(run(law, gains, CONDITIONS[name], seed)) for seed in seeds}
            for name in conditions
        }
        print(f"judged: {label}", flush=True)

    for law in LAWS:
        start = written(law, [math.log10(one.start) for one in LAWS[law].tuned])
        runs(f"{law}, start", law, start, ("as tuned",), JUDGING_SEEDS)
        runs(law, law, best(searches, "itae", law)["gains"], CONDITIONS, JUDGING_SEEDS)
        for one in searches["itae"][law]:
            label = f"{law}, restart {one['restart']}"
            if one["gains"] == best(searches, "itae", law)["gains"]:
                judged[label] = {"as tuned": judged[law]["as tuned"]}
            else:
                runs(label, law, one["gains"], ("as tuned",), JUDGING_SEEDS)
        for one in searches["quadratic"][law]:
            runs(f"{law}, quadratic", law, one["gains"], CONDITIONS, JUDGING_SEEDS)
    for law in UNTUNED:
        runs(law, law, {}, CONDITIONS, JUDGING_SEEDS[:5])
    return judged


# Report -----------------------------------------------------------------------------------------------------

COLUMNS = {  # of the tables: what, unit or explanation, digits
    "itae": ("ITAE", 3),
    "worst itae": ("worst follower's ITAE", 3),
    "last settles": ("last follower settles after [s]", 3),
    "range rms": ("range error, RMS from 80 s [mm]", 3),
    "bearing rms": ("bearing error, RMS from 80 s [deg]", 2),
    "range rms, whole": ("range error, RMS of the whole run [m]", 3),
    "quadratic": ("quadratic cost", 3),
    "peak torque": ("peak torque [N.m]", 3),
    "effort": ("torque, RMS [N.m]", 3),
    "jitter": ("change of torque a tick, RMS from 80 s [N.m]", 2),
    "crossings": ("singularities jumped over, all followers", 2),
}
PAIR = tuple(LAWS)


def values(judged: Mapping[str, Any], label: str, condition: str, name: str) -> np.ndarray[Any, Any]:
    """Return a figure over the seeds; NaN where there is none."""
    return np.array([one.get(name) for one in judged[label][condition].values()], dtype=float)


def spread(numbers: np.ndarray[Any, Any], digits: int) -> str:
    """Return mean and standard deviation over the seeds, and how many have the figure where not all do."""
    known = numbers[np.isfinite(numbers)]
    if not len(known):
        return "never"
    text = f"{known.mean():.{digits}g}"
    if np.ptp(known) > 0:
        text += f" ± {known.std(ddof=1):.1g}"
    return text if len(known) == len(numbers) else f"{text} ({len(known)} of {len(numbers)} seeds)"


def settled(judged: Mapping[str, Any], label: str, condition: str) -> str:
    """Return how many of the followers of all seeds settle, and how many runs fail."""
    runs = list(judged[label][condition].values())
    failures = sum(one["failed"] is not None for one in runs)
    text = f"{sum(one.get('settled', 0) for one in runs)} of {5 * len(runs)}"
    return f"{text} ({failures} runs fail)" if failures else text


def rows(head: Sequence[str], body: Iterable[Sequence[str]]) -> str:
    """Return a table as Markdown."""
    lines = [head, ["---"] * len(head), *body]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def figure_table(judged: Mapping[str, Any], labels: Mapping[str, str], condition: str) -> str:
    """Return all figures of some labels in one condition."""
    body = [["followers that settle", *(settled(judged, label, condition) for label in labels)]]
    body += [
        [text, *(spread(values(judged, label, condition, name), digits) for label in labels)]
        for name, (text, digits) in COLUMNS.items()
    ]
    return rows(["", *labels.values()], body)


def paired_table(judged: Mapping[str, Any], kind: str) -> str:
    """Return, by condition, the costs of both laws tuned for it, and their difference on the same seeds."""
    labels = [law if kind == "itae" else f"{law}, {kind}" for law in PAIR]
    body = []
    for condition in CONDITIONS:
        first, second = (values(judged, label, condition, kind) for label in labels)
        difference = first - second
        both = difference[np.isfinite(difference)]
        body.append(
            [
                condition,
                *(settled(judged, label, condition) for label in labels),
                *(spread(values(judged, label, condition, kind), 3) for label in labels),
                spread(difference, 2),
                f"{np.count_nonzero(both < 0)} of {len(both)}",
                *(spread(values(judged, label, condition, "jitter"), 2) for label in labels),
                *(spread(values(judged, label, condition, "crossings"), 2) for label in labels),
            ]
        )
    names = [LAWS[law].label for law in PAIR]
    head = ["condition", *(f"settle, {name}" for name in names), *(f"{kind} cost, {name}" for name in names)]
    head += ["difference", "seeds on which the paper's law is better"]
    head += [*(f"change of torque a tick, {name}" for name in names), *(f"singularities, {name}" for name in names)]
    return rows(head, body)


def search_table(searches: Mapping[str, Any], judged: Mapping[str, Any]) -> str:
    """Return the outcome of every search, and its figures on the judging seeds."""
    body = []
    for kind in COSTS:
        for law in LAWS:
            for one in searches[kind][law]:
                label = f"{law}, restart {one['restart']}" if kind == "itae" else f"{law}, {kind}"
                gains = ", ".join(f"{name} {value}" for name, value in one["gains"].items())
                cells = [kind, LAWS[law].label, str(one["restart"]), f"{one['start']:.3g}", f"{one['cost']:.3g}"]
                cells.append(spread(values(judged, label, "as tuned", kind), 3))
                body.append([*cells, settled(judged, label, "as tuned"), gains])
    return rows(["cost", "law", "restart", "start", "found", "judged", "settle", "gains"], body)


def report(study: Mapping[str, Any]) -> None:
    """Print the tables and draw the figures."""
    searches, judged = study["searches"], study["judged"]
    print(search_table(searches, judged))
    tuned = {f"{law}{state}": f"{LAWS[law].label}{state or ', tuned'}" for law in PAIR for state in (", start", "")}
    print(figure_table(judged, tuned, "as tuned"))
    for kind in COSTS:
        print(paired_table(judged, kind))
    print(figure_table(judged, {law: law for law in UNTUNED}, "as tuned"))
    FIGURES.mkdir(exist_ok=True)
    draw_study(searches, judged).savefig(FIGURES / "comparison.png", dpi=110)
    draw_runs(searches).savefig(FIGURES / "comparison_runs.png", dpi=65)


def draw_study(searches: Mapping[str, Any], judged: Mapping[str, Any]) -> Figure:
    """Return the figure of the searches and of the costs that are judged."""
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.5))
    for law, about in LAWS.items():
        for one in searches["itae"][law]:
            costs = [*one["best so far"], one["cost"]]
            label = about.label if one["restart"] == RESTARTS[0] else None
            evaluations = [*range(1, MEMBERS * GENERATIONS, MEMBERS // 2), MEMBERS * GENERATIONS]
            left.plot(evaluations, costs, color=about.colour, drawstyle="steps-post", label=label)
    left.set(
        title="(a) search: three restarts each", xlabel="evaluations", ylabel="least cost so far [1]", yscale="log"
    )
    for shift, law in zip((-0.15, 0.15), PAIR, strict=True):
        for place, condition in enumerate(CONDITIONS):
            numbers = values(judged, law, condition, "itae")
            jitter = np.linspace(-0.08, 0.08, len(numbers))
            label = LAWS[law].label if place == 0 else None
            right.plot(place + shift + jitter, numbers, ".", color=LAWS[law].colour, markersize=5, label=label)
    right.set(title=f"(b) tuned laws on {len(JUDGING_SEEDS)} other seeds", ylabel="ITAE [1]", yscale="log")
    right.set_xticks(range(len(CONDITIONS)), [name.replace(" ", "\n", 1) for name in CONDITIONS])
    for axes in (left, right):
        axes.grid(alpha=0.3, which="both")
        axes.legend()
    return figure


def draw_runs(searches: Mapping[str, Any]) -> Figure:
    """Return the panels of Figure 10, of the tuned laws on the first of the judging seeds."""
    figure = Figure(figsize=(11, 13), layout="constrained")
    grid = figure.subplots(5, 2, height_ratios=(2, 1, 1, 1, 1), sharey="row")
    for column, law in zip(grid.T, PAIR, strict=True):
        one = run(law, best(searches, "itae", law)["gains"], (), JUDGING_SEEDS[0])
        result = one.result
        assert result is not None
        time = result["time"].values
        paths = column[0]
        paths.plot(*result["leader_pose"].values[:, :2].T, "k--", linewidth=1.2, label="leader")
        for robot in result["robot"].values:
            paths.plot(*result["pose"].sel(robot=robot).values[:, :2].T, linewidth=1, label=str(robot))
        paths.set(title=f"(a) {LAWS[law].label}, tuned", xlabel="x [m]", ylabel="y [m]")
        paths.set_aspect("equal", adjustable="datalim")
        signals = {
            "(b) range error [m]": result["range_error"],
            "(b) bearing error [deg]": result["bearing_error"] * (180 / math.pi),
            "(c) drive torque [N.m]": result["torque"].isel(torque_component=0),
            "(c) steering torque [N.m]": result["torque"].isel(torque_component=1),
        }
        for axes, (label, signal) in zip(column[1:], signals.items(), strict=True):
            axes.plot(time, signal.values, linewidth=0.8)
            axes.set_xscale("symlog", linthresh=1)
            axes.set(ylabel=label, xlim=(0, time[-1]))
            axes.set_xticks([0, 1, 2, 5, 10, 20, 50, 100], ["0", "1", "2", "5", "10", "20", "50", "100"])
        column[-1].set_xlabel("time [s], logarithmic from 1 s")
        for axes in column:
            axes.grid(alpha=0.3)
    grid[0, 0].legend(fontsize="small")
    return figure


def main() -> None:
    """Run the steps that the command line names."""
    parser = argparse.ArgumentParser(description="The comparison of Figure 10, tuned and judged alike.")
    parser.add_argument("--search", action="store_true", help="search the gains again (some 20 minutes)")
    parser.add_argument("--judge", action="store_true", help="run again what is judged (some 5 minutes)")
    parser.add_argument("--report", action="store_true", help="tables and figures only, which is the default")
    asked = parser.parse_args()
    study = json.loads(RESULTS.read_text()) if not asked.search else {"searches": search_all()}
    if asked.search or asked.judge:
        study["judged"] = judge(study["searches"])
        RESULTS.write_text(json.dumps(study) + "\n")
    report(study)


if __name__ == "__main__":
    main()
