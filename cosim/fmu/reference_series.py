"""Tables over time in an FMU: stimuli for its inputs, and reference results."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from cosim.errors import MAX_NAMES, nearest
from cosim.fmu.inner_files import FmuFiles, finite, shortened
from cosim.fmu.model_description import Variable
from cosim.fmu.package import Package
from cosim.plant.spec import FLOAT_TYPES, WHOLE

MAX_CSV_BYTES = 64 * 1024**2
MAX_CELLS = 2_000_000
_COMPARED = (*FLOAT_TYPES, *WHOLE, "Boolean", "Enumeration")


@dataclass(frozen=True, eq=False)
class Series:
    """A table over time: the columns by the FMU's variable, each (rows, elements); a jump has two rows of one time."""

    time: NDArray[np.float64]
    columns: Mapping[str, NDArray[np.float64]]


class SeriesReader:
    """Reads such tables of one FMU.

    Parameters
    ----------
    package
        The FMU.
    files
        Its files.

    Attributes
    ----------
    notes : list of str
        Columns that are left out, with reasons.
    """

    def __init__(self, package: Package, files: FmuFiles) -> None:
        self._files = files
        self._variables = {variable.name: variable for variable in package.description.modelVariables}
        self.notes: list[str] = []

    def variable(self, file: Path, place: etree._Element | int, name: str) -> Variable:
        """Return the variable of a name that a file gives at some element or line.

        Raises
        ------
        InputError
            The FMU has none.
        """
        if name not in self._variables:
            raise self._files.error(
                file, place, f"the FMU has no variable {name!r}: {nearest(name, list(self._variables))}"
            )
        return self._variables[name]

    def read(self, file: Path, *, stimuli: bool) -> Series:
        """Return the table in a CSV file: the time in the first column, and the FMU's variables by name in the others.

        Raises
        ------
        InputError
            It is no such table, with the line; or it has stimuli that cannot be given.
        """
        data = self._files.read(file, MAX_CSV_BYTES)
        if (cells := data.count(b",") + data.count(b"\n")) > MAX_CELLS:
            raise self._files.error(file, 0, f"has {cells} cells, more than {MAX_CELLS}")
        try:
            rows = csv.reader(io.StringIO(data.decode("utf-8-sig"), newline=""))
            header = [name.strip() for name in next(rows, [])]
            if len(header) < 2 or len(set(header)) < len(header):
                raise self._files.error(
                    file, 1, "its first line names no columns, or one twice: expected time,NAME,..."
                )
            variables = [self._stimulus(file, name) if stimuli else self._variables.get(name) for name in header[1:]]
            if not stimuli:
                variables = self._comparable(file, header[1:], variables)
            time: list[float] = []
            columns: list[list[list[float]]] = [[] for _ in variables]
            for row in rows:
                if not row:
                    continue
                if len(row) != len(header):
                    raise self._files.error(
                        file, rows.line_num, f"has {len(row)} cells, but the first line {len(header)}"
                    )
                now = finite(row[0])
                if now is None or (time and now < time[-1]):
                    raise self._files.error(
                        file, rows.line_num, f"the time is {row[0]!r}; it must be a number, and not decrease"
                    )
                time.append(now)
                for variable, cell, column in zip(variables, row[1:], columns, strict=True):
                    if variable is None:
                        continue
                    values = [value_of(variable, part) for part in cell.split()]
                    numbers = [value for value in values if value is not None]
                    size = 1 if not variable.dimensions else len(column[0]) if column else max(1, len(values))
                    if not len(values) == len(numbers) == size:
                        raise self._files.error(
                            file, rows.line_num, f"{variable.name!r} is {cell!r}, but is of the type {variable.type}"
                        )
                    column.append(numbers)
        except UnicodeDecodeError:
            raise self._files.error(file, 0, "is not text in UTF-8") from None
        except csv.Error as error:
            raise self._files.error(file, rows.line_num, f"is not a table of comma-separated values: {error}") from None
        if not time:
            raise self._files.error(file, 0, "has no rows")
        return Series(
            np.array(time),
            {v.name: np.array(column) for v, column in zip(variables, columns, strict=True) if v is not None},
        )

    def _stimulus(self, file: Path, name: str) -> Variable:
        variable = self.variable(file, 1, name)
        if variable.causality != "input" and variable.variability != "tunable":
            raise self._files.error(file, 1, f"{name!r} is a stimulus, but no input of the FMU")
        if variable.type not in _COMPARED or variable.dimensions:
            kind = "an array" if variable.dimensions else f"of the type {variable.type}"
            raise self._files.error(file, 1, f"the stimulus {name!r} is {kind}, which cannot be given here")
        return variable

    def _comparable(
        self, file: Path, names: Sequence[str], variables: Sequence[Variable | None]
    ) -> list[Variable | None]:
        """Return the variables of columns; None, and a note, for a column that is not compared."""
        unknown = [name for name, variable in zip(names, variables, strict=True) if variable is None]
        strange = [v.name for v in variables if v is not None and v.type not in _COMPARED]
        for left_out, why in ((unknown, "the FMU has no such variable"), (strange, "their values are no numbers")):
            if left_out:
                more = f" and {len(left_out) - MAX_NAMES} more" if len(left_out) > MAX_NAMES else ""
                self.notes.append(
                    shortened(f"{file.name}: {', '.join(left_out[:MAX_NAMES])}{more} not compared: {why}")
                )
        compared = [None if v is None or v.type not in _COMPARED else v for v in variables]
        if not any(compared):
            raise self._files.error(file, 1, "there is nothing to compare: no column is a numeric variable of the FMU")
        return compared


def value_of(variable: Variable, text: str) -> float | None:
    """Return a value of a variable as a number; None if a text is none."""
    if variable.type == "Boolean" and text.lower() in ("true", "false"):
        return float(text.lower() == "true")
    return finite(text)
