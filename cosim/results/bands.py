"""The bands of all expectations of a run, from its result alone."""

from __future__ import annotations

from pathlib import Path

from cosim.errors import InputError
from cosim.results.expectations import Kind, understood
from cosim.results.expectations.shown import Band
from cosim.results.provenance import Provenance
from cosim.results.result import Result
from cosim.scenario.reader import read_expectations


def kinds_of(result: Result) -> tuple[Kind, ...]:
    """Return the expectations in the scenario of a result, understood; none if this version cannot read its text."""
    told = result.attrs
    try:
        expectations = read_expectations(told["scenario"], Path(Provenance.of(told).file or told["scenario_name"]))
    except (InputError, KeyError):
        return ()
    return tuple(map(understood, expectations))


def bands_of_kind(kind: Kind, result: Result) -> tuple[Band, ...]:
    """Return the bands of an expectation; none if a result lacks its signal, or a follower that it needs."""
    try:
        return tuple(kind.bands(result))
    except (KeyError, InputError):
        return ()


def bands_of(result: Result) -> tuple[Band, ...]:
    """Return the bands of all expectations of a result, each once."""
    return tuple(dict.fromkeys(band for kind in kinds_of(result) for band in bands_of_kind(kind, result)))
