"""A first scenario to change: small, runnable, and with a comment on each thing that one may want to change."""

from __future__ import annotations

import math
from dataclasses import dataclass

MAX_FOLLOWERS = 50


@dataclass(frozen=True)
class _Vehicle:
    """What the template says of a kind of vehicle: names for people, angles of the pose, and numbers that go well."""

    title: str
    id: str
    angles: tuple[str, str]
    torque: str
    length: float
    parameter: str
    channel: str


_VEHICLES = {
    "car_like": _Vehicle(
        title="car-like robot",
        id="car",
        angles=("psi", "gamma"),
        torque='tau_drive="8 N.m" tau_steer="0 N.m"',
        length=1.2,
        parameter='<parameter name="drive" value="rear_wheel"/>',
        channel="tau_drive",
    ),
    "tractor_trailer": _Vehicle(
        title="tractor-trailer",
        id="truck",
        angles=("theta_1", "theta_0"),
        torque='tau_right="1 N.m" tau_left="1 N.m"',
        length=1.5,
        parameter='<parameter name="m_1" value="20 kg"/>',
        channel="tau_right",
    ),
}
VEHICLES = tuple(_VEHICLES)

_TEXT = """\
<?xml version="1.0" encoding="UTF-8"?>
<scenario xmlns="{namespace}" name="{name}">

  <title>{title}</title>
  <description>
    A first scenario to change. "formation check {name}.xml" says what is in it, "formation run {name}.xml" runs it and
    writes what came of it to runs/{name}/.
  </description>

  <!-- Poses and torques are exchanged once a step, to the horizon. The same seed gives the same noise, bit for bit. -->
  <simulation horizon="60 s" step="20 ms" seed="1"/>

  <!-- The vehicle: a model of the house ("formation list" names them), or any FMU: fmu="my_robot.fmu" instead of
       model="..." ("formation inspect my_robot.fmu" says what it needs). Every quantity has its unit. -->
  <plant id="{id}" model="{vehicle}">
    {parameter}
  </plant>

  <!-- The control law and the versions of its package that will do. A gain that is left out has its default. -->
  <controller id="pid" name="neural-adaptive-pid" package="formation-controllers" version="~=0.1.0">
    <gain name="K_p" value="40"/>
    <gain name="Lambda_0" value="1"/>
    <gain name="Lambda_1" value="0.05"/>
    <gain name="gamma_w" value="0.1"/>
    <gain name="W_m" value="100"/>
    <gain name="guard" value="0.1"/>
  </controller>

  <!-- What the controllers see of the poses, and what the motors can do. Try <delay time="40 ms"/> in either. -->
  <sensor>
    <noise x="1 mm" y="1 mm" {heading}="1 mrad" {other}="1 mrad"/>
  </sensor>
  <actuator>
    <saturation limit="200 N.m"/>
  </actuator>

  <!-- The leader starts here at rest and is driven by constant torques. -->
  <leader plant="{id}">
    <pose x="0 m" y="0 m" {heading}="0 deg" {other}="0 deg"/>
    <torque {torque}/>
  </leader>

  <!-- Each follower starts at its pose and is to see the leader at this range and bearing: at a bearing of 30 deg the
       leader is ahead of it to the left. -->
{followers}
  <!-- What must hold: "formation run" ends with exit status 1 where it does not, so that this file is a test. -->
  <expect>
    <settled by="50 s" range="0.1 m" bearing="2 deg"/>
    <peak signal="torque" component="{channel}" below="200 N.m"/>
{distance}    <regular/>
  </expect>

</scenario>
"""

_FOLLOWER = """\
  <follower id="follower_{number}" plant="{id}" controller="pid">
    <pose x="{x:g} m" y="{y:g} m" {heading}="0 deg" {other}="0 deg"/>
    <desired range="{range:g} m" bearing="{bearing:g} deg"/>
  </follower>
"""


def scenario_text(name: str, vehicle: str, followers: int) -> str:
    """Return a scenario in which followers keep a wedge behind a leader, with comments.

    Parameters
    ----------
    name
        The scenario's name, which is its file's as well.
    vehicle
        One of `VEHICLES`.
    followers
        How many, from 1 to `MAX_FOLLOWERS`.
    """
    from cosim.scenario.grammar import NAMESPACE  # a library of XML, which the command line's parser does not need

    kind = _VEHICLES[vehicle]
    words = {"heading": kind.angles[0], "other": kind.angles[1], "id": kind.id}
    places = [_place(number, kind.length) for number in range(1, followers + 1)]
    return _TEXT.format(
        namespace=NAMESPACE,
        name=name,
        title=f"{followers} {kind.title}{'s' * (followers > 1)} behind a leader",
        vehicle=vehicle,
        parameter=kind.parameter,
        torque=kind.torque,
        channel=kind.channel,
        followers="\n".join(_FOLLOWER.format(number=n, **place, **words) for n, place in enumerate(places, start=1)),
        distance='    <distance above="1 m"/>\n' if followers > 1 else "",
        **words,
    )


def _place(number: int, length: float) -> dict[str, float]:
    """Return the place of a follower in the wedge, right and left in turn, and a pose a metre or so behind it."""
    rank, side = (number + 1) // 2, -1 if number % 2 else 1
    distance, bearing = 3.0 * rank, -30.0 * side
    x, y = -distance * math.cos(math.radians(bearing)) - length, -distance * math.sin(math.radians(bearing))
    return {"x": round(x - 1.0, 1), "y": round(y + 0.5 * side, 1), "range": distance, "bearing": bearing}
