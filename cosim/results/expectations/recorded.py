"""The signals that a run will record, with the facts that expectations need."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from cosim.results.passes import missing
from cosim.results.result import Variable, by_robot
from cosim.results.result_variable import ResultVariable
from cosim.scenario.scenario import LEADER

DERIVED = {
    "range": ("m", "range to the virtual leader"),
    "bearing": ("rad", "bearing of the virtual leader"),
    "range_error": ("m", "range less the desired range"),
    "bearing_error": ("rad", "bearing less the desired bearing"),
}
"""Signals of every follower that are computed from recorded ones, with their units and meanings."""

DERIVED_FROM = ("pose", "leader_pose")
"""The recorded variables that they are computed from."""


@dataclass(frozen=True)
class Recorded:
    """A signal that a run will record.

    Attributes
    ----------
    units : dict
        The unit by the component's name; of a signal that has no components, by "".
    robots : tuple of str
        The followers that have it; only "leader" for a signal of the leader.
    tells_singularity : bool
        Whether something is singular where it is zero.
    """

    units: Mapping[str, str]
    robots: tuple[str, ...]
    tells_singularity: bool = False


def recorded(
    variables: Iterable[ResultVariable],
    labels: Mapping[str, Sequence[str]],
    followers: Sequence[str],
) -> dict[str, Recorded]:
    """Return the signals that expectations can be about, by name.

    Parameters
    ----------
    variables
        The variables that are recorded.
    labels
        The components' names by the dimension, such as ``pose_component``.
    followers
        The followers' ids.
    """
    known = {name: Recorded({"": unit}, tuple(followers)) for name, (unit, _) in DERIVED.items()}
    for variable in variables:
        components = next((labels[dim] for dim in variable.dims if dim != "robot"), ("",))
        known[variable.name] = Recorded(
            units=units_by_component(components, variable.units),
            robots=variable.robots or tuple(followers) if "robot" in variable.dims else (LEADER,),
            tells_singularity=bool(variable.singular_at_zero),
        )
    return known


def absent(signal: Variable, robots: Sequence[str]) -> list[bool]:
    """Return which followers of a result do not have a signal, or its component.

    A controllers' signal names those that have it. Any other is not a number where the kind of vehicle lacks it. Nobody
    has one without a sample.
    """
    courses = by_robot(signal)
    if len(courses) and (named := set(str(signal.attrs.get("robots", "")).split())):
        return [robot not in named for robot in robots]
    return missing(courses)


def units_by_component(components: Sequence[str], text: str) -> dict[str, str]:
    """Return the units of a signal's components, which are written one after another, or once if all have the same."""
    several = text.split(", ")
    return dict(zip(components, several if len(several) == len(components) else [text] * len(components), strict=True))
