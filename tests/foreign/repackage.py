"""Our own car_like FMU as a supplier passes it on with the FMU Manipulation Toolbox: other names, less inside.

    python repackage.py CAR_LIKE.fmu

writes Supplied.fmu to the current folder. The units are the same but for their names, which only the FMU explains.
"""

import csv
import sys

from fmu_manipulation_toolbox.operations import (
    FMU,
    OperationAbstract,
    OperationRemoveRegexp,
    OperationRemoveSources,
    OperationRenameFromCSV,
)

NAMES = {
    "x": "Chassis.rearAxle.x",
    "y": "Chassis.rearAxle.y",
    "psi": "Chassis.yaw",
    "gamma": "Steering.angle",
    "v": "Chassis.speed",
    "omega": "Steering.rate",
    "tau_drive": "Driveline.torque",
    "tau_steer": "Steering.torque",
    "a": "Chassis.wheelbase",
    "m_c": "Chassis.mass",
}
UNITS = {"m": "metre", "rad": "radian", "N.m": "newtonmetre", "m/s": "mps", "rad/s": "radps"}


class RenameUnits(OperationAbstract):
    """Give units other names, where they are defined and where they are used."""

    def closure(self) -> None:
        """Rename in the whole description, after everything else."""
        for element in self.model_description.root.iter():
            attribute = "name" if element.tag == "Unit" else "unit"
            if element.get(attribute) in UNITS:
                element.set(attribute, UNITS[element.get(attribute)])


def repack(operations: list[OperationAbstract], source: str, target: str) -> None:
    """Apply operations one after the other."""
    with FMU(source) as fmu:
        for operation in operations:
            fmu.apply_operation(operation)
        fmu.repack(target)


with open("names.csv", "w", newline="", encoding="utf-8") as file:
    both = NAMES | {f"der({old})": f"der({new})" for old, new in NAMES.items()}
    csv.writer(file, delimiter=";", quotechar="'").writerows(both.items())

repack(
    [
        OperationRemoveRegexp("tau_d_|.*_stop$|gamma_max$|F_|v_s$|omega_s$"),
        OperationRenameFromCSV("names.csv"),
        OperationRemoveSources(),
        RenameUnits(),
    ],
    sys.argv[1],
    "Supplied.fmu",
)
