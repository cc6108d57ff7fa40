"""Another name of two modules of `formation_controllers.analysis`, kept for older imports."""

from formation_controllers.analysis.gain_conditions import (
    Bounds,
    Condition,
    GainReport,
    check_gains,
    propose_gains,
)
from formation_controllers.analysis.region_of_attraction import RegionOfAttraction, region_of_attraction

__all__ = [
    "Bounds",
    "Condition",
    "GainReport",
    "RegionOfAttraction",
    "check_gains",
    "propose_gains",
    "region_of_attraction",
]
