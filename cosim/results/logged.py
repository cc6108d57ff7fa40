"""Messages that the FMUs logged in a run, as its result keeps them."""

from __future__ import annotations

from dataclasses import dataclass

from cosim.results.result import Result

SHOWN_AT_EITHER_END = 50
"""Number of messages that a summary holds of the start of a run, and of its end."""


@dataclass(frozen=True)
class LoggedMessage:
    """A message that a robot's FMU logged.

    Attributes
    ----------
    time : float
        Communication point [s].
    robot : str
        The robot whose FMU it is.
    status : str
        The FMI status, such as ``Warning``.
    category : str
        As the FMU names it; empty if it gives none.
    text : str
        The message itself.
    count : int
        How many times it came in succession.
    """

    time: float
    robot: str
    status: str
    category: str
    text: str
    count: int


def logged_messages(result: Result) -> tuple[tuple[LoggedMessage, ...], int]:
    """Return the first and the last messages of a result, and the number of those between that are left out.

    The last messages of a failed run give the reason. A result of an earlier version has none.
    """
    number = result.sizes.get("message", 0)
    left_out = max(0, number - 2 * SHOWN_AT_EITHER_END)
    shown = [i for i in range(number) if not 0 <= i - SHOWN_AT_EITHER_END < left_out]
    table = {name: result[f"message_{name}"].values for name in LoggedMessage.__annotations__} if shown else {}
    return tuple(
        LoggedMessage(
            time=float(table["time"][i]),
            robot=str(table["robot"][i]),
            status=str(table["status"][i]),
            category=str(table["category"][i]),
            text=str(table["text"][i]),
            count=int(table["count"][i]),
        )
        for i in shown
    ), left_out
