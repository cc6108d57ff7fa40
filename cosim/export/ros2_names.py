"""Names of topics and frames in ROS 2."""

from __future__ import annotations

import re
from collections.abc import Sequence


def token(name: str) -> str:
    """Return the part of a topic's name that is nearest to a name: letters, digits and single underscores within."""
    found = re.sub(r"_{2,}", "_", re.sub(r"[^A-Za-z0-9_]", "_", name)).strip("_")
    return found if found[:1].isalpha() else f"n{found}"


def tokens(names: Sequence[str]) -> dict[str, str]:
    """Return such a part for each of some names; those that would be alike are numbered."""
    found: dict[str, str] = {}
    for name in names:
        wanted = own = token(name)
        number = 1
        while own in found.values():
            own = f"{wanted}_{(number := number + 1)}"
        found[name] = own
    return found


def signal_topic(robot: str, path: Sequence[str]) -> str:
    """Return the topic of a signal of a robot, whose own part is known already."""
    return "/".join(["", robot, "signals", *map(token, path)])
