"""Names are taken apart as people read them, and a role is known by its words."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.swap.naming import doubtful, without_start, words_of
from cosim.vehicle.kinds import BUILT_IN, kind_named


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("x", "x"),
        ("vehicle.pose.x", "vehicle pose x"),
        ("Chassis.rearAxle.x", "chassis rear axle x"),
        ("PosX", "pos x"),
        ("px", "p x"),
        ("ypos", "y pos"),
        ("theta_1", "theta 1"),
        ("heading0", "heading 0"),
        ("steerAngle", "steer angle"),
        ("steerangle", "steer angle"),
        ("steeringrate", "steering rate"),
        ("IMUYaw", "imu yaw"),
        ("M_drive", "m drive"),
        ("delta_dot", "delta dot"),
        ("'odd name'.v-x", "odd name v x"),
        ("wheelbase", "wheelbase"),
        ("ψ", "ψ"),
        ("...", ""),
    ],
)
def test_words(name: str, words: str) -> None:
    assert " ".join(words_of(name)) == words


@given(st.text())
def test_any_name_has_words_in_lower_case_and_no_others(name: str) -> None:
    for word in words_of(name):
        assert word == word.lower()
        assert word


@pytest.mark.parametrize(
    ("name", "rest"),
    [
        ("x0", "x"),
        ("x_init", "x"),
        ("start_x", "x"),
        ("vehicle.initial.heading", "vehicle heading"),
        ("theta_1_0", "theta 1"),
        ("theta_1_init", "theta 1"),
        ("x", None),
        ("init", None),
        ("x0_offset", None),
    ],
)
def test_what_gives_an_initial_value(name: str, rest: str | None) -> None:
    assert without_start(words_of(name)) == (None if rest is None else tuple(rest.split()))


@pytest.mark.parametrize(
    ("vehicle", "role", "names"),
    [
        ("car_like", "x", "X pos_x vehicle.pose.x Chassis.rearAxle.x px x_pos"),
        ("car_like", "psi", "heading yaw vehicle.yawAngle theta Orientation"),
        ("car_like", "gamma", "steer delta steering_angle vehicle.steering.angle frontSteerAngle"),
        ("car_like", "v", "speed forward_velocity longitudinalVelocity Chassis.speed u v_vehicle"),
        ("car_like", "omega", "steer_rate Steering.rate delta_dot steeringVelocity gammadot"),
        ("car_like", "tau_drive", "drive_torque M_drive Driveline.torque tau_drive_cmd motorTorque propulsion"),
        ("car_like", "tau_steer", "steer_torque M_steer SteeringTorque T_delta steering"),
        ("car_like", "a", "L wheelbase wheel_base WheelBase vehicle.geometry.wheelbase axle_distance"),
        ("tractor_trailer", "theta_1", "trailer_heading trailer.yaw psi_trailer"),
        ("tractor_trailer", "theta_0", "tractor_heading truck.yaw yaw"),
        ("tractor_trailer", "omega", "yaw_rate tractor.omega"),
        ("tractor_trailer", "tau_right", "right_torque T_r wheelTorqueRight"),
        ("tractor_trailer", "tau_left", "left_torque T_l"),
        ("tractor_trailer", "d", "hitch_length drawbarLength trailer.length"),
        ("tractor_trailer", "r", "wheel_radius Radius"),
        ("tractor_trailer", "b", "half_track halfTrack"),
    ],
)
def test_a_role_is_known_by_its_words(vehicle: str, role: str, names: str) -> None:
    for name in names.split():
        assert kind_named(vehicle).recognised.by_role[role].rank(words_of(name), has_unit=True) is not None, name
        others = {
            other
            for other in kind_named(vehicle).recognised.by_role
            if other != role and role[:3] == other[:3] == "tau"
        }
        for other in others:
            assert kind_named(vehicle).recognised.by_role[other].rank(words_of(name), has_unit=True) is None, (
                name,
                other,
            )


@pytest.mark.parametrize(
    ("vehicle", "role", "names"),
    [
        ("car_like", "x", "vx v.x ax x_target max_x F_x front.x x_dot y com_x"),
        ("car_like", "psi", "yaw_rate heading_ref psi_dot heading0_error steering_angle yaw_moment"),
        ("car_like", "gamma", "steering_rate steer_torque delta_max steering_ratio gamma_ref"),
        ("car_like", "v", "vy yaw_velocity wheel_speed steer_speed v_max lateral_velocity motorSpeed"),
        ("car_like", "omega", "yaw_rate omega_wheel steering_angle"),
        ("car_like", "tau_drive", "tau_d_x steer_torque brake_torque tau_d_drive left_drive_torque"),
        ("car_like", "tau_steer", "tau_d_gamma steering_angle drive_torque"),
        ("car_like", "a", "acceleration track_width L_front"),
        ("tractor_trailer", "theta_1", "tractor_heading heading hitch_angle"),
        ("tractor_trailer", "theta_0", "trailer_heading"),
        ("tractor_trailer", "b", "track track_width"),
    ],
)
def test_other_quantities_are_not_taken_for_it(vehicle: str, role: str, names: str) -> None:
    for name in names.split():
        assert kind_named(vehicle).recognised.by_role[role].rank(words_of(name), has_unit=True) is None, name


def test_a_clue_that_tells_little_needs_a_unit() -> None:
    steer = kind_named("car_like").recognised.by_role["tau_steer"]
    assert steer.rank(("steering",), has_unit=True) is not None
    assert steer.rank(("steering",), has_unit=False) is None


def test_what_explains_more_words_ranks_better() -> None:
    x = kind_named("car_like").recognised.by_role["x"]
    assert x.rank(words_of("vehicle.x"), has_unit=True) < x.rank(words_of("vehicle.battery.x"), has_unit=True)


def test_roles_in_an_array() -> None:
    pose, state, _, position, _, torque = kind_named("car_like").series
    assert [series.telling for series in (pose, state, position, torque)] == [True, False, True, False]
    assert [pose.role(("vehicle", "pose"), 4, i) for i in range(4)] == ["x", "y", "psi", "gamma"]
    assert [position.role(("position",), 3, i) for i in range(3)] == ["x", "y", None]
    assert torque.role(("torque",), 2, 1) == "tau_steer"
    assert pose.role(("pose",), 6, 0) is None
    assert pose.role(("camera", "pose"), 4, 0) is None


@pytest.mark.parametrize(
    ("role", "description", "expected"),
    [
        ("psi", "Clockwise from north", True),
        ("psi", "Heading, counter-clockwise from east", False),
        ("psi", "Heading (anticlockwise)", False),
        ("gamma", "Positive to the right", True),
        ("gamma", "Steering angle of the front wheels, counter-clockwise", False),
        ("x", "North, east", True),
        ("x", "Position of the rear axle, east", False),
        ("tau_right", "Torque of the right wheel", False),
        ("psi", "Kurs im Uhrzeigersinn von Nord", True),
        ("psi", "Kurs gegen den Uhrzeigersinn", False),
        ("gamma", "Lenkwinkel, positiv nach rechts", True),
        ("y", "Mitte der Hinterachse, Osten", True),
    ],
)
def test_a_description_can_raise_a_doubt(role: str, description: str, expected: bool) -> None:
    (kind, *_) = (kind for kind in BUILT_IN if role in {known.name for known in kind.roles})
    assert doubtful(role, kind, description) == expected


def test_every_role_but_disturbances_and_items_can_be_recognised() -> None:
    for kind in BUILT_IN:
        wanted = {role.name for role in kind.roles if role.unit and role not in kind.disturbance}
        assert set(kind.recognised.by_role) == wanted
