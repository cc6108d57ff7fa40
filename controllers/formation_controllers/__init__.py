"""Formation controllers for wheeled robots: poses in, commands out.

Importing this package is cheap; the base class of controllers (`formation_controllers.controller`), the
geometry (`formation_controllers.geometry`) and the laws bring Numba with them.
"""

from formation_controllers.errors import ControllerError, GainError, IncompatibleInterface, UnknownController
from formation_controllers.gains import GainInfo, Gains, gain_info
from formation_controllers.interface import INTERFACE_VERSION, Desired, Leader, Signal, Team
from formation_controllers.registry import Installed, installed, load
from formation_controllers.vehicles import (
    OTHERS,
    CarLike,
    DifferentialDrive,
    Entry,
    FormationGeometry,
    TorqueMap,
    TractorTrailer,
    Vehicle,
)

__all__ = [
    "INTERFACE_VERSION",
    "OTHERS",
    "CarLike",
    "ControllerError",
    "Desired",
    "DifferentialDrive",
    "Entry",
    "FormationGeometry",
    "GainError",
    "GainInfo",
    "Gains",
    "IncompatibleInterface",
    "Installed",
    "Leader",
    "Signal",
    "Team",
    "TorqueMap",
    "TractorTrailer",
    "UnknownController",
    "Vehicle",
    "gain_info",
    "installed",
    "load",
]
