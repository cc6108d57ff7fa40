"""A first scenario to change: small, runnable, and with a comment on each thing that one may want to change."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from cosim.vehicle.kind import Example, Kind
from cosim.vehicle.kinds import kind_named, kinds

MAX_FOLLOWERS = 50


_TEXT = """\
<?xml version="1.0" encoding="UTF-8"?>
<scenario xmlns="{namespace}" name="{name}">

  <title>{title}</title>
  <description>
    A first scenario to change. "formation check {name}.xml" shows its content, "formation run {name}.xml" runs it and
    writes the result to runs/{name}/.
  </description>

  <!-- {exchanged} are exchanged once a step, to the horizon. The same seed gives the same noise, bit for bit. -->
  <simulation horizon="60 s" step="20 ms" seed="1"/>

  <!-- The vehicle: a built-in model ("formation list" names them), or any FMU: fmu="my_robot.fmu" instead of
       model="..." ("formation inspect my_robot.fmu" shows the roles that it needs). Every quantity has its unit. -->
  <plant id="{id}" {plant}>
    {parameter}
  </plant>

  <!-- The control law, its package and the accepted versions. A gain that is left out has its default. -->
  <controller id="{law}" name="{controller}" package="{package}" version="{version}">
{gains}
  </controller>

  <!-- Noise of the sensors and limits of the motors. Try <delay time="40 ms"/> in either. -->
  <sensor>
    <noise {noise}/>
  </sensor>
{actuator}
  <!-- The leader starts here at rest and is driven by constant {commands}s. -->
  <leader plant="{id}">
    <pose {start}/>
    <{commands} {leader}/>
  </leader>

  <!-- Each follower starts at its pose and shall see the leader at this range and bearing: at a bearing of 30 deg the
       leader is ahead of it to the left. -->
{followers}
  <!-- Expectations: if one fails, "formation run" ends with exit status 1, so that this file is a test. -->
  <expect>
    <settled by="50 s" range="0.1 m" bearing="2 deg"/>
{peak}{distance}    <regular/>
  </expect>

</scenario>
"""

_FOLLOWER = """\
  <follower id="follower_{number}" plant="{id}" controller="{law}">
    <pose {pose}/>
    <desired range="{range:g} m" bearing="{bearing:g} deg"/>
  </follower>
"""


def kinds_with_example() -> Iterator[str]:
    """Yield the kinds of vehicle that offer a first scenario."""
    yield from (kind.name for kind in kinds() if kind.example is not None)


def scenario_text(name: str, vehicle: str, followers: int) -> str:
    """Return a scenario in which followers keep a wedge behind a leader, with comments.

    Parameters
    ----------
    name
        The name of the scenario and of its file.
    vehicle
        The name of a kind of vehicle that has an example.
    followers
        How many, from 1 to `MAX_FOLLOWERS`.
    """
    from cosim.scenario.grammar import NAMESPACE  # a library of XML, which the command line's parser does not need

    kind = kind_named(vehicle)
    example = kind.example
    assert example is not None
    limit = f'limit="{example.limit}"' if example.limit else ""
    commands = kind.command_word
    return _TEXT.format(
        namespace=NAMESPACE,
        name=name,
        title=f"{followers} {kind.title}{'s' * (followers > 1)} behind a leader",
        id=example.plant,
        plant=example.source or f'model="{vehicle}"',
        parameter=f'<parameter name="{example.parameter[0]}" value="{example.parameter[1]}"/>',
        law=example.law.id,
        controller=example.law.name,
        package=example.law.package,
        version=example.law.version,
        gains="\n".join(f'    <gain name="{gain}" value="{value}"/>' for gain, value in example.law.gains.items()),
        noise=_attributes({role.name: _SMALL[role.unit] for role in kind.pose}),
        actuator=f"  <actuator>\n    <saturation {limit}/>\n  </actuator>\n" if limit else "",
        commands=commands,
        exchanged=f"Poses and {commands}s",
        start=_attributes(_pose(kind, 0.0, 0.0)),
        leader=_attributes(example.leader),
        followers="\n".join(_follower(number, kind, example) for number in range(1, followers + 1)),
        peak=f'    <peak signal="torque" component="{example.limited}" below="{example.limit}"/>\n' if limit else "",
        distance='    <distance above="1 m"/>\n' if followers > 1 else "",
    )


_SMALL = {"m": "1 mm", "rad": "1 mrad"}
_ZERO = {"m": "0 m", "rad": "0 deg"}


def _attributes(values: Mapping[str, str]) -> str:
    return " ".join(f'{name}="{value}"' for name, value in values.items())


def _pose(kind: Kind, x: float, y: float) -> dict[str, str]:
    x_role, y_role, *rest = kind.pose
    angles = {role.name: _ZERO[role.unit] for role in rest}
    return {x_role.name: f"{x:g} m", y_role.name: f"{y:g} m"} | angles


def _follower(number: int, kind: Kind, example: Example) -> str:
    place = _place(number, example.length)
    return _FOLLOWER.format(
        number=number,
        id=example.plant,
        law=example.law.id,
        pose=_attributes(_pose(kind, place["x"], place["y"])),
        range=place["range"],
        bearing=place["bearing"],
    )


def _place(number: int, length: float) -> dict[str, float]:
    """Return the place of a follower in the wedge, right and left in turn, and a pose a metre or so behind it."""
    rank, side = (number + 1) // 2, -1 if number % 2 else 1
    distance, bearing = 3.0 * rank, -30.0 * side
    x, y = -distance * math.cos(math.radians(bearing)) - length, -distance * math.sin(math.radians(bearing))
    return {"x": round(x - 1.0, 1), "y": round(y + 0.5 * side, 1), "range": distance, "bearing": bearing}
