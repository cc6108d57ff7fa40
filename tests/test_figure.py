"""The figure of a run draws all that the run has, whatever the law and the kind of vehicle."""

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

import cosim
from cosim.cli import main
from cosim.errors import InputError
from cosim.results.body_distance import nearest_bodies, smallest_body_distance
from cosim.results.colours import GOOD
from cosim.results.expectations.shown import Band
from cosim.results.figure import draw, save_figure
from cosim.results.figure_panels import view
from cosim.results.files import save
from cosim.results.metrics import smallest_distance
from cosim.results.outlines import outlined_followers
from cosim.results.panels import Panel, panels, paper_panels
from cosim.results.result import Result, Variable

SCENARIOS = Path(__file__).resolve().parents[1] / "scenarios"


@pytest.fixture(scope="module", params=["clmr_line", "mixed_team"])
def result(request: pytest.FixtureRequest) -> Result:
    return driven(request.param)


@pytest.fixture(scope="module")
def mixed() -> Result:
    return driven("mixed_team")


@cache
def driven(name: str) -> Result:
    return Result.of(cosim.run(SCENARIOS / f"{name}.xml", horizon=3.0, expectations=False))


def written(figure: Figure) -> str:
    """Return all texts of a figure."""
    return "\n".join(text.get_text() for text in figure.findobj(match=lambda one: hasattr(one, "get_text")))


def named(found: tuple[Panel, ...], title: str) -> Panel:
    return next(panel for panel in found if panel.title == title)


# Which panels there are -------------------------------------------------------------------------------------


def test_every_signal_of_the_followers_has_its_panel(result: Result) -> None:
    titles = " ".join(panel.title for panel in panels(result))
    for name, signal in result.data_vars.items():
        if {"time", "robot"} <= set(signal.dims) and name not in (
            *("pose", "range", "bearing", "desired_range", "desired_bearing", "measured_pose", "torque_command"),
        ):
            assert name.replace("_", " ") in titles


def test_telemetry_of_an_unknown_law_is_drawn(result: Result) -> None:
    samples, robots = result.sizes["time"], len(result.robots)
    growing = np.arange(samples * robots * 2, dtype=float).reshape(samples, robots, 2)
    own = Variable(("time", "robot", "mood_component"), growing, {"units": "rad, V", "long_name": "mood"})
    still = Variable(("time", "robot"), np.full((samples, robots), 7.0), {"units": "1"})
    labels = Variable(("mood_component",), np.array(["tilt", "charge"]))
    odd = replace(
        result,
        data_vars={**result.data_vars, "mood": own, "patience": still, "speed_estimate": own},
        coords={**result.coords, "mood_component": labels},
    )
    found = panels(odd)
    assert named(found, "mood tilt").unit == "deg"
    assert np.array_equal(named(found, "mood tilt").courses, np.degrees(growing[..., 0]))
    assert named(found, "mood charge").unit == "V"
    assert "mood tilt [deg]" in written(draw(odd))
    assert "constant: " in written(draw(odd))
    assert "patience" in written(draw(odd)).partition("constant: ")[2]


def test_angles_are_those_between_parts(mixed: Result) -> None:
    angle = named(panels(mixed), "angle of steering or tractor")
    pose = dict(zip(mixed.robots, np.moveaxis(mixed["pose"].values, 1, 0), strict=True))
    row = mixed.robots.index
    assert np.allclose(angle.courses[:, row("car_1")], np.degrees(pose["car_1"][:, 3]))
    truck = pose["truck_1"]
    assert np.allclose(angle.courses[:, row("truck_1")], np.degrees(truck[:, 3] - truck[:, 2]))


def test_distances_are_those_of_the_summary(result: Result) -> None:
    followers = outlined_followers(result)
    assert followers is not None
    bodies, points = nearest_bodies(followers), named(panels(result), "distance to the nearest follower").courses
    for courses, nearest in ((bodies, smallest_body_distance(result)), (points, smallest_distance(result))):
        assert nearest is not None
        assert courses.min() == pytest.approx(nearest.distance, abs=1e-12)
        sample = int(courses.min(axis=1).argmin())
        for robot in nearest.between:
            assert courses[sample, result.row(robot)] == pytest.approx(nearest.distance, abs=1e-12)


def test_a_follower_without_a_place_is_near_nobody(mixed: Result) -> None:
    poses = mixed["pose"].values.copy()
    poses[10:, 1] = np.nan
    followers = outlined_followers(
        replace(mixed, data_vars={**mixed.data_vars, "pose": replace(mixed["pose"], values=poses)})
    )
    assert followers is not None
    nearest = nearest_bodies(followers)
    assert np.isnan(nearest[10:, 1]).all()
    assert np.isfinite(np.delete(nearest, 1, axis=1)).all()


def test_the_panels_of_the_paper(result: Result) -> None:
    titles = [panel.title[:3] for panel in paper_panels(result)]
    assert sorted(set(titles)) == ["(c)", "(d)", "(e)", "(f)", "(g)", "(h)"]
    without = replace(result, data_vars={name: one for name, one in result.data_vars.items() if name != "weight_norm"})
    assert "not recorded by this controller" in written(draw(without, "paper"))


def test_a_result_of_an_earlier_version_without_outlines_is_drawn(result: Result) -> None:
    coords = {name: one for name, one in result.coords.items() if not name.startswith(("outline_", "pose_name"))}
    old = replace(result, coords=coords)
    figure = draw(old)
    figure.draw_without_rendering()
    assert "distance to the nearest follower" in written(figure)
    assert "distance to the nearest body" not in written(figure)


# How they are drawn -----------------------------------------------------------------------------------------


def test_a_view_extends_to_limits_that_are_near() -> None:
    courses = np.linspace(0.0, 1.0, 50)[:, np.newaxis]
    panel = Panel("a", "m", np.arange(50.0), courses, signal="a")
    assert view(panel, [Band("a", "", 0, 50, -math.inf, 2.0)])[1] > 2.0
    assert view(panel, [Band("a", "", 0, 50, -math.inf, 20.0)])[1] < 1.5


def _lines(axes: Axes, width: float) -> list[list[np.ndarray]]:
    """Return the lines of each collection of a width."""
    found = [one for one in axes.collections if isinstance(one, LineCollection) and one.get_linewidths()[0] == width]
    return [one.get_segments() for one in found]


@pytest.mark.parametrize(("bound", "seen"), [("0.5 m", True), ("5000 m", False)])
def test_limits_of_expectations_are_drawn(tmp_path: Path, bound: str, seen: bool) -> None:
    text = (SCENARIOS / "clmr_line.xml").read_text()
    head = text[: text.index("<expect>")]
    path = tmp_path / "mine.xml"
    path.write_text(
        f'{head}<expect><peak signal="range_error" below="{bound}" from="1 s" to="2 s"/></expect></scenario>'
    )
    run = Result.of(cosim.run(path, horizon=3.0))
    canvas = draw(run).axes[-1]
    shades = [one for one in canvas.collections if isinstance(one, PolyCollection) and len(one.get_paths())]
    assert len(shades) == 1
    assert tuple(shades[0].get_facecolor()[0][:3]) == pytest.approx(
        tuple(int(GOOD[k : k + 2], 16) / 255 for k in (1, 3, 5))
    )
    limits = [one for one in canvas.collections if isinstance(one, LineCollection) and one.get_linewidths()[0] == 1.0]
    assert any(len(one.get_segments()) == 2 for one in limits) == seen


def test_when_a_run_failed_is_marked(result: Result) -> None:
    failure = '{"robot": "leader", "time": 2.5, "variable": "", "message": "it has $ended$"}'
    failed = replace(result, attrs={**result.attrs, "failure": failure, "status": "incomplete"})
    figure = draw(failed)
    figure.draw_without_rendering()
    assert "it has $ended$" in written(figure).replace("\n", " ")
    dotted = [
        one for one in figure.axes[-1].collections if isinstance(one, LineCollection) and one.get_linewidths()[0] == 1.2
    ]
    assert any(len(one.get_segments()) > 10 for one in dotted)


@pytest.mark.parametrize("followers", [1, 12, 300])
def test_nothing_overlaps_whatever_followers_are_called(mixed: Result, followers: int, tmp_path: Path) -> None:
    """Legend, title and paths keep off each other, and all is within the figure."""
    rows = np.arange(followers) % len(mixed.robots)
    names = np.array([f"follower_with_a_name_that_is_long_{number}$_^$" for number in range(followers)])

    def more(group: Mapping[str, Variable]) -> dict[str, Variable]:
        return {
            name: replace(one, values=one.values.take(rows, axis=one.dims.index("robot")))
            if "robot" in one.dims
            else one
            for name, one in group.items()
            if name.partition("_")[0] not in ("vehicle", "outline", "pose") and "vehicle" not in one.dims
        }

    coords = {**more(mixed.coords), "pose_component": mixed["pose_component"]}
    coords["robot"] = replace(coords["robot"], values=names)
    data_vars = {**more(mixed.data_vars), "pose": replace(mixed["pose"], values=mixed["pose"].values[:, rows])}
    many = Result(data_vars, coords, mixed.attrs)
    figure = draw(many)
    figure.draw_without_rendering()
    boxes = [legend.get_window_extent() for legend in figure.legends]
    boxes += [axes._left_title.get_window_extent() for axes in figure.axes if axes.get_title("left")]
    boxes += [figure.axes[0].get_window_extent(), figure._suptitle.get_window_extent()]  # type: ignore[union-attr]
    whole = figure.bbox
    for number, one in enumerate(boxes):
        assert whole.x0 <= one.x0
        assert one.x1 <= whole.x1
        for other in boxes[:number]:
            assert Bbox.intersection(one, other) is None, (one, other)
    save_figure(many, tmp_path / "many.png")
    assert (tmp_path / "many.png").stat().st_size > 10_000


def test_a_name_from_strangers_stays_within_its_panel(result: Result) -> None:
    long = {f"telemetry_{'that_is_long_' * 20}\x1b$": result["range_error"]}
    figure = draw(replace(result, data_vars={**long, **result.data_vars}))
    figure.draw_without_rendering()
    (text,) = (text for text in figure.axes[-1].texts if text.get_text().startswith("telemetry"))
    assert text.get_text().isprintable()
    assert text.get_window_extent().width < 0.3 * figure.bbox.width


def test_times_of_a_very_long_run_have_their_factor(result: Result) -> None:
    coords = {**result.coords, "time": replace(result["time"], values=result["time"].values * 1e6)}
    assert "time [s] 1e6" in written(draw(replace(result, coords=coords)))


def test_all_panels_share_one_axes(result: Result) -> None:
    """An Axes for each would take more than twice the time."""
    assert len(draw(result).axes) == 3


def test_panels_that_do_not_exist(result: Result, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there are no panels 'most': expected is one of all, paper"):
        save_figure(result, tmp_path / "a.png", "most")  # type: ignore[arg-type]


def test_show_draws_the_panels_of_the_paper(result: Result, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save(result, tmp_path / "result.nc")
    pictures = {}
    for choice in ("all", "paper"):
        main(["show", str(tmp_path / "result.nc"), "--figure", str(tmp_path / f"{choice}.png"), "--panels", choice])
        pictures[choice] = (tmp_path / f"{choice}.png").read_bytes()
    assert pictures["all"] != pictures["paper"]
    assert main(["show", str(tmp_path / "result.nc"), "--panels", "all"]) == 2
    assert "--panels is about the figure: add --figure FILE.png, or leave it out" in capsys.readouterr().err
    assert all(picture.startswith(b"\x89PNG") for picture in pictures.values())
