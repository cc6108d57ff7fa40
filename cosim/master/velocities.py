"""Check that every robot offers the velocities that other robots need."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from cosim.control.law import Law
from cosim.errors import UnboundVelocities
from cosim.fmu.binding import number_name
from cosim.master.robot import RobotSetup
from cosim.scenario.scenario import Scenario


def check_velocities(
    scenario: Scenario, leader: RobotSetup, followers: Sequence[RobotSetup], laws: Mapping[str, Law]
) -> None:
    """Refuse a robot that does not offer velocities that are needed."""
    if scenario.leader.trajectory is None:
        _check_robot(leader, "its followers need the leader's velocities")
    for follower, robot in zip(scenario.followers, followers, strict=True):
        law = laws[follower.controller]
        if "velocity" in law.needs:
            _check_robot(robot, f"the controller {law.source.name!r} needs the velocities of its robots")


def _check_robot(robot: RobotSetup, why: str) -> None:
    bound = robot.fmu.binding.bound
    missing = [role.name for role in robot.kind.velocity if role.name not in bound]
    if missing:
        raise UnboundVelocities(
            f"the FMU {robot.fmu.path} offers no {' and no '.join(missing)}, but {why}: "
            f"give {robot.name} another plant",
            robot.where,
            fmu=str(robot.fmu.path),
            vehicle=robot.kind.name,
            roles=tuple(missing),
            played=tuple(number_name(b.played_by) for b in bound.values() if b.played_by is not None),
        )
