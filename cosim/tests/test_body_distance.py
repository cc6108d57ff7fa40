"""The distance of bodies, in results made by hand and against a search over all samples and pairs."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import formation_controllers as fc
import numpy as np
import pytest

from cosim.cli import main
from cosim.errors import InputError, Location
from cosim.master.robots import outline_of
from cosim.results.body_distance import smallest_body_distance
from cosim.results.convex import distances, gaps
from cosim.results.expectations import judge
from cosim.results.metrics import smallest_distance
from cosim.results.outlines import coordinates_of
from cosim.results.result import Result, Variable
from cosim.results.verdict import Verdict
from cosim.scenario.scenario import Expectation
from cosim.vehicle import kinds
from cosim.vehicle.car_like import CAR_LIKE
from cosim.vehicle.differential_drive import DIFFERENTIAL_DRIVE
from cosim.vehicle.kind import Kind, names
from cosim.vehicle.outline import placed
from cosim.vehicle.tractor_trailer import TRACTOR_TRAILER

CAR, TRUCK, ROBOT = fc.CarLike(1.2), fc.TractorTrailer(1.5, 0.15, 0.4), fc.DifferentialDrive(0.1, 0.25)
KINDS: dict[Any, Kind] = {CAR: CAR_LIKE, TRUCK: TRACTOR_TRAILER, ROBOT: DIFFERENTIAL_DRIVE}


def result_of(robots: dict[str, tuple[Any, np.ndarray]], step: float = 0.02) -> Result:
    """Return a result of some followers: vehicle and poses (T, entries)."""
    samples = max(len(poses) for _, poses in robots.values())
    pose = np.full((samples, len(robots), 4), np.nan)
    entries = [[""] * 4 for _ in robots]
    for row, (vehicle, poses) in enumerate(robots.values()):
        known = names(KINDS[vehicle].pose)
        pose[:, row, : len(known)] = poses
        entries[row][: len(known)] = known
    outlines = {name: KINDS[vehicle].outline(vehicle) for name, (vehicle, _) in robots.items()}  # type: ignore[misc]
    return Result(
        {"pose": Variable(("time", "robot", "pose_component"), pose)},
        {
            "time": Variable(("time",), np.arange(samples) * step),
            "robot": Variable(("robot",), np.array(list(robots))),
            "vehicle": Variable(("vehicle",), np.array(list(robots))),
            "pose_name": Variable(("vehicle", "pose_component"), np.array(entries)),
            **coordinates_of(outlines),
        },
        {},
    )


def judged(result: Result, above: str, stop: float = 100.0, **attributes: str) -> Verdict:
    written = Expectation("distance", {"above": above, **attributes}, Location("s.xml", 3, 5), Path(), 0.0, stop, ())
    (verdict,) = judge((written,), result, run_other=None)
    return verdict


def standing(*pose: float, samples: int = 5) -> np.ndarray:
    return np.tile(np.array(pose), (samples, 1))


def meeting() -> Result:
    """Return two cars whose rear axles keep 1.05 m while their wheelbases pass each other at 0.02 m, side by side."""
    other = standing(0.0, 0.02, math.pi, 0.0)
    other[:, 0] = [3.5, 2.5, 1.05, 2.5, 3.5]
    return result_of({"a": (CAR, standing(0.0, 0.0, 0.0, 0.0)), "b": (CAR, other)})


# Verdicts --------------------------------------------------------------------------------------------------------


def test_reference_points_keep_their_distance_while_bodies_pass_through_each_other() -> None:
    for of in ({}, {"of": "reference_points"}):
        points = judged(meeting(), "1 m", **of)
        assert points.passed
        assert points.figure == math.hypot(1.05, 0.02)
        assert points.detail == "a and b at t = 0.04 s"
        assert points.expectation == "distance between followers above 1 m, 0 to 100 s"
    bodies = judged(meeting(), "1 cm", of="bodies")
    assert not bodies.passed
    assert (bodies.figure, bodies.margin, bodies.unit) == (0.0, -1.0, "cm")
    assert bodies.detail == "a and b overlap first at t = 0.02 s"
    assert bodies.expectation == "distance between bodies of followers above 1 cm, 0 to 100 s"


def test_a_bound_of_zero_is_that_bodies_do_not_touch() -> None:
    assert not judged(meeting(), "0 m", of="bodies").passed
    before = judged(meeting(), "0 m", of="bodies", stop=0.01)
    assert before.passed
    assert before.figure == pytest.approx(3.5 - 2 * 1.44)


def test_a_file_without_outlines_has_no_figure_and_does_not_hold() -> None:
    result = meeting()
    coords = {name: one for name, one in result.coords.items() if not name.startswith("outline")}
    older = replace(result, coords=coords)
    verdict = judged(older, "1 cm", of="bodies")
    assert not verdict.passed
    assert verdict.finding == "no figure (the result does not hold the outline of every follower)"
    assert smallest_body_distance(older) is None


# Figures ---------------------------------------------------------------------------------------------------------


def test_a_distance_by_hand() -> None:
    """A robot behind a car, square to its rear: half a length behind its own middle each."""
    found = smallest_body_distance(
        result_of({"a": (CAR, standing(0.0, 0.0, 0.0, 0.3)), "b": (ROBOT, standing(-2.0, 0.1, 0.0))})
    )
    assert found is not None
    assert found.distance == pytest.approx(2.0 - 0.24 - 0.3)
    assert (found.between, found.time) == (("a", "b"), 0.0)


def test_bodies_of_one_robot_do_not_count_against_each_other() -> None:
    """Both jack-knife, so that each tractor is in its own trailer; the second tractor comes near the first trailer."""
    first, second = standing(0.0, 0.0, 0.0, 3.0), standing(5.0, 0.0, math.pi, 0.2)
    assert smallest_body_distance(result_of({"a": (TRUCK, first)})) is None
    found = smallest_body_distance(result_of({"a": (TRUCK, first), "b": (TRUCK, second)}))
    assert found is not None
    assert 0.5 < found.distance < 2.0


def test_only_pairs_that_a_named_robot_belongs_to() -> None:
    result = result_of({name: (ROBOT, standing(x, 0.0, 0.0)) for name, x in (("a", 0.0), ("b", 1.0), ("c", 5.0))})
    for robots, distance, between in (((), 0.4, ("a", "b")), (("c",), 3.4, ("b", "c")), (("a", "c"), 0.4, ("a", "b"))):
        found = smallest_body_distance(result, robots)
        assert found is not None
        assert (found.distance, found.between) == (pytest.approx(distance), between)
    assert smallest_body_distance(result_of({"a": (ROBOT, standing(0.0, 0.0, 0.0))})) is None
    assert smallest_body_distance(result.between(50.0, 60.0)) is None


@pytest.mark.parametrize(("entry", "wrong"), [(0, math.nan), (1, math.inf), (0, 1e200), (2, math.nan), (2, -math.inf)])
def test_a_pose_that_is_no_number_has_no_distance(entry: int, wrong: float) -> None:
    poses = standing(5.0, 0.0, 0.0)
    poses[3, entry] = wrong
    result = result_of(
        {"a": (ROBOT, standing(0.0, 0.0, 0.0)), "b": (ROBOT, standing(1.0, 0.0, 0.0)), "c": (ROBOT, poses)}
    )
    found = smallest_body_distance(result)
    assert found is not None
    assert math.isnan(found.distance)
    assert (found.between, found.time) == (("a", "c"), pytest.approx(0.06))
    assert not judged(result, "1 mm", of="bodies").passed
    assert judged(result, "1 mm", of="bodies", stop=0.04).passed


def searched(result: Result, vehicles: dict[str, Any]) -> tuple[float, tuple[str, str], int]:
    """Return the smallest distance by the exact one of all bodies at all samples."""
    bodies = {}
    for row, (name, vehicle) in enumerate(vehicles.items()):
        kind = KINDS[vehicle]
        outline = kind.outline(vehicle)  # type: ignore[misc]
        pose = {entry: result["pose"].values[:, row, k] for k, entry in enumerate(names(kind.pose))}
        corners = zip(outline, placed(outline, pose), strict=True)
        bodies[name] = [points.transpose(2, 1, 0) for part, points in corners if part.collides]
    best = (math.inf, ("", ""), 0)
    for one, other in combinations(vehicles, 2):
        pairs = [(a, b) for a in bodies[one] for b in bodies[other]]
        found = np.min([np.where(gaps(a, b) < 0, 0.0, distances(a, b)) for a, b in pairs], axis=0)
        best = min(best, (float(found.min()), (one, other), int(found.argmin())), key=lambda far: (far[0], far[2]))
    return best


@pytest.mark.parametrize("seed", range(12))
def test_the_search_leaves_nothing_out(seed: int) -> None:
    """Random teams on random paths, in few blocks of samples and in many; the first of several overlaps counts."""
    rng = np.random.default_rng(seed)
    size, samples = int(rng.integers(2, 25)), int(rng.integers(1, 300))
    vehicles = {f"robot_{i}": list(KINDS)[k] for i, k in enumerate(rng.integers(0, 3, size))}
    starts = rng.normal(size=(size, 4)) * [3 * size, 3 * size, 2, 2] + (1e5 if seed % 3 == 0 else 0.0)
    steps = rng.normal(size=(samples, size, 4)) * [0.1, 0.1, 0.05, 0.05]
    poses = starts + np.cumsum(steps, axis=0)
    result = result_of({name: (v, poses[:, i, : len(KINDS[v].pose)]) for i, (name, v) in enumerate(vehicles.items())})
    distance, between, sample = searched(result, vehicles)
    found = smallest_body_distance(result)
    assert found is not None
    assert found.distance == pytest.approx(distance, abs=1e-9)
    assert (found.between, found.time) == (between, pytest.approx(sample * 0.02))


def test_points_and_bodies_may_be_nearest_in_different_pairs() -> None:
    """Beside each other, reference points are near; behind each other, bodies are."""
    result = result_of(
        {
            "a": (CAR, standing(0.0, 0.0, 0.0, 0.0)),
            "b": (CAR, standing(0.0, 1.6, 0.0, 0.0)),
            "c": (CAR, standing(1.9, 0.0, 0.0, 0.0)),
        }
    )
    points, bodies = smallest_distance(result), smallest_body_distance(result)
    assert points is not None
    assert bodies is not None
    assert (points.distance, points.between) == (1.6, ("a", "b"))
    assert (bodies.distance, bodies.between) == (pytest.approx(1.9 - 1.68), ("a", "c"))


# Runs ------------------------------------------------------------------------------------------------------------

EXAMPLE = Path(__file__).with_name("example.xml")


@pytest.fixture
def scenario(tmp_path: Path) -> Callable[[str], Path]:
    def written(expectation: str) -> Path:
        text = EXAMPLE.read_text(encoding="utf-8").replace('horizon="100 s"', 'horizon="0.2 s"')
        path = tmp_path / "one.xml"
        path.write_text(text.replace("</scenario>", f"<expect>\n{expectation}\n</expect></scenario>"), encoding="utf-8")
        return path

    return written


def test_terminal_summary_and_shown_result_name_both_distances(
    scenario: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = scenario('<distance of="bodies" above="90 m" fails="they are not that far apart"/>')
    assert main(["run", str(path), "--out", str(tmp_path), "--no-figure"]) == 1
    run = capsys.readouterr().out
    told = json.loads((tmp_path / "example" / "summary.json").read_text())
    points, bodies = told["smallest_distance"], told["smallest_distance_of_bodies"]
    assert 0 < bodies < points
    between = [", ".join(told[f"smallest_distance{of}_between"]) for of in ("", "_of_bodies")]
    line = (
        f"smallest distance between followers: reference points {points:.3f} m ({between[0]}), "
        f"bodies {bodies:.3f} m ({between[1]})"
    )
    assert line in run
    assert "fails as known: they are not that far apart  distance between bodies of followers above 90 m" in run
    assert told["verdicts"][0]["figure"] == bodies
    assert main(["show", str(tmp_path / "example")]) == 1
    assert line in capsys.readouterr().out


@pytest.mark.parametrize("command", ["check", "run"])
def test_a_kind_without_an_outline_is_refused_before_the_run(
    scenario: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    monkeypatch.setattr(kinds, "BUILT_IN", (replace(CAR_LIKE, outline=None), *kinds.BUILT_IN[1:]))
    path = scenario('<distance of="bodies" above="0 m"/>')
    assert main([command, str(path)]) == 2
    message = " ".join(capsys.readouterr().err.split())
    assert f"{path.name}:" in message
    assert "follower_1 has none, as the kind of vehicle 'car_like' states none: state one in the kind, or" in message


def test_robots_without_an_outline_run_and_have_no_distance_of_bodies(
    scenario: Callable[[str], Path],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(kinds, "BUILT_IN", (replace(CAR_LIKE, outline=None), *kinds.BUILT_IN[1:]))
    path = scenario('<distance above="1 cm"/>')
    assert main(["run", str(path), "--out", str(tmp_path), "--no-figure"]) == 0
    assert "bodies" not in capsys.readouterr().out
    assert json.loads((tmp_path / "example" / "summary.json").read_text())["smallest_distance_of_bodies"] is None


@pytest.mark.parametrize("of", ["body", "reference points"])
def test_a_wrong_word_is_told_the_right_ones(
    scenario: Callable[[str], Path], capsys: pytest.CaptureFixture[str], of: str
) -> None:
    assert main(["check", str(scenario(f'<distance of="{of}" above="1 m"/>'))]) == 2
    message = " ".join(capsys.readouterr().err.split())
    assert f'of="{of}" of <distance> is not reference_points or bodies' in message


@pytest.mark.parametrize(
    ("outline", "fault"),
    [
        (lambda car: (), "is (): expected is a tuple of cosim.vehicle.outline.Part"),
        (lambda car: car.length, "cannot be computed: AttributeError: 'CarLike' object has no attribute 'length'"),
    ],
)
def test_a_faulty_outline_of_another_package_is_told(outline: Callable[[Any], Any], fault: str) -> None:
    with pytest.raises(InputError) as caught:
        outline_of(replace(CAR_LIKE, outline=outline), CAR, "a", Location("s.xml", 3, 5))
    assert caught.value.message == f"a: the outline of the kind of vehicle 'car_like' {fault}"
    assert outline_of(replace(CAR_LIKE, outline=None), CAR, "a", Location("s.xml", 3, 5)) is None
