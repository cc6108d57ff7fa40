"""The sensor and the actuators of followers without their own."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from cosim.errors import InputError
from cosim.scenario.reader.times import Times
from cosim.scenario.scenario import EffectSource
from cosim.signals.effects import check_values
from cosim.vehicle.kind import Kind, units_of


def check_common_effects(
    sensor: Sequence[EffectSource], actuator: Sequence[EffectSource], kinds: Iterable[Kind], times: Times
) -> None:
    """Check the common effects; they must fit some follower, even if every follower has its own.

    Raises
    ------
    InputError
        A value makes no sense, with the place in the scenario.
    """
    refused: InputError | None = None
    for kind in kinds:
        try:
            check_values(sensor, units_of(kind.pose), times)
            check_values(actuator, units_of(kind.command), times)
            return
        except InputError as error:
            refused = error
    if refused is not None:
        raise refused
