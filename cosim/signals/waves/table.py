"""A course from a CSV file, interpolated linearly; beyond its ends the first and the last value hold."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.scenario.csv_table import Table, read_table
from cosim.scenario.scenario import WaveSource
from cosim.signals.interpolation import interpolated
from cosim.signals.waves.wave import Sampling, Wave


class Tabled(Wave):
    """``<table>``."""

    element = "table"

    def __init__(self, written: WaveSource) -> None:
        super().__init__(written)
        self.file, self.column = written.path("file"), written.get("column")
        self._course: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None

    @property
    def text(self) -> str:
        """The wave in words."""
        return f"{self.element} {self.column}"

    def table(self) -> tuple[Table, str]:
        """Return the table and the column."""
        return read_table(self.file, self.written.where), self.column

    def samples(self, sampling: Sampling) -> NDArray[np.float64]:
        """Return the values."""
        if self._course is None:
            table, column = self.table()
            self._course = table.time, table.column(column, sampling.unit, self.written.where)
        return interpolated(sampling.times, *self._course)
