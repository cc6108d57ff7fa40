"""Tables with many columns are legible in narrow and in wide terminals: nothing of them is left out."""

import io

import pytest
from rich.console import Console

from cosim.cli.wide_table import WideColumn, print_wide

LAWS = ["paper_printed", "comparator_tracking", "feedback_linearisation"]
CONDITIONS = ["as_tuned", "masses_of_followers_x_1.5", "damping_of_followers_halved"]


@pytest.mark.parametrize("terminal", [True, False])
@pytest.mark.parametrize(("width", "tables"), [(60, 5), (80, 3), (200, 1)])
def test_what_is_too_wide_goes_on_below(width: int, tables: int, terminal: bool) -> None:
    console = Console(file=io.StringIO(), width=width, force_terminal=terminal, color_system=None)
    measures = [f"measure_{number}\n[N.m]" for number in range(8)]
    kept = [
        WideColumn("law", LAWS, is_name=True),
        WideColumn("condition", CONDITIONS, is_name=True),
    ]
    others = [WideColumn("passed", ["20 of 20", "3 of 20", "17 of 20,\n3 broken"])]
    others += [WideColumn(heading, [f"{number}.123", "0.5", "infinite"]) for number, heading in enumerate(measures)]
    print_wide(console, "worst of [b]all[/b] runs", kept, others)
    printed = console.file.getvalue()
    assert "…" not in printed
    assert max(map(len, printed.splitlines())) <= width
    squeezed = "".join(printed.split())
    for number in range(8):
        assert printed.count(f" measure_{number} ") == 1
        assert f"{number}.123" in squeezed
    assert printed.count("linearisation") == tables


def test_a_table_without_others_and_a_name_that_cannot_be_broken() -> None:
    console = Console(file=io.StringIO(), width=40)
    print_wide(console, "", [WideColumn("law", ["a[x]", "b"], is_name=True)], [])
    assert "a[x]" in console.file.getvalue()
    print_wide(
        console, "", [WideColumn("law", ["x" * 60], is_name=True)], [WideColumn("a", ["1"]), WideColumn("b", ["2"])]
    )
    assert "2" in console.file.getvalue()
