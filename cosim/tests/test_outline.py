"""Outlines of vehicles: where their parts are, and what an outline must not be."""

import math
from dataclasses import replace
from typing import Any

import formation_controllers as fc
import numpy as np
import pytest

from cosim.vehicle.car_like import CAR_LIKE
from cosim.vehicle.differential_drive import DIFFERENTIAL_DRIVE
from cosim.vehicle.kind import Kind, names
from cosim.vehicle.outline import Part, box, frames, outline_fault, placed
from cosim.vehicle.tractor_trailer import TRACTOR_TRAILER

CAR, TRUCK, ROBOT = fc.CarLike(1.5), fc.TractorTrailer(2.0, 0.15, 0.5), fc.DifferentialDrive(0.1, 0.5)
VEHICLES: list[tuple[Kind, Any]] = [(CAR_LIKE, CAR), (TRACTOR_TRAILER, TRUCK), (DIFFERENTIAL_DRIVE, ROBOT)]


def drawn(kind: Kind, vehicle: Any, *pose: float) -> dict[str, np.ndarray]:
    """Return the corners of each part, as complex numbers (n,)."""
    assert kind.outline is not None
    outline = kind.outline(vehicle)
    entries = {name: np.array(value) for name, value in zip(names(kind.pose), pose, strict=True)}
    corners = zip(outline, placed(outline, entries), strict=True)
    return {part.name: points[:, 0] + 1j * points[:, 1] for part, points in corners}


@pytest.mark.parametrize(("kind", "vehicle"), VEHICLES)
def test_the_outline_of_each_kind_is_sound_and_wheels_do_not_collide(kind: Kind, vehicle: Any) -> None:
    assert kind.outline is not None
    outline = kind.outline(vehicle)
    assert outline_fault(outline, names(kind.pose)) == ""
    assert [part.collides for part in outline] == ["wheel" not in part.name for part in outline]


def test_a_car() -> None:
    """Heading along Y, steered by 30 degrees to the left: body and front wheels."""
    parts = drawn(CAR_LIKE, CAR, 2.0, 3.0, math.pi / 2, math.radians(30))
    body = parts["body"]
    assert (body.real.min(), body.real.max()) == pytest.approx((2 - 0.3 * 1.5, 2 + 0.3 * 1.5))
    assert (body.imag.min(), body.imag.max()) == pytest.approx((3 - 0.2 * 1.5, 3 + 1.2 * 1.5))
    assert parts["rear left wheel"].mean() == pytest.approx(2 - 0.25 * 1.5 + 3j)
    wheel = parts["front right wheel"]
    assert wheel.mean() == pytest.approx(2 + 0.25 * 1.5 + 4.5j)
    assert np.angle(wheel[1] - wheel[0]) == pytest.approx(math.radians(120))


def test_a_tractor_with_a_trailer() -> None:
    """The trailer heads along X, the tractor is turned to the left about the hitch."""
    parts = drawn(TRACTOR_TRAILER, TRUCK, 1.0, -1.0, 0.0, math.pi / 2)
    hitch = 3 - 1j
    trailer, tractor = parts["trailer"], parts["tractor"]
    assert trailer[trailer.real.argmax()] == pytest.approx(hitch)
    assert trailer.real.min() == pytest.approx(1 - 0.6)
    assert np.ptp(trailer.imag) == np.ptp(tractor.real) == pytest.approx(1.2)
    assert (tractor.imag.min(), tractor.imag.max()) == pytest.approx((-1 - 0.6, -1 + 0.6))
    wheels = [parts[f"tractor's {side} wheel"].mean() for side in ("left", "right")]
    assert wheels == pytest.approx([hitch - 0.5, hitch + 0.5])
    assert parts["trailer's left wheel"].mean() == pytest.approx(1 - 0.5j)


def test_a_differential_drive_robot_shows_where_ahead_is() -> None:
    body = drawn(DIFFERENTIAL_DRIVE, ROBOT, 0.0, 0.0, 0.0)["body"]
    assert (body.real.min(), body.real.max()) == pytest.approx((-0.6, 0.6))
    ahead, behind = body[body.real > 0.59], body[body.real < -0.59]
    assert (np.ptp(ahead.imag), np.ptp(behind.imag)) == pytest.approx((0.6, 1.2))
    large = drawn(DIFFERENTIAL_DRIVE, fc.DifferentialDrive(2.0, 0.5), 0.0, 0.0, 0.0)
    assert np.ptp(large["body"].real) == np.ptp(large["left wheel"].real) == pytest.approx(4.0)


def test_many_poses_at_once() -> None:
    rng = np.random.default_rng(1)
    poses = dict(zip(names(TRACTOR_TRAILER.pose), rng.normal(size=(4, 3, 5)), strict=True))
    assert TRACTOR_TRAILER.outline is not None
    outline = TRACTOR_TRAILER.outline(TRUCK)
    found = placed(outline, poses)
    one = drawn(TRACTOR_TRAILER, TRUCK, *(values[2, 3] for values in poses.values()))
    for part, corners in zip(outline, found, strict=True):
        assert corners.shape == (3, 5, len(part.corners), 2)
        np.testing.assert_array_equal(corners[2, 3], np.stack([one[part.name].real, one[part.name].imag], axis=-1))
    assert [frame.heading.shape for frame in frames(outline, poses)] == [(3, 5)] * len(outline)


HULL = Part("hull", box(-1.0, 1.0, 0.5), ("psi",))


@pytest.mark.parametrize(
    ("outline", "fault"),
    [
        ([HULL], "is [Part("),
        ((), "is (): expected is a tuple of cosim.vehicle.outline.Part"),
        ((replace(HULL, collides=False),), "has no part that collides: expected is one at least"),
        ((HULL, HULL), "has the part 'hull', whose name is empty or another's"),
        (
            (replace(HULL, on="bow"),),
            "has the part 'hull', which is on 'bow': expected is the name of a part before it",
        ),
        ((replace(HULL, at=(1.0, 0.0)),), "which is on no other part but at (1.0, 0.0): expected is (0, 0)"),
        (
            (replace(HULL, turned_by=("phi",)),),
            "which is turned by 'phi': expected is an angle of the pose, one of psi, gamma",
        ),
        ((replace(HULL, turned_by=("x",)),), "which is turned by 'x'"),
        (
            (replace(HULL, corners=((0.0, 0.0), (1.0, 0.0), (math.nan, 1.0))),),
            "a coordinate that is not a finite number",
        ),
        *(
            ((replace(HULL, corners=corners),), "whose corners are not those of a convex polygon, counter-clockwise")
            for corners in (
                HULL.corners[::-1],
                HULL.corners[:2],
                ((0.0, 0.0), (2.0, 0.0), (1.0, 0.5), (1.0, 2.0)),
                ((0.0, 0.0), (1.0, 0.0), (2.0, 0.0)),
                tuple((math.cos(k * 0.8 * math.pi), math.sin(k * 0.8 * math.pi)) for k in range(5)),  # a star
            )
        ),
    ],
)
def test_faults_of_an_outline(outline: Any, fault: str) -> None:
    assert fault in outline_fault(outline, names(CAR_LIKE.pose))


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_corners_in_a_line_are_none(scale: float) -> None:
    corners = tuple((x * scale, y * scale) for x, y in ((0.0, 0.0), (0.1, 0.0), (0.3, 0.0), (0.3, 0.7)))
    assert outline_fault((replace(HULL, corners=corners),), names(CAR_LIKE.pose)) == ""
