"""The bands of all expectations of a run, from its result alone."""

from __future__ import annotations

from pathlib import Path

from cosim.errors import InputError
from cosim.results.expectations import understood
from cosim.results.expectations.shown import Band
from cosim.results.provenance import Provenance
from cosim.results.result import Result
from cosim.scenario.reader import read_expectations


def bands_of(result: Result) -> tuple[Band, ...]:
    """Return the bands of the expectations in the scenario of a result, each once; none if its text cannot be read."""
    told = result.attrs
    try:
        expectations = read_expectations(told["scenario"], Path(Provenance.of(told).file or told["scenario_name"]))
    except (InputError, KeyError):
        return ()
    found: dict[Band, None] = {}
    for written in expectations:
        try:
            found |= dict.fromkeys(understood(written).bands(result))
        except KeyError:  # a result of an earlier version may lack the signal
            continue
    return tuple(found)
