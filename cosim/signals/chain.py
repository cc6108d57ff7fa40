"""The effects of all sensors, or of all actuators, applied one after the other in compiled code."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.compiled import address_of, borrowing, call
from cosim.signals.effects import EFFECTS
from cosim.signals.effects.effect import EffectKind, Floats, Rows
from cosim.signals.random import NO_STREAMS, Streams

WINDOW = 1024
"""Number of ticks for which amounts are made at once, a power of two: making them takes its time whatever it is."""
_FEW, _SHORT_WINDOW = 64, 256
"""Above so many channels the number of ticks is smaller, so that the amounts stay near the processor."""


class ChainArrays(NamedTuple):
    """A chain for compiled code.

    Attributes
    ----------
    acts : ndarray of int64
        The address of each effect's function.
    amounts : ndarray
        What they get: (effects, ticks of a window, robots, channels).
    memory : ndarray
        What they keep: (effects, arrays, robots, channels).
    """

    acts: NDArray[np.int64]
    amounts: Floats
    memory: Floats


class Chain:
    """The effects on the channels of some robots.

    Legal call order: `make_ready` for tick after tick from 0 on, at least once in each window that it tells; the
    compiled `apply` for each of these ticks; `restart` leads back to the start.

    Parameters
    ----------
    rows
        The robots and their effects.

    Attributes
    ----------
    arrays : ChainArrays
        The chain for compiled code.
    """

    def __init__(self, rows: Rows) -> None:
        used = {effect.kind for effects in rows.effects for effect in effects}
        kinds = sorted(EFFECTS.values(), key=lambda kind: kind.order)
        self._rows = rows
        self._effects = [kind(rows) for kind in kinds if kind.element in used]
        self._ready = -1  # the window whose amounts are made
        shape = (len(rows.effects), rows.width)
        window = WINDOW if shape[0] * shape[1] <= _FEW else _SHORT_WINDOW
        amounts = np.zeros((len(self._effects), window, *shape))
        memory = np.zeros((len(self._effects), max((e.remembers for e in self._effects), default=0), *shape))
        acts = [address_of(e.act, 0, amounts[0, 0], amounts[0, 0], memory[0]) for e in self._effects]
        self.arrays = ChainArrays(np.array(acts, dtype=np.int64), amounts, memory)

    @property
    def effects(self) -> Sequence[EffectKind]:
        """The kinds of effects in use, in the order in which they are applied."""
        return self._effects

    def restart(self, rows: Rows) -> bool:
        """Go back to before the first tick of a run with another seed; return whether nothing else differs."""
        if replace(rows, seed=self._rows.seed) != self._rows:
            return False
        self._rows, self._ready = rows, -1
        self.arrays.memory[:] = 0.0
        for effect in self._effects:
            effect.restart(rows)
        return True

    def saved(self) -> dict[str, tuple[Floats, Streams]]:
        """Return what each kind of effect remembers, and its streams before the window of the last tick."""
        memories = (memory[: e.remembers].copy() for e, memory in zip(self._effects, self.arrays.memory, strict=True))
        return {effect.element: (memory, effect.marked) for effect, memory in zip(self._effects, memories, strict=True)}

    def restore(self, state: Mapping[str, tuple[Floats, Streams]], tick: int, *, same_seed: bool) -> None:
        """Go on before a tick from a saved state, as far as the effects are the same.

        Streams that had another seed, or that were not there, begin with the window of the tick.

        Raises
        ------
        ValueError
            An effect remembers numbers that the state does not have; the text is its element.
        """
        for effect, memory in zip(self._effects, self.arrays.memory, strict=True):
            before, streams = state.get(effect.element, (memory[:0], NO_STREAMS))
            if before.shape != memory[: effect.remembers].shape:
                raise ValueError(effect.element)
            memory[: effect.remembers] = before
            if same_seed:
                effect.go_on(streams)
        self._ready = -1
        self.make_ready(tick - 1)  # the window of the last tick, as before

    def make_ready(self, tick: int) -> int:
        """Make the amounts of the window in which a tick lies; return the first tick behind the window."""
        length = int(self.arrays.amounts.shape[1])
        if tick // length != self._ready:
            self._ready = tick // length
            for effect, amounts in zip(self._effects, self.arrays.amounts, strict=True):
                effect.mark()
                effect.amounts(self._ready * length, amounts)
        return (self._ready + 1) * length


def again(before: Chain | None, rows: Rows) -> Chain:
    """Return the chain of an earlier run if it can be restarted with some rows, else a new one."""
    return before if before is not None and before.restart(rows) else Chain(rows)


@borrowing
def apply(chain: ChainArrays, tick: int, values: Floats) -> None:
    """Change the values (robots, channels) of a tick in place."""
    place = tick & (chain.amounts.shape[1] - 1)  # in the window
    for e in range(len(chain.acts)):
        call(chain.acts[e], (tick, values, chain.amounts[e, place], chain.memory[e]))
