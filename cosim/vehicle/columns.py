"""Where the entries of different kinds of vehicle stand in one array of a result."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from cosim.storage import Storage, blocks
from cosim.vehicle.kind import Kind, Role


@dataclass(frozen=True)
class Columns:
    """The columns of one group of entries: poses, velocities or commands of all kinds that are in a run.

    The first entries of all kinds share the first column, and so on. Entries of different units share none: the second
    then has a further column.

    Attributes
    ----------
    labels, units : tuple of str
        Of each column; where the kinds' names differ they are joined, as in "psi/theta_1".
    of : dict
        By the kind's name, the column of each of its entries.
    """

    labels: tuple[str, ...]
    units: tuple[str, ...]
    of: dict[str, tuple[int, ...]]

    def spread(self, values: NDArray[np.float64], kinds: Sequence[Kind], storage: Storage) -> NDArray[np.float64]:
        """Return values (samples, robots, entries) of robots that are some kinds in these columns, elsewhere NaN.

        The entries of each robot are its first ones.
        """
        if all(self.of[kind.name] == tuple(range(len(self.labels))) for kind in kinds):
            return values
        found: NDArray[np.float64] = storage.empty((*values.shape[:-1], len(self.labels)))
        for block in blocks(len(found), len(kinds) * len(self.labels)):
            found[block] = np.nan
            for row, kind in enumerate(kinds):
                own = self.of[kind.name]
                found[block, row, own] = values[block, row, : len(own)]
        return found


@dataclass(frozen=True)
class RunColumns:
    """The columns of a run.

    Attributes
    ----------
    pose, velocity, command : Columns
        The columns of each group.
    commands : str
        Name of the commands in a result: ``torque``, or ``command`` if some command is no torque.
    """

    pose: Columns
    velocity: Columns
    command: Columns
    commands: str

    @property
    def labels(self) -> dict[str, tuple[str, ...]]:
        """The labels of each dimension of a result."""
        return {
            "pose_component": self.pose.labels,
            "velocity_component": self.velocity.labels,
            f"{self.commands}_component": self.command.labels,
        }


def run_columns(kinds: Iterable[Kind]) -> RunColumns:
    """Return the columns of a run with robots of some kinds."""
    return _run_columns(tuple(dict.fromkeys(kinds)))


@cache
def _run_columns(kinds: tuple[Kind, ...]) -> RunColumns:
    called = "torque" if all(kind.takes_torques for kind in kinds) else "command"
    return RunColumns(columns(kinds, "pose"), columns(kinds, "velocity"), columns(kinds, "command"), called)


def columns(kinds: Iterable[Kind], group: str) -> Columns:
    """Return the columns of the ``pose``, the ``velocity`` or the ``command`` of some kinds."""
    shared: list[list[Role]] = []
    of: dict[str, tuple[int, ...]] = {}
    for kind in kinds:
        places: list[int] = []
        for place, role in enumerate(getattr(kind, group)):
            fitting = [at for at, column in enumerate(shared) if at not in places and column[0].unit == role.unit]
            at = place if place in fitting else next(iter(fitting), len(shared))
            if at == len(shared):
                shared.append([])
            shared[at].append(role)
            places.append(at)
        of[kind.name] = tuple(places)
    labels = tuple("/".join(dict.fromkeys(role.name for role in column)) for column in shared)
    return Columns(labels, tuple(column[0].unit for column in shared), of)
