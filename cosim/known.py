"""What functions have returned, so that the same is not worked out again in the next run of a study."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


class Known:
    """The last result of each function at each place, with its arguments.

    For functions whose results follow from their arguments alone and are never changed: what they return is the same
    with and without it. A place is a robot or another part of a scenario, so that each of them keeps a result.
    """

    def __init__(self) -> None:
        self._last: dict[tuple[Any, Hashable], tuple[tuple[Any, ...], Any]] = {}

    def of(self, place: Hashable, function: Callable[P, T], *arguments: P.args, **named: P.kwargs) -> T:
        """Return what a function returns for arguments: the last result if these are equal to the last ones."""
        given, found = (arguments, named), self._last.get((function, place))
        if found is not None and found[0] == given:
            return found[1]  # type: ignore[no-any-return]
        result = function(*arguments, **named)
        self._last[function, place] = given, result
        return result
