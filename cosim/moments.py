"""Moments that a user states: dates, or seconds since 1970; whole nanoseconds, as clocks of robots count them."""

from __future__ import annotations

from datetime import UTC, datetime
from decimal import Decimal, InvalidOperation

from cosim.quantity import split
from plants import UnitError, units

SECOND = 1_000_000_000
"""Nanoseconds of a second."""
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def nanoseconds_of(moment: float | str) -> int:
    """Return a moment as nanoseconds since 1970.

    Parameters
    ----------
    moment
        Seconds, as a number, as a text, or as a duration such as ``12.5 s``; or a date with a time, in UTC unless it
        states another time zone.

    Raises
    ------
    ValueError
        It is none of these.
    """
    if not isinstance(moment, str):
        seconds, rest = divmod(moment, 1.0)
        return int(seconds) * SECOND + round(rest * SECOND)
    try:
        date = datetime.fromisoformat(moment)
    except ValueError:
        return _of_duration(moment)
    since = (date if date.tzinfo else date.replace(tzinfo=UTC)) - _EPOCH
    return (since.days * 86_400 + since.seconds) * SECOND + since.microseconds * 1000


def _of_duration(text: str) -> int:
    number, _, unit = text.strip().partition(" ")
    try:
        seconds = Decimal(number)
        if unit:
            split(text)
            factor = units.convert(1.0, unit, "s")
            seconds *= Decimal(repr(factor))
        if not abs(seconds) < 10**11:
            raise ValueError(f"{text} is no time")
        return int((seconds * SECOND).to_integral_value())
    except (InvalidOperation, UnitError) as error:
        raise ValueError(str(error)) from None
