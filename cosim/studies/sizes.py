"""How many runs a study may have, and what is said of one that has more."""

from __future__ import annotations

MOST_RUNS = 1_000_000
"""Upper limit for the runs of a study."""
_USUAL = 0.1
"""Time [s] of a run, where nothing is known of it."""
_UNITS = ((86_400.0 * 365.25, "years"), (86_400.0, "days"), (3_600.0, "h"), (60.0, "min"), (1.0, "s"))


def too_many(runs: int) -> str:
    """Return, in words, that these are more runs than a study may have, and how long they would take."""
    return (
        f"more than {MOST_RUNS:,} runs, the most of a study: at {_USUAL:g} s a run, they would take a processor "
        f"{in_words(runs * _USUAL)}"
    )


def in_words(seconds: float) -> str:
    """Return a time in words, with two digits at most."""
    for size, unit in _UNITS:
        if seconds >= 1.995 * size:
            number = seconds / size
            return f"{number:,.0f} {unit}" if number >= 10.0 else f"{float(f'{number:.2g}'):g} {unit}"
    return "2 s"
