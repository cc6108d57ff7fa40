"""The text of a scenario of two followers, behind the leader on either side, to which a test adds its own."""

from cosim.scenario.grammar import NAMESPACE

AT_ORIGIN = 'x="0 m" y="0 m" psi="0 deg" gamma="0 deg"'
ON_THE_RIGHT = 'x="-5 m" y="-2 m" psi="0 deg" gamma="0 deg"'
ON_THE_LEFT = 'x="-5 m" y="2 m" psi="0 deg" gamma="0 deg"'


def two_followers(
    plants: str = '<plant id="car" model="car_like"/>',
    *,
    horizon: str = "2 s",
    team: str = "",
    poses: tuple[str, str, str] = (AT_ORIGIN, ON_THE_RIGHT, ON_THE_LEFT),
    torque: str = "8 N.m",
    leader: str = "",
    one: str = "",
    two: str = "",
    second_plant: str = "car",
    end: str = "",
) -> str:
    """Return the text.

    Parameters
    ----------
    plants
        The plants; one of them is ``car``, of the leader and the first follower.
    team
        What acts on all robots: sensors, actuators, inputs.
    poses
        Of the leader and the followers, as attributes.
    torque
        Of the leader's drive.
    leader, one, two
        What else the leader and the followers, ``one`` and ``two``, have.
    end
        Events and expectations.
    """
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<scenario xmlns="{NAMESPACE}" name="two">
  <title>Two followers</title>
  <simulation horizon="{horizon}" step="20 ms" seed="1"/>
  {plants}
  <controller id="pid" name="neural-adaptive-pid" package="formation-controllers" version="~=0.1.0"/>
  {team}
  <leader plant="car">
    <pose {poses[0]}/>
    <torque tau_drive="{torque}"/>{leader}
  </leader>
  <follower id="one" plant="car" controller="pid">
    <pose {poses[1]}/>
    <desired range="3 m" bearing="30 deg"/>{one}
  </follower>
  <follower id="two" plant="{second_plant}" controller="pid">
    <pose {poses[2]}/>
    <desired range="3 m" bearing="-30 deg"/>{two}
  </follower>
  {end}
</scenario>
"""
