"""Entries of poses and torques, by name."""

from __future__ import annotations

from collections.abc import Mapping

from cosim.scenario.reader.element import Element
from cosim.scenario.scenario import Entries

POSE = {"x": "m", "y": "m", "psi": "rad", "gamma": "rad", "theta_1": "rad", "theta_0": "rad"}
"""Units of the entries of a pose."""
TORQUE = dict.fromkeys(("tau_drive", "tau_steer", "tau_right", "tau_left"), "N.m")
"""Units of torques."""


def entries(element: Element, tag: str, units: Mapping[str, str]) -> Entries:
    """Read the entries that an element within another gives, if it is there."""
    child = element.find(tag)
    if child is None:
        return Entries({}, element.where)
    return Entries({name: child.quantity(name, units[name]) for name in child.attributes}, child.where)
