"""The table of all runs of a study: for spreadsheets as CSV, and for xarray, also as NetCDF."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from cosim.quantity import split
from cosim.results.expectations import understood
from cosim.results.result import Result, Variable
from cosim.studies.conduct import StudyOutcome
from cosim.studies.envelope_table import variables as of_envelopes
from cosim.studies.row import PASSED
from cosim.studies.sensitivity_table import variables as of_sensitivity
from cosim.studies.study import Study

KEY = 16
"""Characters of a run's key in the table."""


@dataclass(frozen=True)
class Column:
    """A column: numbers with a unit, or texts.

    Attributes
    ----------
    kind : str
        ``run``, ``value``, ``measure`` or ``margin``.
    unit : str
        Of numbers; empty for pure numbers and texts.
    values : sequence
        One a run: numbers, NaN where there is none; or texts.
    about : str
        A description.
    """

    name: str
    kind: str
    unit: str
    values: Sequence[float] | Sequence[int] | Sequence[str]
    about: str = ""

    @property
    def heading(self) -> str:
        """Name and unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


def columns(outcome: StudyOutcome) -> list[Column]:
    """Return all columns of the table of a study."""
    return list(_columns(outcome))


def as_csv(outcome: StudyOutcome) -> str:
    """Return the table as CSV, with units in the header."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    shown = columns(outcome)
    writer.writerow([column.heading for column in shown])
    writer.writerows(zip(*(column.values for column in shown), strict=True))
    return text.getvalue()


def as_result(outcome: StudyOutcome) -> Result:
    """Return the table as arrays over the runs, with varied values as coordinates; a sensitivity, and courses."""
    variables: dict[str, Variable] = {}
    coordinates: dict[str, Variable] = {}
    for column in columns(outcome):
        attributes = {"kind": column.kind, **({"units": column.unit} if column.unit else {})}
        attributes |= {"long_name": column.about} if column.about else {}
        home = coordinates if column.kind == "value" or column.name in ("run", "draw") else variables
        home[column.name] = Variable(("run",), np.asarray(column.values), attributes)
    keys = np.asarray([row.key[:KEY] for row in outcome.rows])
    variables["run_key"] = Variable(("run",), keys, {"kind": "run", "long_name": "checksum of what determines the run"})
    if outcome.sensitivities:
        figures, labels = of_sensitivity(outcome.sensitivities)
        variables |= figures
        coordinates |= labels
    courses, labels = of_envelopes(outcome.bundles, [row.number for row in outcome.rows])
    variables |= courses
    coordinates |= labels
    study = outcome.study
    told = {"study": study.name, "title": study.title, "runs_planned": outcome.planned, "text": study.document.text}
    told["mark"] = outcome.mark
    return Result(variables, coordinates, told)


def _columns(outcome: StudyOutcome) -> Iterator[Column]:
    study, rows = outcome.study, outcome.rows
    yield Column("run", "run", "", [row.number for row in rows], "number of the run")
    yield Column("draw", "run", "", [row.draw for row in rows], "number of the draw; runs to compare share it")
    for index, vary in enumerate(study.vary):
        yield _of_value(vary.name, [row.values[index] for row in rows])
    yield Column("status", "run", "", [row.status for row in rows], "passed, failed or broken")
    yield Column("passed", "measure", "", [int(row.status == PASSED) for row in rows], "whether all expectations hold")
    for index, measured in enumerate(study.measures):
        yield Column(measured.name, "measure", measured.unit, [row.measures[index] for row in rows])
    texts = _expectations(study)
    for index, text in enumerate(texts):
        margins = [row.margins[index] if index < len(row.margins) else math.nan for row in rows]
        yield Column(f"margin_{index + 1}", "margin", "", margins, f"margin of: {text}")
    yield Column("message", "run", "", [row.message for row in rows], "why the run is broken or has failed")


_MOST = 2**63
"""The whole numbers of a file are less in magnitude."""


def _of_value(name: str, texts: Sequence[str | None]) -> Column:
    """Return a varied value: as numbers where all are quantities in one unit."""
    found: list[float] = []
    unit: str | None = None
    for text in texts:
        if text is None:
            found.append(math.nan)
            continue
        try:
            number, own = split(text)
        except ValueError:
            break
        if unit not in (None, own):
            break
        unit = own
        found.append(number)
    else:
        if unit is not None:
            if unit == "1" and all(number.is_integer() for number in found if not math.isnan(number)):
                whole = [_whole(text) for text in texts if text is not None]
                if len(whole) == len(texts) and all(-_MOST <= one < _MOST for one in whole):
                    return Column(name, "value", "", whole)
                if any(int(float(one)) != one for one in whole):  # a float would be another number
                    return Column(name, "value", "", ["" if text is None else str(_whole(text)) for text in texts])
            return Column(name, "value", "" if unit == "1" else unit, found)
    return Column(name, "value", "", ["" if text is None else text for text in texts])


def _whole(text: str) -> int:
    """Return a whole number: as it is written, as a seed may have more digits than a float holds, or such as "1e3"."""
    try:
        return int(text)
    except ValueError:
        return int(split(text)[0])


def _expectations(study: Study) -> list[str]:
    """Return the expectations of the scenarios in words, but for measures; none if the scenarios differ in them."""
    measures = {measured.where for measured in study.measures}
    found = [
        [understood(one).text for one in scenario.expectations if one.where not in measures]
        for scenario in study.bases.values()
    ]
    return found[0] if all(texts == found[0] for texts in found) else []
