"""What a translated function is to those that call it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from cosim.translation.kinds import Kind, Scalar, Several, Struct
from cosim.translation.values import Root


@dataclass(frozen=True)
class Translated:
    """A function in C.

    Attributes
    ----------
    name : str
        Its name.
    kinds : tuple
        The kinds of its parameters.
    result : kind or None
        What it returns.
    is_natural : bool
        Whether that is known not to be negative.
    writes : mapping
        For each parameter into whose memory it writes: the paths from there on.
    more : mapping
        For each parameter that is an array with gaps: for each dimension, whether its step and its size are parameters.
    head : str
        Its declaration, without ``static``.
    text : str
        Comment, head and body.
    """

    name: str
    kinds: tuple[Kind, ...]
    result: Scalar | Struct | Several | None
    is_natural: bool
    writes: Mapping[int, frozenset[Root]]
    more: Mapping[int, tuple[tuple[bool, bool], ...]]
    head: str
    text: str
