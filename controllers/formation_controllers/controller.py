"""The base class of all controllers."""

from __future__ import annotations

import copy
import io
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Generic, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from formation_controllers.errors import ControllerError, GainError
from formation_controllers.gains import Gains
from formation_controllers.input_checks import (
    all_finite,
    checked,
    checked_desired,
    checked_leader,
    converted,
    finite,
    fits,
)
from formation_controllers.interface import CompiledStart, CompiledTick, Desired, Floats, Leader, Signal, Team
from formation_controllers.vehicles import Vehicle, is_one_of, names

G = TypeVar("G", bound=Gains)


class Controller(ABC, Generic[G]):
    """A controller of a team of followers of one kind of vehicle.

    The legal order of calls:

    1. ``Controller(team, gains)``
    2. `start`, with the poses at time zero
    3. `step`, once a tick, the first with the same poses as `start`
    4. `telemetry`, `get_state`, `to_bytes`, any time after `start`
    5. `reset` leads back to 1; `set_state` and `from_bytes` stand in for `start`

    `copy` is legal at any time. A law is decentralised: row i of what comes out depends on row i of what goes
    in, and on the leader. The sizes of all arrays are the vehicle's: P entries of a pose, V velocities and C commands,
    which are torques unless the vehicle says otherwise.

    To write one, state the class variables and the three abstract methods, keep every number that changes in
    ``self._state``, and write the signals into ``self._telemetry``: both are structured arrays with one
    record a robot and one field for each name. A law that `needs` measured velocities finds those of the tick
    in ``self._velocity`` (N, V).

    Parameters
    ----------
    team
        The followers.
    gains
        The gains, of the class's `gains_type`: one object for all followers or a sequence with one for each; the
        defaults if left out.

    Attributes
    ----------
    team : Team
        The followers.
    robot_gains : tuple of Gains
        The gains of each follower.

    Raises
    ------
    ControllerError
        If the team is none, or the controller does not serve this kind of vehicle.
    GainError
        If the gains are another law's, or not as many as there are followers.
    """

    interface: ClassVar[str]
    """Version of the interface that the class speaks."""
    vehicles: ClassVar[tuple[str, ...]]
    """Kinds of vehicles that it serves; with `OTHERS` among them, also kinds that state what it needs."""
    gains_type: type[G]
    """Its gains."""
    signals: ClassVar[tuple[Signal, ...]]
    """Its telemetry."""
    needs: ClassVar[tuple[str, ...]] = ()
    """Measurements besides poses, of `MEASUREMENTS`: ``("velocity",)`` or nothing."""

    def __init__(self, team: Team, gains: G | Sequence[G] | None = None) -> None:
        name = type(self).__name__
        if not isinstance(team, Team):
            raise ControllerError(f"the team of this {name} is {team!r}: expected a Team")
        gains = self.gains_type() if gains is None else gains
        if not self.serves(team.vehicle):
            raise ControllerError(f"{name} serves vehicles of kind {', '.join(self.vehicles)}, not {team.vehicle.kind}")
        self.robot_gains = tuple(gains) if isinstance(gains, Sequence) else (gains,) * team.size
        if len(self.robot_gains) != team.size:
            raise GainError(f"there are gains for {len(self.robot_gains)} followers: expected {team.size}")
        for own in self.robot_gains:
            if not isinstance(own, self.gains_type):
                raise GainError(f"{name} takes gains of {self.gains_type.__name__}, not of {type(own).__name__}")
        self.team = team
        poses, velocities, commands = (
            len(entries) for entries in (team.vehicle.pose, team.vehicle.velocity, team.vehicle.command)
        )
        pairs = (team.size, 2)
        leader = (poses,), (velocities,), (velocities,)
        self._shapes = ((team.size, poses), *leader, pairs, pairs, pairs)  # of the inputs of a tick
        self._command_shape = (team.size, commands)
        self._command_word = "torque" if {entry.unit for entry in team.vehicle.command} == {"N.m"} else "command"
        self._velocity = np.full((team.size, velocities), np.nan)
        self._no_acceleration = np.zeros(velocities)
        states = [(state, float, shape) for state, shape in self.state_shapes().items()]
        signals = [(s.name, float, (len(s.components),) if s.components else ()) for s in self.signals]
        self._state = np.zeros(team.size, dtype=np.dtype(states))
        self._telemetry = np.full(team.size, np.nan, dtype=np.dtype(signals))
        self._started = False

    @classmethod
    def serves(cls, vehicle: Vehicle) -> bool:
        """Tell whether the law serves a vehicle: one of its `vehicles`."""
        return is_one_of(cls.vehicles, vehicle)

    @property
    def gains(self) -> G:
        """The gains that all followers share.

        Raises
        ------
        GainError
            If each follower has its own.
        """
        first = self.robot_gains[0]
        if any(own is not first and own != first for own in self.robot_gains):
            raise GainError(f"the followers of this {type(self).__name__} have gains of their own: see robot_gains")
        return first

    @abstractmethod
    def state_shapes(self) -> dict[str, tuple[int, ...]]:
        """Return name and shape, per robot, of every state of the law."""

    @abstractmethod
    def on_start(self, pose: Floats, leader: Leader, desired: Desired) -> None:
        """Set those states that do not start at zero. The arguments are checked arrays."""

    @abstractmethod
    def on_step(self, pose: Floats, leader: Leader, desired: Desired) -> Floats:
        """Return the commands (N, C) of this tick, then advance every state by one period. Checked arrays."""

    def start(self, pose: ArrayLike, leader: Leader, desired: Desired) -> None:
        """Set every state to its value at time zero.

        Parameters
        ----------
        pose
            Poses (N, P) of the followers.
        leader
            The virtual leader.
        desired
            Desired range and bearing.

        Raises
        ------
        ControllerError
            If a shape does not fit the team or a number is not finite, naming robot and component, or if the law
            refuses to start there. The controller is then as it was before the call.
        """
        inputs = self._checked(pose, leader, desired)
        state, telemetry = self._state.copy(), self._telemetry.copy()
        self._clear()
        try:
            self.on_start(*inputs)
        except BaseException:
            self._state[...], self._telemetry[...] = state, telemetry
            raise
        self._started = True

    def step(self, pose: ArrayLike, leader: Leader, desired: Desired, velocity: ArrayLike | None = None) -> Floats:
        """Return the commands of this tick, unsaturated, and advance every state by one period.

        Parameters
        ----------
        pose
            Poses (N, P) of the followers.
        leader
            The virtual leader.
        desired
            Desired range and bearing.
        velocity
            Measured velocities (N, V) of the followers, for a law that `needs` them; other laws do not look at them.

        Returns
        -------
        ndarray
            Commands (N, C), in the vehicle's units: torques, as a rule.

        Raises
        ------
        ControllerError
            Before `start`; if a shape does not fit the team, a number is not finite, naming robot and
            component, or velocities that the law needs are missing (the controller is then as it was before the
            call); or if the law returns commands of another shape or that are not finite (it is then of no use
            until the next `start`).
        """
        self._require_start("a step")
        inputs = self._checked(pose, leader, desired)
        if "velocity" in self.needs:
            self._velocity = self._checked_velocity(velocity)
        command = self.on_step(*inputs)
        if not fits(command, self._command_shape):
            command = converted(f"the {self._command_word} of {type(self).__name__}", command, self._command_shape)
        if not finite(command):
            raise self.not_finite(command)
        return command

    def compiled_tick(self) -> CompiledTick | None:
        """Return the law as compiled code can call it in place of `step`, with the same numbers; None if it cannot.

        The caller starts the controller by `start`, gives inputs of the right shapes that are finite, and checks that
        the commands are.
        """
        return None

    def compiled_start(self) -> CompiledStart | None:
        """Return what `start` does as compiled code can call it, with the same numbers; None if it cannot."""
        return None

    def telemetry(self) -> dict[str, Floats]:
        """Return every signal at the last step, from which its torques came; NaN before the first step."""
        return {signal.name: self._telemetry[signal.name].copy() for signal in self.signals}

    @property
    def telemetry_record(self) -> NDArray[np.void]:
        """The same as one record a robot, with a field for each signal: a view, good until the next call."""
        return self._telemetry

    def reset(self) -> None:
        """Go back to before `start`."""
        self._clear()
        self._started = False

    def copy(self) -> Self:
        """Return an independent controller in the same state."""
        return copy.deepcopy(self)

    def get_state(self) -> dict[str, Floats]:
        """Return every state, each an array with one row a robot.

        Raises
        ------
        ControllerError
            Before `start`.
        """
        self._require_start("a state")
        return {name: self._state[name].copy() for name in self._names()}

    def set_state(self, state: Mapping[str, ArrayLike]) -> None:
        """Go on from a state that a controller with the same team had, with the gains of this one.

        Raises
        ------
        ControllerError
            If a state is missing, unknown, of another shape or not finite. The controller is then as it was.
        """
        if not isinstance(state, Mapping):
            raise ControllerError(f"the state is a {type(state).__name__}: expected a mapping from names to arrays")
        if set(state) != set(self._names()):
            raise ControllerError(f"the states are {sorted(map(str, state))}: expected {sorted(self._names())}")
        arrays = {name: converted(f"state {name!r}", state[name], self._state[name].shape) for name in self._names()}
        for name, array in arrays.items():
            rows = np.isfinite(array).reshape(self.team.size, -1).all(axis=1)
            if not rows.all():
                raise ControllerError(f"state {name!r} is not finite", robot=int(rows.argmin()))
        self._clear()
        for name, array in arrays.items():
            self._state[name] = array
        self._started = True

    def to_bytes(self) -> bytes:
        """Return the state as bytes (NumPy's ``npy`` format).

        Raises
        ------
        ControllerError
            Before `start`.
        """
        self._require_start("a state")
        buffer = io.BytesIO()
        np.save(buffer, self._state, allow_pickle=False)
        return buffer.getvalue()

    def from_bytes(self, data: bytes) -> None:
        """Go on from the bytes of a state, as `set_state` does.

        Raises
        ------
        ControllerError
            If the bytes are not a state of such a controller.
        """
        try:
            state = np.lib.format.read_array(io.BytesIO(data), allow_pickle=False)
        except Exception as error:  # NumPy raises exceptions of any kind for other files
            raise ControllerError(f"the bytes are not a controller's state: {error}") from None
        self.set_state({name: state[name] for name in state.dtype.names or ()})

    def not_finite(self, command: Floats) -> ControllerError:
        """Return the error of commands (N, C) that are not finite.

        It names the first such follower, and its signals near zero.
        """
        robot = int(np.argmin(np.isfinite(command).all(axis=1)))
        told = [(signal, self._telemetry[signal.name][robot]) for signal in self.signals]
        values = ", ".join(f"{signal.name} = {value} {signal.unit}" for signal, value in told)
        near = "".join(
            f"; {signal.name} is near zero, where {signal.singular_at_zero}"
            for signal, value in told
            if (np.abs(value) < signal.singular_below).any()
        )
        return ControllerError(f"the {self._command_word} is not finite, at {values}{near}", robot=robot)

    def _names(self) -> tuple[str, ...]:
        return self._state.dtype.names or ()

    def _clear(self) -> None:
        self._state[...] = np.zeros((), self._state.dtype)
        self._telemetry[...] = np.full((), np.nan, self._telemetry.dtype)

    def _require_start(self, what: str) -> None:
        if not self._started:
            raise ControllerError(f"{what} was asked for before the controller was started: call start() first")

    def _checked(self, pose: ArrayLike, leader: Leader, desired: Desired) -> tuple[Floats, Leader, Desired]:
        """Return the inputs as arrays of the right shape with finite numbers, or refuse them by name."""
        if type(leader) is Leader and type(desired) is Desired:
            acceleration = self._no_acceleration if leader.acceleration is None else leader.acceleration
            given: tuple[Any, ...] = (pose, leader.pose, leader.velocity, acceleration, *desired)
            if all(map(fits, given, self._shapes)) and all_finite(*given):  # as at almost every tick
                return pose, leader, desired  # type: ignore[return-value]
        vehicle = self.team.vehicle
        return (
            checked("pose", pose, self._shapes[0], names(vehicle.pose)),
            checked_leader(leader, vehicle),
            checked_desired(desired, self.team.size),
        )

    def _checked_velocity(self, velocity: ArrayLike | None) -> Floats:
        if velocity is None:
            raise ControllerError(
                f"{type(self).__name__} needs the measured velocities of the followers: pass them as velocity"
            )
        return checked("velocity", velocity, self._velocity.shape, names(self.team.vehicle.velocity))
