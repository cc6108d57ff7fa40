"""Formation's harness: scenarios in, co-simulated formations of robots out.

>>> import cosim
>>> result = cosim.run("scenarios/clmr_line.xml")            # an xarray.Dataset

or step by step:

>>> with cosim.Simulation(cosim.read_scenario("scenarios/clmr_line.xml")) as simulation:
...     while not simulation.finished:
...         simulation.step()

and later, of what ``formation run`` has left:

>>> result = cosim.load_result("runs/clmr_line")
>>> summary = cosim.summary_of(result)                       # the table, notes and verdicts, as data
>>> cosim.save_figure(result, "figure.png")
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    import xarray as xr

    from cosim.changes import Change
    from cosim.compare import PlantComparison, PlantFile, compare_plants
    from cosim.errors import FormationError, InputError, OutputError, RunInterrupted, SimulationError
    from cosim.figure import save_figure
    from cosim.pacing import Pacer
    from cosim.reader import read_scenario
    from cosim.result import load_result
    from cosim.scenario import Scenario
    from cosim.simulation import Simulation
    from cosim.summary import Summary, summary_of
    from cosim.verdict import Verdict

__all__ = [
    "FormationError",
    "InputError",
    "OutputError",
    "Pacer",
    "PlantComparison",
    "PlantFile",
    "RunInterrupted",
    "Scenario",
    "Simulation",
    "SimulationError",
    "Summary",
    "Verdict",
    "compare_plants",
    "load_result",
    "read_scenario",
    "run",
    "save_figure",
    "summary_of",
]


def run(scenario: str | Path | Scenario, changes: Iterable[str | Change] = ()) -> xr.Dataset:
    """Run a scenario to its horizon and return the result.

    Parameters
    ----------
    scenario
        A scenario, or the path of its file.
    changes
        For a file: ``XPATH=VALUE`` each, as for ``--set``; see `read_scenario`.

    Raises
    ------
    InputError
        The scenario is wrong or does not fit what is installed.
    SimulationError
        A plant or controller failed, or the motion diverged; its ``result`` holds everything up to then.
    RunInterrupted
        The user pressed Ctrl-C; likewise.
    """
    from cosim.reader import read_scenario
    from cosim.scenario import Scenario
    from cosim.simulation import Simulation

    if not isinstance(scenario, Scenario):
        scenario = read_scenario(scenario, changes)
    with Simulation(scenario) as simulation:
        return simulation.run()


_HOMES = {
    "PlantComparison": "cosim.compare",
    "PlantFile": "cosim.compare",
    "compare_plants": "cosim.compare",
    "Pacer": "cosim.pacing",
    "Scenario": "cosim.scenario",
    "Simulation": "cosim.simulation",
    "Summary": "cosim.summary",
    "Verdict": "cosim.verdict",
    "load_result": "cosim.result",
    "read_scenario": "cosim.reader",
    "save_figure": "cosim.figure",
    "summary_of": "cosim.summary",
}


def __dir__() -> list[str]:
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})


def __getattr__(name: str) -> object:  # the libraries of the master take a second to import
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(_HOMES.get(name, "cosim.errors")), name)
