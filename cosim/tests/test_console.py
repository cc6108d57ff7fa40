"""The output fits narrow terminals, and long work is announced."""

import io
import time
from pathlib import Path

import pytest
import xarray as xr
from rich.console import Console

import cosim
from cosim.cli import console as module
from cosim.cli.console import broken, say, taking_a_while
from cosim.cli.summary import print_summary
from cosim.results.summary import summary_of

from .driving import IN_A_SECOND


@pytest.mark.parametrize(
    ("name", "lines"),
    [
        ("short", ["short"]),
        ("vehicle.axle[2].wheel.contact_1.force", ["vehicle.axle[2].", "wheel.contact_1.", "force"]),
        ("unbreakablenameofonewordalone", ["unbreakablenameofonewordalone"]),
        ('initial="robot state"', ['initial="robot ', 'state"']),
        ("", [""]),
    ],
)
def test_long_names_are_broken_between_words(name: str, lines: list[str]) -> None:
    assert broken(name, 16).split("\n") == lines
    assert "".join(lines) == name


def test_what_takes_a_while_is_told_where_there_is_no_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with taking_a_while("soon done"):
        pass
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(module, "PATIENCE", 0.0)
    said = ""
    with taking_a_while("compiling"):
        deadline = time.monotonic() + 30.0
        while not said and time.monotonic() < deadline:
            said = capsys.readouterr().err
            time.sleep(0.01)
    assert said == "compiling ...\n"


def test_a_sentence_ends_its_lines_between_words_on_a_terminal_and_is_one_line_elsewhere() -> None:
    sentence = "[green]holds[/]  settled by 80 s within 0.1 m and 2 deg: 70.38 s, margin 9.62 s (follower_1)"
    for terminal in (True, False):
        printed = io.StringIO()
        say(Console(file=printed, width=40, force_terminal=terminal, color_system=None), sentence)
        lines = printed.getvalue().splitlines()
        assert " ".join(line.strip() for line in lines) == sentence.removeprefix("[green]").replace("[/]", "")
        assert [line.startswith(" " * 7) for line in lines] == [False, *[True] * (len(lines) - 1)]
        assert max(map(len, lines)) <= 40 or not terminal
        assert (len(lines) > 1) == terminal


@pytest.mark.parametrize("width", [60, 80, 200])
def test_no_heading_is_cut(result: xr.Dataset, width: int) -> None:
    printed = io.StringIO()
    print_summary(Console(file=printed, width=width, force_terminal=True, color_system=None), summary_of(result))
    framed = [line for line in printed.getvalue().splitlines() if line.startswith(("│", "╭"))]
    assert len(framed) > 3
    assert max(map(len, framed)) <= width
    assert "…" not in printed.getvalue()


@pytest.fixture(scope="module")
def result(scenarios: Path) -> xr.Dataset:
    return cosim.run(scenarios / "clmr_line.xml", IN_A_SECOND, horizon=1.0)


def test_nothing_that_is_printed_controls_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    module.out().print("\x9b31m \u202e \u2067 naïve 👩\u200d🚀", markup=False)
    assert capsys.readouterr().out == "?31m ? ? naïve 👩\u200d🚀\n"
