"""Runs of the scenarios that a scenario is compared with."""

from __future__ import annotations

from pathlib import Path
from typing import TypeAlias

from cosim.errors import FormationError
from cosim.master.setup import Setup
from cosim.master.supervised import whole_run
from cosim.results.result import Result
from cosim.unforeseen import lack_of

_Key: TypeAlias = tuple[Path, tuple[Path, ...], str, tuple[str, ...]]
_KEPT = 2
"""How many results are kept, as they are large: expectations that share one stand next to each other."""

_results: dict[_Key, Result | FormationError] = {}


def run_other(setup: Setup, path: Path) -> Result:
    """Return the result of a scenario that one is compared with; once in a process for the same text and files.

    Parameters
    ----------
    setup
        The set-up of the scenario that is compared, whose plants have not ended.
    path
        The file of the other one.

    Raises
    ------
    FormationError
        Its run fails, or has failed.
    """
    other, prepared = setup.others[path].scenario, setup.others[path].setup
    key = other.path, other.untrusted, other.text, setup.others[path].content
    if key not in _results:
        try:
            with whole_run(other, prepared) as simulation:
                result: Result | FormationError = simulation.run_to_end()
        except FormationError as error:
            if lack_of(error):  # the next run may have what it needs
                raise
            result = error
        _results[key] = result
        while len(_results) > _KEPT:
            del _results[next(iter(_results))]
    result = _results[key]
    if isinstance(result, FormationError):
        raise result
    return result
