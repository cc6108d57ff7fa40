"""The table of a sensitivity on the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console

from cosim.cli.console import safe, table
from cosim.studies.sensitivity import CONFIDENCE, Sensitivity

_MOST = 30
"""Measures, and pairs of values of one, that are printed."""
_TITLES = {"saltelli": "shares of the variance", "morris": "changes over the range of each value"}
_HEADINGS = {
    "first": "alone",
    "total": "in all",
    "mean_absolute": "magnitude",
    "mean": "mean",
    "deviation": "deviation",
}


def print_sensitivities(console: Console, method: str, found: Sequence[Sensitivity]) -> None:
    """Print what each measure depends on, the most important value first."""
    told = [one for one in found if one.figures][:_MOST]
    if told:
        _print_table(console, method, told)
    for one in found:
        if one.note:
            console.print(f"[yellow]{'' if one.figures else 'no sensitivity: '}{safe(_name(one))}:[/] {safe(one.note)}")
    left = sum(bool(one.figures) for one in found) - len(told)
    if left:
        console.print(f"{left} more in summary.json")


def _print_table(console: Console, method: str, told: Sequence[Sensitivity]) -> None:
    shown = table(console, f"{_TITLES[method]}, ± {100 * CONFIDENCE:g} % confidence")
    figures = [name for name in told[0].figures if not name.endswith("plus_minus")]
    shown.add_column("measure")
    shown.add_column("value")
    for name in figures:
        shown.add_column(_HEADINGS[name], justify="right", no_wrap=True)
    for one in told:
        unit = f" [{one.unit}]" if one.unit and method == "morris" else ""
        rows = [(one.names[place], *(_figure(one, name, place) for name in figures)) for place in one.order()]
        pairs = sorted(one.pairs.items(), key=lambda pair: -pair[1][0])[:_MOST]
        rows += [(" with ".join(names), f"{index:z.2f} ± {spread:.2f}") for names, (index, spread) in pairs]
        for number, row in enumerate(rows):
            shown.add_row(safe("" if number else f"{_name(one)}{unit}"), *map(safe, row))
        shown.add_section()
    console.print(shown)


def _name(one: Sensitivity) -> str:
    return ", ".join((one.measure, *one.cases))


def _figure(one: Sensitivity, name: str, place: int) -> str:
    told = "z.2f" if name in ("first", "total") else ".4g"
    text = f"{one.figures[name][place]:{told}}"
    spread = one.figures.get(f"{name}_plus_minus")
    return text if spread is None else f"{text} ± {spread[place]:{told.replace('4', '2')}}"
