"""Pages in a real browser: Chromium, without a network, from the file itself.

It needs `pip install playwright` and Chromium (Debian: `apt-get install chromium`), and is skipped without them.
"""

from __future__ import annotations

import base64
import io
import json
import math
import os
import re
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread

import cosim
from cosim.report.page import save_report, save_study_report
from cosim.results.files import save
from cosim.results.outlines import outlined_followers
from cosim.results.result import Result
from cosim.tests.study_folder import write_study_folder
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


def test_a_change_without_spaces_fits_a_phone(opened: Any, tmp_path: Path) -> None:
    scenario = cosim.read_scenario(SCENARIOS[0].with_name("clmr_line.xml"))
    change = "//plant[@id='clmr']/parameter[@name='m_c']/@value=45 kg"
    save_report([cosim.run(scenario.edited([change], horizon=0.4, expectations=False))], tmp_path / "report.html")
    page = opened(tmp_path / "report.html")
    page.set_viewport_size({"width": 380, "height": 900})
    assert "@value=45 kg" in page.locator("#runs").inner_text()
    assert page.evaluate("document.documentElement.scrollWidth") == 380


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


def test_robots_far_from_the_origin_are_where_the_result_puts_them(opened: Any, tmp_path: Path) -> None:
    text = SCENARIOS[0].with_name("clmr_line.xml").read_text(encoding="utf-8")

    def moved(pose: re.Match[str]) -> str:  # as in coordinates of a national grid
        return f'<pose x="{float(pose[1]) + 500_000!r} m" y="{float(pose[2]) + 5_000_000!r} m"'

    text, poses = re.subn(r'<pose x="(\S+) m" y="(\S+) m"', moved, text)
    assert poses == 5
    (tmp_path / "far.xml").write_text(text, encoding="utf-8")
    result = cosim.run(cosim.read_scenario(tmp_path / "far.xml").edited(horizon=2.0, expectations=False))
    save_report([result], tmp_path / "report.html")

    page = opened(tmp_path / "report.html", "#t=2")

    places = page.evaluate("formation.runs[0].vehicles.map((_, k) => poseAt(formation.runs[0], k, 2))")
    assert [place["x"] for place in places[1:]] == pytest.approx(result["pose"].values[-1, :, 0].tolist(), abs=1e-3)
    assert [place["y"] for place in places[1:]] == pytest.approx(result["pose"].values[-1, :, 1].tolist(), abs=1e-3)
    assert page.locator("#warning").inner_text() == ""
    page.evaluate("['x', 'y'].forEach((axis) => formation.panels.show(`leader_pose/${axis}`))")
    told = page.locator("#panels figure").all_inner_texts()[-2:]
    shown = [float(re.search(r"leader ([\d.]+) m", one)[1]) for one in told]
    assert shown == pytest.approx(result["leader_pose"].values[-1, :2].tolist(), abs=0.01)


def test_robots_whose_heading_is_unknown_do_not_overlap(opened: Any, tmp_path: Path) -> None:
    """As in a recorded drive that lacks it; here they are some metres apart."""
    scenario = cosim.read_scenario(SCENARIOS[0].with_name("clmr_line.xml")).edited(horizon=1.0, expectations=False)
    result = cosim.run(scenario)
    result["pose"][{"time": slice(10, None), "robot": [0, 1], "pose_component": 2}] = np.nan
    save_report([result], tmp_path / "report.html")

    page = opened(tmp_path / "report.html", "#t=0.6")

    assert page.locator("#warning").inner_text() == ""
    assert "– m" not in page.locator("body").inner_text()


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


def test_a_result_without_all_samples_is_shown_at_their_times(
    line: tuple[Result, Path], opened: Any, tmp_path: Path
) -> None:
    whole = line[0].dataset
    event = '<event at="{} s" robots="follower_1"><parameter name="m_c" value="40 kg"/></event><expect>'
    for at in (2.5, 0.5):
        whole = whole.assign_attrs(scenario=whole.attrs["scenario"].replace("<expect>", event.format(at), 1))
    part = Result.of(whole.sel(time=slice(2, 3)))
    save_report([part], tmp_path / "part.html")
    page = opened(tmp_path / "part.html", "#t=2.5")

    def now() -> Any:
        return page.evaluate("formation.state.time")

    assert now() == 2.5
    assert page.locator("#clock").inner_text() == "2.50 / 3.00 s"
    x, y = part["pose"].values[25, 0, :2]
    pose = page.evaluate("poseAt(formation.runs[0], 1, 2.5)")
    assert (pose["x"], pose["y"]) == pytest.approx((x, y), rel=2.0**-15)
    shown = page.evaluate("formation.panels.open.get('range_error').plot.data.map((x) => Array.from(x))")
    assert shown[0] == pytest.approx(part["time"].values.tolist())
    error = re.search(r"follower_1 (\S+) m", page.locator("#panels figure").first.inner_text())
    assert float(error[1]) == pytest.approx(part["range_error"].values[25, 0], rel=1e-3)
    (mark,) = page.locator("#marks button").all()  # that of the event before is on no place of the time line
    assert mark.evaluate("(mark) => mark.style.left") == "50%"
    for key, time in (("Home", 2.0), ("ArrowLeft", 2.0), ("Shift+ArrowRight", 2.02), ("End", 3.0), ("Space", 2.0)):
        page.keyboard.press(key)
        if key == "Space":
            page.keyboard.press("Space")
            assert now() < 3.0, "it plays from its first sample on"
        else:
            assert now() == pytest.approx(time)
    rows = page.locator("#notes tbody tr")
    assert rows.all_inner_texts()[0].startswith("0.50 s"), "the run came to it"
    assert [row.get_by_role("button").count() for row in rows.all()] == [0, 1]
    rows.nth(1).get_by_role("button").click()
    assert now() == 2.5

    thinned = whole.isel(time=[*range(0, 101, 25), *range(150, 201, 25)])
    save_report([thinned, whole], tmp_path / "thinned.html")
    save_report([thinned], tmp_path / "alone.html")
    page = opened(tmp_path / "alone.html", "#t=2")
    for key, time in (("Shift+ArrowRight", 3.0), ("Shift+ArrowRight", 3.5), ("Shift+ArrowLeft", 3.0)):
        page.keyboard.press(key)
        assert now() == time
    page = opened(tmp_path / "thinned.html")
    assert page.evaluate("formation.panels.open.get('range_error').plot.data[0].length") == 201

    save_report([whole, part], tmp_path / "both.html")
    page = opened(tmp_path / "both.html", "#t=1")
    page.get_by_text("choose signals").click()
    told = page.locator("#panels figure").first.inner_text()
    assert re.search(r"follower_1 \(1\) \S+ m", told)
    assert "follower_1 (2) –" in told, "it has no sample yet"


def test_a_recorded_drive_is_told_as_one(line: tuple[Result, Path], opened: Any, tmp_path: Path) -> None:
    result, _ = line
    attrs = {**result.attrs, "recording": "/data/drive.mcap", "recording_start": 3.5}
    save_report([replace(result, attrs=attrs)], tmp_path / "drive.html")
    page = opened(tmp_path / "drive.html")
    told = page.locator("#provenance").inner_text()
    assert "/data/drive.mcap from 3.5 s" in told
    assert "repeat it" not in told
    assert "formation run" not in told
    assert "clmr_line, a recorded drive, " in page.locator("#runs").inner_text()


def test_large_seeds_are_shown_and_compared_to_the_last_digit(
    line: tuple[Result, Path], opened: Any, tmp_path: Path
) -> None:
    result, _ = line
    seeds = [2**53, 2**53 + 1]
    save_report([replace(result, attrs={**result.attrs, "seed": seed}) for seed in seeds], tmp_path / "seeds.html")
    page = opened(tmp_path / "seeds.html")
    row = page.locator("#compared tr", has_text="seed").locator("td").all_inner_texts()
    assert row == ["seed", *map(str, seeds)]
    for seed, told in zip(seeds, page.locator("#runs li").all_inner_texts(), strict=True):
        assert told.endswith(f"seed {seed}")


def test_large_seeds_of_a_study_are_shown_sorted_and_filtered_to_the_last_digit(opened: Any, tmp_path: Path) -> None:
    write_study_folder(tmp_path, 8, first_seed=2**53)
    (tmp_path / "cases.csv").write_text(f"seed,passed\n{2**53 + 1},3\n", encoding="utf-8")
    save_study_report(tmp_path, tmp_path / "report.html")
    page = opened(tmp_path / "report.html")
    seeds = [str(2**53 + k) for k in range(8)]
    place = page.locator("table.runs th[scope=col]").all_inner_texts().index("seed") + 1
    assert str(2**53 + 1) in page.locator("#cases").inner_text()
    button = page.locator("table.runs th button", has_text="seed")
    button.click()
    assert _column(page, place) == seeds
    button.click()
    assert _column(page, place) == seeds[::-1]
    page.get_by_label("Filter runs").fill(f"seed = {seeds[3]}")
    assert _column(page, place) == [seeds[3]]
    page.get_by_label("Filter runs").fill(f"seed > {seeds[5]}")
    assert _column(page, place) == seeds[:5:-1]


def test_a_panel_shows_a_signal_in_one_unit(line: tuple[Result, Path], opened: Any, tmp_path: Path) -> None:
    """Two versions of a law may give a signal of one name in other units, or another signal that name."""
    result, _ = line
    dataset = result.dataset
    versions = [dataset.assign(telling=dataset["range_error"].assign_attrs(units=unit)) for unit in ("rad", "deg", "m")]
    save_report(versions, tmp_path / "versions.html")
    page = opened(tmp_path / "versions.html")
    page.evaluate("formation.panels.show('telling')")
    data = page.evaluate("formation.panels.open.get('telling').plot.data.map((x) => Array.from(x))")
    errors = result["range_error"].values[:, 0]
    assert len(data) == 1 + 4 + 4, "metres are none of its units"
    np.testing.assert_allclose(data[1], np.degrees(errors), rtol=2.0**-16)
    np.testing.assert_allclose(data[5], errors, rtol=2.0**-16)


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
    page.locator("pre .x-tag").first.wait_for()
    assert "window.taken" in page.locator("pre").inner_text()
    assert page.locator("h1").inner_text().startswith("</title><script>")
    assert page.evaluate("window.taken === undefined && document.images.length === 0")


def _picture(page: Any) -> np.ndarray[Any, Any]:
    """Return the pixels of the playback (height, width, 4), of which each value is 0 to 255."""
    url = page.evaluate("document.getElementById('scene').toDataURL()")
    image = imread(io.BytesIO(base64.b64decode(url.partition(",")[2])), format="png")
    return (255 * image).round().astype(int)


# Studies and comparisons ------------------------------------------------------------------------------------


@pytest.fixture
def study(line: tuple[Result, Path], tmp_path: Path) -> Path:
    """Return the page of a study of 10,000 runs, two of which are played."""
    write_study_folder(tmp_path / "many", 10_000)
    for number in (3, 7):
        (tmp_path / "many" / "kept" / f"run_{number}").mkdir(parents=True)
        save(line[0], tmp_path / "many" / "kept" / f"run_{number}" / "result.nc")
    save_study_report(tmp_path / "many", tmp_path / "many" / "report.html")
    return tmp_path / "many" / "report.html"


def _column(page: Any, number: int) -> list[str]:
    cells: list[str] = page.locator(f"table.runs tbody tr > :nth-child({number})").all_inner_texts()
    return cells


def test_a_bound_that_is_of_some_runs_alone_says_of_which_on_the_page(opened: Any, tmp_path: Path) -> None:
    pictures = []
    for given in ({}, {"given": "given law stiff"}):
        folder = tmp_path / f"many {len(given)}"
        bound = {"measure": "settling", "kind": "quantile", "below": 71.0, **given}
        write_study_folder(folder, 40, bounds=[bound])
        save_study_report(folder, folder / "report.html")
        page = opened(folder / "report.html")
        told = page.evaluate("formation.scatter.bounds(formation.study.column('settling'), (value) => 10 * value)")
        assert told == [{"at": 710.0, "of": "bound given law stiff" if given else ""}]
        pictures.append([page.locator(chart).screenshot() for chart in ("#scatter", "#histogram")])
    for of_all, of_some in zip(*pictures, strict=True):
        assert of_all != of_some, "the text is drawn"


def test_the_runs_of_a_study_are_sorted_and_filtered(study: Path, opened: Any) -> None:
    page = opened(study)
    assert page.locator("#ends").inner_text().startswith("many, 10,000 runs: ")
    assert page.get_by_text("runs 1 to 25 of 10,000").is_visible()
    page.get_by_role("button", name="mass [kg]", exact=True).press("Enter")
    masses = [float(mass) for mass in _column(page, 2)]
    assert masses == sorted(masses)
    assert masses[0] == pytest.approx(25.0, abs=0.01)
    page.get_by_role("button", name="settling [s]", exact=True).click()
    assert _column(page, 6)[0] == "∞"  # the worst first, and those without a number last
    assert page.get_by_role("columnheader", name="settling").get_attribute("aria-sort") == "descending"
    page.get_by_label("Filter runs").fill("mass > 30.5, stiff")
    shown = page.evaluate("formation.rows.rows.length")
    expected = sum(25 + 7 * (run * 0.618034 % 1) > 30.5 for run in range(2, 10_001, 2))
    assert shown == expected
    page.get_by_role("button", name="Rows after").click()
    assert page.get_by_text(f"runs 26 to 50 of {expected:,}").is_visible()
    page.get_by_label("Filter runs").fill("no such text")
    assert page.get_by_text("no such run").is_visible()
    page.get_by_label("Filter runs").fill("")
    page.get_by_role("button", name="passed").click()
    page.get_by_role("button", name="failed").click()
    assert _column(page, 1) == ["1"]  # the broken one


def test_a_point_of_a_study_leads_to_its_run(study: Path, opened: Any) -> None:
    page = opened(study)
    assert page.evaluate("formation.scatter.points.length") == 9_999  # one is broken
    page.locator("#scatter").scroll_into_view_if_needed()
    x, y, row = page.evaluate(
        "formation.scatter.points.find(([, , row]) => row === 1)"
    )  # without a figure, at the edge
    found = page.evaluate("([x, y]) => formation.scatter.nearest(x, y)", [x, y])
    assert found == row
    page.locator("#scatter").click(position={"x": x, "y": y})
    assert page.locator("#chosen-run h2").inner_text() == f"Run {found + 1}"
    assert page.url.endswith(f"#run={found + 1}")
    command = page.locator("#chosen-run code").inner_text()
    assert command.startswith("formation study 'studies/my many.xml' --out ")
    assert command.endswith(f" --keep {found + 1}")
    page.get_by_role("button", name="close", exact=True).click()
    assert page.locator("#chosen-run").is_hidden()


@pytest.mark.parametrize(("worst", "told"), [(-math.inf, "-∞"), (math.inf, "∞")])
def test_a_run_without_a_figure_is_told_with_its_sign(opened: Any, tmp_path: Path, worst: float, told: str) -> None:
    write_study_folder(tmp_path, 40, none=worst)
    save_study_report(tmp_path, tmp_path / "report.html")
    page = opened(tmp_path / "report.html")
    spread = page.get_by_role("row").filter(has_text="settling [s]").filter(has_text="68.5").inner_text().split("\t")
    assert (spread[1], spread[5]) == (("-∞", "71.9") if worst < 0 else ("65", "∞"))
    assert told in _column(page, 6)
    numbers = "numbersOf({ isNumber: true, values: Float64Array.of(1, 3, 10, 30, 100, %s, NaN) }).numbers"
    shown = page.evaluate(f"Array.from({numbers % ('-Infinity' if worst < 0 else 'Infinity')})")
    assert (shown[2], shown[5], math.isnan(shown[6])) == (1.0, worst, True)  # by logarithms


def test_runs_of_a_study_are_played_and_compared(study: Path, opened: Any) -> None:
    page = opened(study)
    page.get_by_role("button", name="play run 3").click()
    first = _picture(page)
    page.evaluate("formation.seek(3)")
    assert (_picture(page) != first).any()
    page.get_by_role("button", name="play run 7").click()
    assert page.locator("#runs li").count() == 2
    assert "play=3+7" in page.url
    assert page.locator("#compared").is_visible()
    page.get_by_role("button", name="play run 3").click()
    page.get_by_role("button", name="play run 7").click()
    assert page.locator("#scene").count() == 0
    again = opened(study, "#run=2&play=7&t=1.5")
    assert again.evaluate("formation.state.time") == 1.5
    assert again.locator("#chosen-run h2").inner_text() == "Run 2"


def test_texts_of_a_study_stay_texts(opened: Any, tmp_path: Path) -> None:
    hostile = "</script><script>window.taken = 1</script><img src=x onerror='taken=1'>"
    write_study_folder(tmp_path, 30, message=hostile, title=hostile, changes=[hostile], worst={"run": hostile})
    (tmp_path / "cases.csv").write_text(f"{hostile},passed\n{hostile},3\n", encoding="utf-8")
    (tmp_path / "figure.png").write_bytes(hostile.encode())
    save_study_report(tmp_path, tmp_path / "report.html")
    page = opened(tmp_path / "report.html")
    assert page.locator("h1").inner_text() == hostile
    page.get_by_role("button", name="show run 1", exact=True).click()
    assert hostile in page.locator("#chosen-run").inner_text()
    assert page.evaluate("window.taken === undefined && document.images.length === 1")


def test_inputs_that_are_no_text_of_the_scenario_are_compared_and_what_is_not_is_said(
    opened: Any, tmp_path: Path
) -> None:
    text = SCENARIOS[0].with_name("clmr_line.xml").read_text(encoding="utf-8")
    push = '<input name="tau_drive"><table file="push.csv" column="push"/></input>'
    (tmp_path / "pushed.xml").write_text(text.replace("<leader ", f"{push}<leader ", 1), encoding="utf-8")
    scenario = cosim.read_scenario(tmp_path / "pushed.xml").edited(horizon=0.2, expectations=False)
    results = {}
    for name, torque in (("gentle", 1), ("hard", 300)):
        (tmp_path / "push.csv").write_text(f"time [s],push [N.m]\n0,0\n0.6,{torque}\n", encoding="utf-8")
        results[name] = cosim.run(scenario)
    with cosim.Simulation(scenario) as simulation:
        while not simulation.finished:
            simulation.step({"follower_1": (-5.0, 0.0)} if simulation.time < 0.1 else None)
        results["given"] = simulation.result()
    for name, result in list(results.items()):
        older = results[f"old {name}"] = result.copy()
        del older.attrs["files"]

    def told(*names: str) -> str:
        save_report([results[name] for name in names], tmp_path / "compared.html")
        page = opened(tmp_path / "compared.html")
        text = page.locator("#compared").inner_text()
        page.set_viewport_size({"width": 380, "height": 900})
        assert page.evaluate("document.getElementById('compared').scrollWidth") <= 380
        page.close()
        return str(text[text.index("What differs") : text.index("Largest distance")])

    nothing = "Nothing of what is compared: the scenarios with their changes, the files that they name, the seeds"
    assert nothing in told("hard", "hard")
    checksums = [json.loads(results[name].attrs["files"])["push.csv"][:16] for name in ("gentle", "hard")]
    assert f"SHA-256 of push.csv\t{checksums[0]}\t{checksums[1]}" in told("gentle", "hard")
    given = told("hard", "given")
    assert "commands of a program to follower_1\tnone\tfrom 0.00 s to 0.08 s" in given
    assert "gave commands to follower_1 in run 2; of these only their times are compared" in given
    older = told("old gentle", "old hard")
    assert "Nothing of what is compared: the scenarios with their changes, the seeds" in older
    assert "Run 1, of an older version, does not tell what push.csv held" in older
    assert f"SHA-256 of push.csv\tunknown\t{checksums[1]}" in told("old gentle", "hard")


def test_elements_are_compared_however_they_are_written(line: tuple[Result, Path], opened: Any, tmp_path: Path) -> None:
    result, _ = line
    peak = '<peak signal="range_error" below="20 m"/>'
    text = str(result.attrs["scenario"])
    assert peak in text
    settled = text[text.index("<settled") : text.index(peak)]

    def told(other: str) -> str:
        save_report([result, replace(result, attrs={**result.attrs, "scenario": other})], tmp_path / "compared.html")
        page = opened(tmp_path / "compared.html")
        return str(page.locator("#compared").inner_text())

    assert "Nothing of what is compared" in told(text)
    assert "expect/regular\tnone\tthere" in told(text.replace(peak, f"{peak}<regular/>"))
    assert "order of the elements\tas in 1\tanother" in told(text.replace(settled + peak, peak + settled))


def test_differences_of_runs(line: tuple[Result, Path], opened: Any, tmp_path: Path) -> None:
    result, _ = line
    scenario = cosim.read_scenario(SCENARIOS[0].with_name("clmr_line.xml")).edited(expectations=False)
    moved = cosim.run(scenario.edited(["follower[@id='follower_2']/pose/@y=10.5 m", "simulation/@seed=2"], horizon=3.0))
    save_report([result, moved], tmp_path / "both.html")
    page = opened(tmp_path / "both.html")
    told = page.locator("#compared")
    path = "follower[@id='follower_2']/pose/@y"
    assert told.locator("tr", has_text=path).locator("td").all_inner_texts()[1:] == ["10 m", "10.5 m"]
    assert told.locator("tr", has_text="seed").locator("td").all_inner_texts() == ["seed", "1", "2"]

    apart = np.linalg.norm((result["pose"].values[:151] - moved["pose"].values)[..., 1, :2], axis=-1)
    row = told.locator("tr", has_text="at the end").locator("..").locator("..").locator("tbody tr").first
    assert row.locator("td").first.inner_text() == "follower_2"
    row.get_by_role("button").click()
    assert page.evaluate("formation.state.time") == pytest.approx(0.02 * apart.argmax())
    assert float(row.locator("td").nth(1).inner_text().split()[0]) == pytest.approx(apart.max(), rel=1e-3)

    rms = told.locator("tr", has_text="range RMS").locator("td").all_inner_texts()
    worst = [max(one.range_rms for one in cosim.summary_of(run).followers) for run in (result, moved)]
    assert float(rms[1].split()[0]) == pytest.approx(worst[0], rel=1e-3)
    assert rms[2].endswith("better" if worst[1] < worst[0] else "worse")


def test_a_figure_that_a_run_has_not_is_told_as_none(line: tuple[Result, Path], opened: Any, tmp_path: Path) -> None:
    """One that was cut short has no last fifth, and one has a follower that the other has not."""
    result, _ = line
    scenario = cosim.read_scenario(SCENARIOS[0].with_name("clmr_line.xml")).edited(
        ["follower[@id='follower_4']/@id=another"], expectations=False
    )
    with cosim.Simulation(scenario) as simulation:
        simulation.step()
        save_report([result, simulation.result()], tmp_path / "both.html")
    page = opened(tmp_path / "both.html")
    rms = page.locator("#compared tr", has_text="range RMS").locator("td").all_inner_texts()
    assert rms[2].strip() == "none"
    settled = page.locator("#compared tr", has_text="settled within 0.1 m and 2 deg after").locator("td")
    assert settled.all_inner_texts()[2].split("\n")[0] == "not"
    rows = [row.locator("td").all_inner_texts() for row in page.locator("#followers tbody tr").all()]
    assert [row[:2] for row in rows[-4:]] == [
        ["follower_4", "1"],
        ["follower_4", "2"],
        ["another", "1"],
        ["another", "2"],
    ]
    assert rows[-3][2:] == rows[-2][2:] == ["–"] * 4
    assert rows[-1][2:5] == ["not", "–", "–"]
    assert rows[-1][5].endswith("N.m")
