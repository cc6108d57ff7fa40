"""How long a study takes, about: by the time that runs took before, or by their steps and robots.

An estimate starts no FMU. It rests on how many steps of how many robots there are, on what such a step costs with the
plants and controllers that are built in, and on how fast this machine is, which a small loop tells.
"""

from __future__ import annotations

import json
import math
import time
from contextlib import suppress
from pathlib import Path

from cosim.studies.sizes import in_words
from cosim.studies.study import Study

FILE = "pace.json"
"""In the folder of a study: the time that a run took."""
_LOOP = 20_000
"""Rounds of the loop that tells how fast the machine is."""
_A_STEP, _A_RUN = 8.0, 50_000.0
"""Cost of a communication step of one robot, and of a run besides its steps, in rounds of that loop."""


def told_duration(study: Study, runs: int, processes: int, folder: Path) -> str:
    """Return, in words, how long runs of a study take on so many processes.

    Parameters
    ----------
    folder
        Of the study's results, if there are any; the pace of runs that were made before is in it.
    """
    many = "1 process" if processes == 1 else f"{processes} processes"
    shared = max(min(processes, runs), 1)
    each = _measured(folder)
    if each is not None:
        return f"about {in_words(each * runs / shared)} on {many}, as fast as the runs before"
    if any(source.model is None for scenario in study.bases.values() for source in scenario.plants.values()):
        why = "if its FMUs are as fast as those built in; --runs 20 measures it"
    else:
        why = "by its steps and robots; --runs 20 measures it"
    return f"about {in_words(estimated(study) * runs / shared)} on {many}, {why}"


def keep_pace(folder: Path, each: float | None) -> None:
    """Keep the time [s] that a run took, if any was made; a folder that cannot be written tells nothing."""
    if each is not None:
        with suppress(OSError):
            (folder / FILE).write_text(json.dumps({"seconds_per_run": each}) + "\n", "utf-8")


def _measured(folder: Path) -> float | None:
    """Return the time [s] of a run that was made before; None if none was."""
    try:
        told = json.loads((folder / FILE).read_text("utf-8"))
        each = float(told["seconds_per_run"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return each if 0.0 < each < math.inf else None


def estimated(study: Study) -> float:
    """Return about how long a run takes [s], on average over the scenarios of a study."""
    steps = [scenario.ticks * (1 + len(scenario.followers)) for scenario in study.bases.values()]
    return (_A_STEP * sum(steps) / len(steps) + _A_RUN) * min(_round() for _ in range(3))


def _round() -> float:
    """Return the time [s] of the processor that a round of the loop takes."""
    began, number = time.process_time(), 0.0
    for index in range(_LOOP):
        number += math.sin(index)
    return (time.process_time() - began) / _LOOP
