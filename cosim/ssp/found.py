"""What comes of an SSP: the text of a scenario, other files, and sentences about both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Found:
    """The scenario that an SSP holds.

    Attributes
    ----------
    text : bytes
        The scenario.
    files : dict
        Other files by their paths relative to the scenario.
    notes, to_do : tuple of str
        See `cosim.ssp.imported.Imported`.
    open : bool
        Whether the user must fill something in before it can run.
    """

    text: bytes
    files: Mapping[str, bytes]
    notes: tuple[str, ...] = ()
    to_do: tuple[str, ...] = ()
    open: bool = False
