"""The records of a compiled law: what its tick is called with besides the inputs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from formation_controllers.kinematics import Geometry


class TeamRecords(NamedTuple):
    """The state of a law from one tick to the next; arrays of records have one a follower.

    Attributes
    ----------
    vehicle : Geometry
        The followers' vehicle.
    period : float
        Time between two ticks [s].
    gains, state, telemetry : ndarray
        Records with a field for each gain, state and signal.
    seen, columns : ndarray
        Room for what a tick works out for a block of followers side by side, by `robot_view.see` and by the law; one
        record each, see `columns`.
    """

    vehicle: Geometry
    period: float
    gains: NDArray[np.void]
    state: NDArray[np.void]
    telemetry: NDArray[np.void]
    seen: NDArray[np.void]
    columns: NDArray[np.void]
