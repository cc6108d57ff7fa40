"""What is kept of a tuning: its trials as a table, the best values as scenarios, and both in the summary."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cosim.studies.cases import own_text
from cosim.studies.earlier_files import tuned_name
from cosim.studies.plan import run_of
from cosim.studies.reproduce import as_variant
from cosim.studies.study import Study, Tune
from cosim.studies.trial import Trial, mean_cost, passes
from cosim.studies.tuning import Tuned


def trials_csv(study: Study, tune: Tune, found: Sequence[Tuned]) -> str:
    """Return the table of all trials as CSV: cost and score on the draws of training, and the least cost so far."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = [study.vary[index].name for index in tune.values]
    writer.writerow(["trial", "case", "restart", *names, "draws", "pruned", "passes", "cost", "least_cost_so_far"])
    for one in found:
        for trial, least in zip(one.trials, so_far(tune, one.trials), strict=True):
            rows = trial.rows.values()
            cost = mean_cost(tune, rows)
            values = [trial.values.get(index) or own_text(study, one.cases, index) for index in tune.values]
            ends = [len(trial.rows), int(trial.pruned), int(passes(rows)), cost, least]
            writer.writerow([trial.number, one.name, trial.restart, *values, *ends])
    return text.getvalue()


def so_far(tune: Tune, trials: Sequence[Trial]) -> list[float]:
    """Return, after each trial of a case, the least cost of its restart's trials that pass; infinite before one has."""
    least: dict[int, float] = {}
    found = []
    for trial in trials:
        good = not trial.pruned and passes(trial.rows.values())
        cost = mean_cost(tune, trial.rows.values()) if good else math.inf
        least[trial.restart] = min(cost, least.get(trial.restart, math.inf))
        found.append(least[trial.restart])
    return found


def best_values(study: Study, tuned: Tuned) -> dict[str, str]:
    """Return the best values by their names, the scenario's own where these are best."""
    return {
        study.vary[index].name: value or own_text(study, tuned.cases, index)
        for index, value in tuned.best.values.items()
    }


def tuned_variant(study: Study, tuned: Tuned, folder: Path) -> tuple[str, str]:
    """Return the name of a file, and its text: a variant with the best values, to be written in a folder."""
    names = iter(tuned.name.split())
    values = [next(names) if vary.cases else tuned.best.values.get(at) for at, vary in enumerate(study.vary)]
    run = run_of(study, tuned.best.number, 1, values)
    name = tuned_name(tuned.name)
    title = f"Tuned by {study.name}, trial {tuned.best.number}: {study.title}"
    return f"{name}.xml", as_variant(study, run, folder, f"{study.name}-{name}", title)


def as_data(study: Study, tune: Tune, found: Sequence[Tuned]) -> list[dict[str, Any]]:
    """Return the outcome of each case as data."""
    return [
        {
            "case": one.name,
            "trials": len(one.trials),
            "pruned": sum(trial.pruned for trial in one.trials),
            "best_trial": one.best.number,
            "values": best_values(study, one),
            "at_bounds": list(one.at_bounds),
            "training_cost": mean_cost(tune, one.best.rows.values()),
            "own_training_cost": mean_cost(tune, one.trials[0].rows.values()),
            "least_cost_of_restarts": [least for _, least in sorted(_of_restarts(tune, one).items())],
            "held_out_cost": mean_cost(tune, one.held_out),
            "own_held_out_cost": mean_cost(tune, one.own),
        }
        for one in found
    ]


def _of_restarts(tune: Tune, tuned: Tuned) -> dict[int, float]:
    return {trial.restart: least for trial, least in zip(tuned.trials, so_far(tune, tuned.trials), strict=True)}
