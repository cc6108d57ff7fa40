"""The table of a sensitivity on the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console

from cosim.cli.console import safe
from cosim.cli.wide_table import WideColumn, print_wide
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
    figures = [name for name in told[0].figures if not name.endswith("plus_minus")]
    rows: list[tuple[str, ...]] = []
    ends = []
    for one in told:
        unit = f" [{one.unit}]" if one.unit and method == "morris" else ""
        own = [(one.names[place], *(_figure(one, name, place) for name in figures)) for place in one.order()]
        pairs = sorted(one.pairs.items(), key=lambda pair: -pair[1][0])[:_MOST]
        own += [(" with ".join(names), f"{index:z.2f} ± {spread:.2f}", "") for names, (index, spread) in pairs]
        rows += [("" if number else f"{_name(one)}{unit}", *row) for number, row in enumerate(own)]
        ends.append(len(rows) - 1)
    names, values, *cells = zip(*rows, strict=True)
    print_wide(
        console,
        f"{_TITLES[method]}, ± {100 * CONFIDENCE:g} % confidence",
        [WideColumn("measure", names, is_name=True), WideColumn("value", values, is_name=True)],
        [WideColumn(_HEADINGS[name], column) for name, column in zip(figures, cells, strict=True)],
        ends,
    )


def _name(one: Sensitivity) -> str:
    return ", ".join((one.measure, *one.cases))


def _figure(one: Sensitivity, name: str, place: int) -> str:
    told = "z.2f" if name in ("first", "total") else ".4g"
    text = f"{one.figures[name][place]:{told}}"
    spread = one.figures.get(f"{name}_plus_minus")
    return text if spread is None else f"{text} ± {spread[place]:{told.replace('4', '2')}}"
