"""Of many followers those alone are compared that may be nearest; the answer is that of all pairs, to the last bit."""

from itertools import combinations

import numpy as np
import pytest

from cosim.results import metrics
from cosim.results.metrics import Nearest, smallest_distance
from cosim.results.result import Result, Variable


def walking(followers: int, samples: int, seed: int) -> np.ndarray:
    """Return poses of followers that walk at random; some walk alike, so that equal distances occur."""
    random = np.random.default_rng(seed)
    steps = random.standard_normal((samples, followers, 4)) * 0.05
    poses = np.cumsum(steps, axis=0) + 3.0 * random.integers(0, 12, (followers, 4)) + 1e3 * (seed % 2)
    poses[:, 1::7] = poses[:, :1] + np.arange(1, len(range(1, followers, 7)) + 1)[:, np.newaxis]
    return poses


def made_of(poses: np.ndarray) -> Result:
    names = np.array([f"f_{number}" for number in range(poses.shape[1])])
    coords = {"time": Variable(("time",), np.arange(len(poses)) * 0.02), "robot": Variable(("robot",), names)}
    return Result({"pose": Variable(("time", "robot", "pose_component"), poses)}, coords, {})


@pytest.fixture
def compared(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return the numbers of pairs that are compared in each call."""
    found: list[int] = []
    chosen = metrics._pairs

    def counted(position: np.ndarray, wanted: np.ndarray) -> list[tuple[int, int]]:
        pairs = list(chosen(position, wanted))
        found.append(len(pairs))
        return pairs

    monkeypatch.setattr(metrics, "_pairs", counted)
    return found


def by_hand(result: Result, robots: tuple[str, ...] = ()) -> float:
    places = result["pose"].values[..., :2]
    pairs = combinations(range(len(result.robots)), 2)
    wanted = [pair for pair in pairs if not robots or {result.robots[k] for k in pair} & set(robots)]
    return float(min(np.hypot(*(places[:, i] - places[:, j]).T).min() for i, j in wanted))


def of_all_pairs(result: Result, monkeypatch: pytest.MonkeyPatch, robots: tuple[str, ...] = ()) -> Nearest | None:
    with monkeypatch.context() as patch:
        patch.setattr(metrics, "_FEW", 1000)
        return smallest_distance(result, robots)


@pytest.mark.parametrize("seed", range(8))
def test_the_nearest_of_many(seed: int, monkeypatch: pytest.MonkeyPatch, compared: list[int]) -> None:
    result = made_of(walking(60, 130, seed))
    found = smallest_distance(result)
    assert found == of_all_pairs(result, monkeypatch)
    assert found is not None
    assert found.distance == pytest.approx(by_hand(result), rel=1e-12)
    assert compared[0] < 60 * 59 / 4


def test_the_nearest_of_some_may_not_be_near(monkeypatch: pytest.MonkeyPatch) -> None:
    poses = walking(40, 60, 3)
    poses[:, 5, :2] += 500.0
    result = made_of(poses)
    found = smallest_distance(result, ("f_5",))
    assert found is not None
    assert found.distance == pytest.approx(by_hand(result, ("f_5",)), rel=1e-12)
    assert found == of_all_pairs(result, monkeypatch, ("f_5",))


def test_a_place_that_is_no_number(monkeypatch: pytest.MonkeyPatch) -> None:
    poses = walking(30, 40, 1)
    poses[20:, 7] = np.nan
    result = made_of(poses)
    assert repr(smallest_distance(result)) == repr(of_all_pairs(result, monkeypatch))
