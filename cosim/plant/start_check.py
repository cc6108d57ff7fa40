"""Checks that a plant has started at its initial pose, and the messages if it has not."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.plant.failures import FAILURES, RETURN, NoInstance, PlantError
from cosim.plant.instance import Instance
from cosim.plant.member import Link, Member

START_TOLERANCE = 1e-6
"""Largest distance [m, rad] from the initial pose at the start, absolute and relative to the pose."""

FASTEST = 50.0
"""Largest speed [m/s, rad/s] in the first step that is plausible for a start at the initial pose."""


SHOWN_LATE = 'if its outputs show the pose only after the first step: start="first_step" in its <plant>'
"""Remedy for outputs that do not show the pose at the start."""


def not_started(members: Sequence[Member], index: int, error: PlantError) -> InputError:
    """Return the error for a plant that cannot be started: the FMU's reason, and possible remedies."""
    member = members[index]
    spec = member.spec
    message = f"the FMU {spec.file} cannot be started as {spec.robot}: {error}"
    others = [o.robot for o in Instance.living if (o.identifier, o.token) == (spec.identifier, spec.token)]
    if isinstance(error, NoInstance) and others and not member.isolated:
        message += (
            f"; {others[0]} runs the same FMU in this process, which may allow one only: "
            'isolate="process" in its <plant> gives each robot a process of its own'
        )
    if FAILURES[RETURN] in str(error):
        message += f"; {SHOWN_LATE}"
    if member.needs_tool:
        message += "; it also needs the tool that made it, which may be missing here"
    return InputError(message, member.where)


def check_pose(member: Member, state: NDArray[np.float64]) -> None:
    """Refuse a plant that does not start at its initial pose.

    Raises
    ------
    InputError
        It starts elsewhere.
    """
    for link, wanted, found, apart in _apart(member, state):
        if apart > START_TOLERANCE * max(1.0, abs(wanted)) + link.resolution:
            raise InputError(
                f"the FMU {member.spec.file} does not take the initial pose of {member.spec.robot}: "
                f"{link.name} is {found:g} {link.unit} at the start, not {wanted:g} {link.unit}; "
                f"{SHOWN_LATE}",
                member.where,
            )


def moved_too_far(member: Member, time: float, state: NDArray[np.float64]) -> str:
    """Return why a plant, by its outputs at a time [s], cannot have started at its initial pose; empty if it can."""
    for link, wanted, found, apart in _apart(member, state):
        if apart > FASTEST * time:
            return (
                f"does not take the initial pose: {link.name} is {found:g} {link.unit} after the first step, "
                f"too far from {wanted:g} {link.unit} at the start"
            )
    return ""


def _apart(member: Member, state: NDArray[np.float64]) -> Iterator[tuple[Link, float, float, float]]:
    """Yield each pose entry with its wanted value, its value, and the difference, for angles without whole turns."""
    for link, wanted, found in zip(member.outputs, member.pose, state.tolist(), strict=False):
        difference = math.remainder(found - wanted, math.tau) if link.unit == "rad" else found - wanted
        yield link, wanted, found, abs(difference)
