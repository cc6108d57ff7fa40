"""The folder of a study, made without a run, for tests of its page."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from cosim.results.files import save
from cosim.results.result import Result, Variable

LIMIT = 30.0
"""Runs with a greater mass have failed."""


def write_study_folder(
    folder: Path,
    runs: int,
    *,
    message: str = "heavy",
    title: str = "Many",
    none: float = np.inf,
    first_seed: int = 1_000_001,
    **more: Any,
) -> None:
    """Write table and summary of a study: run 1 is broken, run 2 has no figure, and heavy ones have failed.

    `none` is the figure of a run without one, the worst there is.
    """
    folder.mkdir(parents=True, exist_ok=True)
    number = np.arange(1, runs + 1)
    mass = 25.0 + 7.0 * (number * 0.618034 % 1.0)
    status = np.where(mass > LIMIT, "failed", "passed").astype(object)
    settling = 40.0 + mass
    status[0], settling[0], settling[1] = "broken", np.nan, none
    told = np.where(status == "passed", "", message).astype(object)
    variables = {
        "status": Variable(("run",), status, {"kind": "run"}),
        "passed": Variable(("run",), (status == "passed").astype(int), {"kind": "measure"}),
        "settling": Variable(("run",), settling, {"kind": "measure", "units": "s"}),
        "margin_1": Variable(("run",), 80.0 - settling, {"kind": "margin", "long_name": "margin of: settled"}),
        "message": Variable(("run",), told, {"kind": "run"}),
    }
    coordinates = {
        "run": Variable(("run",), number, {"kind": "run"}),
        "draw": Variable(("run",), number, {"kind": "run"}),
        "mass": Variable(("run",), mass, {"kind": "value", "units": "kg"}),
        "law": Variable(("run",), np.where(number % 2, "printed", "stiff").astype(object), {"kind": "value"}),
        "seed": Variable(("run",), first_seed - 1 + number, {"kind": "value"}),
    }
    save(Result(variables, coordinates, {"study": "many", "title": title, "text": "<study/>"}), folder / "runs.nc")
    verdict = {"expectation": "0.95 quantile of settling below 71 s", "robot": "", "figure": 71.9, "bound": 71.0}
    verdict |= {"unit": "s", "margin": -0.9, "passed": False, "known_failure": "", "detail": f"of {runs} runs"}
    spread = {
        "measure": "settling",
        "unit": "s",
        "least": 65.0,
        "quarter": 66.0,
        "median": 68.5,
        "three_quarters": 70.0,
        "greatest": 71.9,
        "worst_run": 2,
        "least" if none < 0 else "greatest": None,
    }
    counts = {name: int((status == name).sum()) for name in ("passed", "failed", "broken")}
    summary = {
        "study": "many",
        "title": title,
        "scenario": "studies/my many.xml",
        "planned": runs,
        "runs": runs,
        "ended_early": False,
        **counts,
        "measures": [spread],
        "bounds": [{"measure": "settling", "kind": "quantile", "below": 71.0}],
        "verdicts": [verdict],
        **more,
    }
    (folder / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
