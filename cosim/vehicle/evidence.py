"""Evidence in an FMU for the kind of vehicle that it is, and against kinds that it clearly is not."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass

_SIDES = {"right": "right", "r": "right", "left": "left", "l": "left"}
_STEERING = frozenset(("steer", "steering", "gamma", "delta"))
_TRAILING = frozenset(
    ("trailer", "semitrailer", "hitch", "tractor", "truck", "drawbar", "articulation", "articulated", "tow", "towing")
)


@dataclass(frozen=True)
class Evidence:
    """Evidence in an FMU.

    Attributes
    ----------
    inputs : dict
        Its inputs that may drive or steer, by name, each with the words of the name.
    said : collection of str
        The words of its name and description.
    missing : collection of str
        The roles without a candidate.
    has : callable
        Returns whether the name of any of its variables has one of some words.
    """

    inputs: Mapping[str, tuple[str, ...]]
    said: Collection[str]
    missing: Collection[str]
    has: Callable[[Iterable[str]], bool]

    @property
    def steering(self) -> str:
        """The name of an input that steers; empty if there is none."""
        return next((name for name, words in self.inputs.items() if _STEERING & set(words)), "")

    @property
    def wheels(self) -> tuple[str, str] | None:
        """Two inputs whose names differ by right and left only."""
        found: dict[tuple[str, ...], dict[str, str]] = {}
        for name, words in self.inputs.items():
            sides = {_SIDES[word] for word in words if word in _SIDES}
            if len(sides) == 1 and not _STEERING & set(words):
                rest = tuple(word for word in words if word not in _SIDES)
                found.setdefault(rest, {})[sides.pop()] = name
        return next(((pair["right"], pair["left"]) for pair in found.values() if len(pair) == 2), None)

    @property
    def driven_by_wheels(self) -> str:
        """A clause that names the inputs of the wheels, if two inputs are for wheels and none steers; else empty."""
        wheels = self.wheels
        if wheels is None or self.steering:
            return ""
        return f"its inputs {wheels[0]!r} and {wheels[1]!r} are for a right and a left wheel"

    @property
    def steers_only(self) -> str:
        """A sentence that names an input that steers, if no two inputs are for wheels; else empty."""
        if not self.steering or self.wheels is not None:
            return ""
        return f"its input {self.steering!r} steers, and no two inputs are for a right and a left wheel"

    @property
    def trailing(self) -> bool:
        """Whether a name or a description mentions a trailer or a hitch."""
        return bool(_TRAILING & set(self.said)) or self.has(_TRAILING)


def nothing_against(_: Evidence) -> str:
    """Refuse no FMU."""
    return ""
