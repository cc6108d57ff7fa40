"""Pages in a real browser: Chromium, without a network, from the file itself.

It needs `pip install playwright` and Chromium (Debian: `apt-get install chromium`), and is skipped without them.
"""

from __future__ import annotations

import base64
import io
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread

import cosim
from cosim.report.page import save_report
from cosim.results.outlines import outlined_followers
from cosim.results.result import Result
from cosim.vehicle.outline import frames

SCENARIOS = sorted((Path(__file__).parents[1] / "scenarios").glob("*.xml"))
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), "")
COLOURS = {"follower_1": (0x44, 0x77, 0xAA), "follower_2": (0xEE, 0x66, 0x77)}
"""The first colours of the page."""


def _missing() -> str:
    try:
        import playwright.sync_api  # noqa: F401
    except ImportError:
        return "needs a browser's driver: pip install playwright"
    return "" if CHROMIUM else "needs Chromium: apt-get install chromium"


if _missing() and os.environ.get("FORMATION_REQUIRE_BROWSER"):
    raise RuntimeError(_missing())
pytestmark = [
    pytest.mark.skipif(bool(_missing()), reason=_missing()),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield chromium
        chromium.close()


@pytest.fixture
def opened(browser: Any) -> Iterator[Any]:
    """Open pages without a network; no message of the console and no request but the file itself is allowed."""
    context = browser.new_context(viewport={"width": 1300, "height": 900}, device_scale_factor=1, offline=True)
    told: list[str] = []

    def open_page(path: Path, moment: str = "") -> Any:
        tab = context.new_page()
        tab.on("console", lambda message: told.append(message.text))
        tab.on("pageerror", lambda error: told.append(str(error)))
        tab.on("request", lambda request: told.extend([] if request.url.startswith(path.as_uri()) else [request.url]))
        tab.goto(path.as_uri() + moment)
        tab.wait_for_selector("html[data-ready=true]", timeout=20_000)
        return tab

    yield open_page
    context.close()
    assert told == []


@pytest.fixture(scope="module")
def line(tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Path]:
    """Return a run that is judged, and its page."""
    scenario = cosim.read_scenario(SCENARIOS[0].with_name("clmr_line.xml"))
    text = scenario.path.read_text(encoding="utf-8")
    start = text.index("<expect>")
    stop = text.index("</expect>")
    wanted = '<expect><settled by="1 s" range="0.1 m" bearing="2 deg"/><peak signal="range_error" below="20 m"/>'
    folder = tmp_path_factory.mktemp("line")
    file = folder / "judged.xml"
    file.write_text(text[:start] + wanted + text[stop:], encoding="utf-8")
    result = cosim.run(cosim.read_scenario(file).edited(horizon=4.0))
    save_report([result], folder / "report.html")
    return Result.of(result), folder / "report.html"


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_the_page_of_every_scenario_plays(path: Path, opened: Any, tmp_path: Path) -> None:
    scenario = cosim.read_scenario(path).edited(expectations=False)
    result = cosim.run(scenario.edited(horizon=50 * scenario.step))
    save_report([result], tmp_path / "report.html")

    page = opened(tmp_path / "report.html")

    assert page.title() == scenario.title
    first = _picture(page)
    page.keyboard.press("Space")
    for _ in range(400):  # until it has played to its end; the page's policy lets nothing be evaluated in it
        if not page.evaluate("formation.state.playing"):
            break
        page.wait_for_timeout(50)
    assert page.evaluate("formation.state.time") == pytest.approx(50 * scenario.step)
    assert (_picture(page) != first).any()
    page.get_by_label("Time", exact=True).fill("0")
    assert (_picture(page) == first).all()


@pytest.mark.parametrize("tick", [0, 130])
def test_robots_are_drawn_where_the_result_puts_them(line: tuple[Result, Path], opened: Any, tick: int) -> None:
    result, path = line
    page = opened(path, f"#t={tick * 0.02:.3f}")
    page.evaluate("formation.state.hidden = new Set(['leader', 'follower_3', 'follower_4'])")
    page.evaluate("formation.playback.zoom(1.0); formation.playback.draw()")
    picture = _picture(page)
    followers = outlined_followers(result)
    assert followers is not None
    for robot, colour in COLOURS.items():
        outlined = followers[robot].within(slice(tick, tick + 1))
        body = outlined.outline[0]
        corners = frames(outlined.outline, outlined.pose)[0].place(body.corners)[0]
        for one, other in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            for part in (0.3, 0.7):
                x, y = one + part * (other - one)
                column, row = page.evaluate("([x, y]) => formation.playback.toScreen(x, y)", [float(x), float(y)])
                near = picture[round(row) - 2 : round(row) + 3, round(column) - 2 : round(column) + 3, :3]
                assert np.abs(near - colour).max(axis=-1).min() < 40, (robot, x, y)


def test_a_verdict_leads_to_its_moment(line: tuple[Result, Path], opened: Any) -> None:
    result, path = line
    page = opened(path)
    page.get_by_role("button", name="✗ fails").first.click()
    assert page.evaluate("formation.state.time") == pytest.approx(4.0)
    page.locator("tr", has_text="peak range_error").get_by_role("button").first.click()

    worst = np.unravel_index(np.abs(result["range_error"].values).argmax(), result["range_error"].values.shape)
    assert page.evaluate("formation.state.time") == pytest.approx(0.02 * worst[0])
    assert page.evaluate("formation.state.chosen") == result.robots[int(worst[1])]
    assert page.url.endswith(f"#t={0.02 * worst[0]:.3g}") or worst[0] == 0


def test_panels_show_the_recorded_numbers(line: tuple[Result, Path], opened: Any) -> None:
    result, path = line
    page = opened(path)
    page.get_by_text("choose signals").click()
    page.get_by_role("button", name="speed_estimate", exact=True).click()
    shown = page.evaluate("Array.from(formation.panels.open.get('speed_estimate').plot.data[2])")
    np.testing.assert_allclose(shown, result["speed_estimate"].values[:, 1], rtol=2.0**-16)
    shown = page.evaluate("Array.from(formation.panels.open.get('bearing_error').plot.data[1])")
    np.testing.assert_allclose(shown, np.degrees(result["bearing_error"].values[:, 0]), rtol=2.0**-16)
    page.get_by_role("button", name="follower_2", exact=True).click()
    assert page.evaluate("formation.panels.open.get('bearing_error').plot.data.length") == 4


def test_several_runs_are_compared(line: tuple[Result, Path], opened: Any, tmp_path: Path) -> None:
    result, _ = line
    scenario = cosim.read_scenario(SCENARIOS[0].with_name("clmr_line.xml")).edited(expectations=False)
    other = cosim.run(scenario.edited(["simulation/@seed=2"], horizon=2.0))
    save_report([result, other], tmp_path / "both.html")
    page = opened(tmp_path / "both.html")
    assert page.locator("#runs li").count() == 2
    times, first, *_, last = page.evaluate(
        "formation.panels.open.get('range_error').plot.data.map((x) => Array.from(x))"
    )
    assert len(times) == 201
    np.testing.assert_allclose(first, result["range_error"].values[:, 0], rtol=2.0**-16)
    np.testing.assert_allclose(last[:101], other["range_error"].values[:, 3], rtol=2.0**-16)
    assert all(value is None for value in last[101:])


def test_texts_of_strangers_stay_texts(opened: Any, tmp_path: Path) -> None:
    scenario = SCENARIOS[0].with_name("clmr_line.xml").read_text(encoding="utf-8")
    hostile = "&lt;/title&gt;&lt;script&gt;window.taken = 1&lt;/script&gt;&lt;img src=x onerror=&quot;taken=1&quot;&gt;"
    start = scenario.index("<title>") + len("<title>")
    text = scenario[:start] + hostile + scenario[scenario.index("</title>", start) :]
    text = text.replace("<expect>", "<!-- </script><script>window.taken = 1</script> --><expect>")
    file = tmp_path / "hostile.xml"
    file.write_text(text, encoding="utf-8")
    result = cosim.run(cosim.read_scenario(file).edited(horizon=0.2, expectations=False))
    save_report([result], tmp_path / "report.html")
    page = opened(tmp_path / "report.html")
    page.get_by_text("the scenario as it was run").click()
    assert "window.taken" in page.locator("pre").inner_text()
    assert page.locator("h1").inner_text().startswith("</title><script>")
    assert page.evaluate("window.taken === undefined && document.images.length === 0")


def _picture(page: Any) -> np.ndarray[Any, Any]:
    """Return the pixels of the playback (height, width, 4), of which each value is 0 to 255."""
    url = page.evaluate("document.getElementById('scene').toDataURL()")
    image = imread(io.BytesIO(base64.b64decode(url.partition(",")[2])), format="png")
    return (255 * image).round().astype(int)
