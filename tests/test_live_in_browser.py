"""The live page in a real browser: Chromium, while the run goes on."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cosim

from .live_viewer import live_run
from .test_report_in_browser import browser, pytestmark  # noqa: F401

pytest.importorskip("websockets")

END = "formation.runs[0].end"


@pytest.fixture
def tab(browser: Any) -> Iterator[Any]:  # noqa: F811
    """Return a tab in which nothing is told on the console while the server is there."""
    context = browser.new_context(viewport={"width": 1300, "height": 900})
    tab = context.new_page()
    tab.told = []
    tab.on("console", lambda message: tab.told.append(message.text))
    tab.on("pageerror", lambda error: tab.told.append(str(error)))
    yield tab
    context.close()


def shows(tab: Any, state: str) -> None:
    tab.wait_for_selector(f"#live[data-state={state}]", timeout=60_000)


def until(tab: Any, condition: str) -> None:
    """Wait for a condition, as Playwright cannot under the policy of the page."""
    for _ in range(1200):
        if tab.evaluate(condition):
            return
        tab.wait_for_timeout(50)
    raise AssertionError(condition)


def test_a_run_is_followed_paused_stepped_and_judged(tab: Any, line: str, tmp_path: Path) -> None:
    short = ("--horizon", "60 s", "--set=//rms/@from=10 s", "--set=//settled/@by=10 s")
    with live_run(tmp_path, line, *short, "--pace", "5", "--paused") as run:
        tab.goto(run.address)
        tab.wait_for_selector("html[data-ready=true]", timeout=60_000)
        shows(tab, "paused")
        assert tab.evaluate(END) == 0

        tab.get_by_role("button", name="step", exact=True).click()
        until(tab, f"{END} > 0")
        assert tab.evaluate(END) == pytest.approx(0.02)
        tab.get_by_role("button", name="go on").click()
        shows(tab, "live")

        until(tab, f"{END} > 2")  # the robots move, and the page follows them
        tab.get_by_role("button", name="pause", exact=True).click()
        shows(tab, "paused")
        tab.wait_for_timeout(300)
        held = tab.evaluate(END)
        assert tab.evaluate("formation.state.time") == held
        assert "judged at its end" in tab.locator("#verdicts").inner_text()
        pose = tab.evaluate("poseAt(formation.runs[0], 2, formation.state.time)")

        late = tab.context.new_page()
        late.goto(run.address)
        until(late, f"window.formation?.runs[0].end === {held}")
        assert late.evaluate("poseAt(formation.runs[0], 2, formation.state.time)") == pose
        late.close()

        tab.evaluate("formation.seek(0.5)")  # who looks back stays there
        tab.get_by_role("button", name="go on").click()
        shows(tab, "ended")
        assert tab.evaluate("formation.state.time") == 0.5
        assert tab.evaluate(END) == pytest.approx(60.0)
        assert "settled by 10 s" in tab.locator("#verdicts").inner_text()
        assert tab.told == []

        while "results in" not in run.said:
            tab.wait_for_timeout(20)
        tab.wait_for_timeout(500)
        run.process.send_signal(signal.SIGINT)
        assert run.process.wait(60) == 1  # the expectations are about a longer run
        tab.evaluate("formation.seek(1.5)")  # the page stays usable
        assert tab.evaluate("formation.state.time") == 1.5
    with cosim.load_result(tmp_path / "clmr_line") as result:
        there = result.pose.sel(robot="follower_2").values[round(held / 0.02)]
    assert np.allclose([pose["x"], pose["y"]], there[:2], atol=1e-5)


def test_a_page_whose_server_has_gone_says_so(tab: Any, line: str, tmp_path: Path) -> None:
    with live_run(tmp_path, line, "--paused", "--no-expectations") as run:
        tab.goto(run.address)
        tab.wait_for_selector("html[data-ready=true]", timeout=60_000)
        shows(tab, "paused")
        run.process.kill()
        shows(tab, "gone")
        assert "the server has gone; what has come so far stays here" in tab.locator("#live").inner_text()
        assert not tab.get_by_role("button", name="pause", exact=True).is_visible()
        assert tab.evaluate("poseAt(formation.runs[0], 1, 0).x") == pytest.approx(-5.0)
