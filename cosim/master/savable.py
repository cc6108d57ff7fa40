"""Whether the plants of a run can save their states, which their FMUs say."""

from __future__ import annotations

from cosim.errors import InputError
from cosim.master.setup import Setup
from cosim.master.ticks import driven_robots


def check_savable(setup: Setup) -> None:
    """Refuse a run in which the FMU of a robot cannot save its state.

    Raises
    ------
    InputError
        Names the first such robot, its FMU, and what can be done.
    """
    for robot in driven_robots(setup):
        if not robot.fmu.about_interface.canSerializeFMUState:
            version = robot.fmu.description.fmiVersion
            why = "FMI 1.0 knows no saved states" if version == "1.0" else "its description does not offer it"
            raise InputError(
                f"{robot.name}: the FMU {robot.fmu.path.name} cannot save its state ({why}), so the run cannot be left "
                "and taken up again; it can be run again from the start up to any moment, with the same bits",
                robot.where,
            )
