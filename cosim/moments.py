"""Moments that a user states: dates, or seconds since 1970."""

from __future__ import annotations

import math
from datetime import UTC, datetime

from cosim.quantity import quantity


def seconds_of(text: str) -> float:
    """Return a moment as seconds since 1970: of a date with a time, of a number, or of a duration such as ``12.5 s``.

    A date without a time zone is in UTC.

    Raises
    ------
    ValueError
        The text is none of these.
    """
    try:
        seconds = float(text)
    except ValueError:
        try:
            moment = datetime.fromisoformat(text)
        except ValueError:
            return quantity(text, "s")
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    if not math.isfinite(seconds):
        raise ValueError(text)
    return seconds
