"""Words by which the variables of a foreign FMU are recognised as roles of a vehicle."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass


@dataclass(frozen=True)
class Clue:
    """Words that are evidence for a role.

    Attributes
    ----------
    groups : tuple of frozenset
        The name must have a word of each group.
    alone : bool
        Whether the name may have no other word, except words that do not distinguish roles.
    with_unit : bool
        Whether the words are no evidence for a variable without a unit.
    """

    groups: tuple[frozenset[str], ...]
    alone: bool = False
    with_unit: bool = False


@dataclass(frozen=True)
class Recognition:
    """Recognition of a role: one of several clues must fit, the best one first, and some words must be absent."""

    clues: tuple[Clue, ...]
    never: frozenset[str]

    def rank(self, words: Collection[str], *, has_unit: bool) -> tuple[int, int] | None:
        """Return how well words fit: the number of the clue, and how many words it leaves unexplained; None if not."""
        if self.never & set(words):
            return None
        for number, clue in enumerate(self.clues):
            if not all(group & set(words) for group in clue.groups):
                continue
            rest = [word for word in words if word not in NEUTRAL and not any(word in group for group in clue.groups)]
            if not (clue.alone and rest) and (has_unit or not clue.with_unit):
                return number, len(rest)
        return None


@dataclass(frozen=True)
class Series:
    """An array that may hold roles one after the other.

    Attributes
    ----------
    words : frozenset
        Words of its name.
    sizes : tuple of int
        Possible numbers of elements.
    roles : tuple of str
        The roles of the elements, in their order.
    telling : bool
        Whether the name is enough evidence, if the units fit as well.
    """

    words: frozenset[str]
    sizes: tuple[int, ...]
    roles: tuple[str, ...]
    telling: bool = False

    def role(self, words: Collection[str], size: int, place: int) -> str | None:
        """Return the role of the element at a place, from 0, of an array whose name has these words."""
        known = self.words & set(words) and set(words) <= self.words | NEUTRAL
        return self.roles[place] if known and size in self.sizes and place < len(self.roles) else None


def words(text: str) -> frozenset[str]:
    """Return the words of a text."""
    return frozenset(text.split())


def clue(text: str, *, alone: bool = False, with_unit: bool = False) -> Clue:
    """Return the clue of groups of words: ``"steer|steering rate|dot"``."""
    return Clue(tuple(frozenset(group.split("|")) for group in text.split()), alone, with_unit)


def known_by(*clues: str | Clue, never: str = "") -> Recognition:
    """Return the recognition of a role by clues, the best one first, and by words that it never has."""
    return Recognition(tuple(clue(one) if isinstance(one, str) else one for one in clues), words(never))


STARTING = words("init initial start starting begin ic")
"""Words of a parameter that gives an initial value; so does a zero at the end."""

NEUTRAL = words(
    "vehicle car robot rover agv ugv chassis body model plant pose position pos p coordinate coordinates state states "
    "out output outputs in input inputs geometry parameter parameters param params axle rear axis angle angular "
    "forward longitudinal actual current front"
)
"""Words that do not distinguish roles."""

# Words that most kinds of vehicles share, as clues for a role and against it.
OTHER = (
    "target ref reference desired des cmd command commanded setpoint set request requested max min maximum minimum "
    "limit lim upper lower stop error err est estimate estimated noise bias measured meas sensor nominal scale gain "
    "init initial start"
)
"""Words of a wanted, allowed, measured or estimated value in place of the true one."""
RATES = "dot ddot rate der derivative acc acceleration"
MOTION = "v vel velocity speed omega w"
EFFORTS = "tau torque moment force f m i inertia mass"
DISTURBANCES = "d dist disturbance disturbing load friction resistance brake braking max min limit"
STEERING = "gamma|delta|steer|steering"
HEADING = "psi|heading|yaw"
EFFORT = "tau|torque|moment|m|t"

NO_PLACE = f"{OTHER} {RATES} {MOTION} {EFFORTS} a front hitch com cog cg camera wheel"
NO_HEADING = f"{OTHER} {RATES} {MOTION} {EFFORTS} steer steering gamma delta wheel roll pitch hitch articulation"
NO_SPEED = (
    f"{OTHER} {RATES} {EFFORTS} x y z lat lateral side slip wind angular yaw steer steering gamma delta psi heading "
    "wheel motor engine omega"
)

X_AXIS = "north|south|west|front|nord|norden|süd|süden|westen"
Y_AXIS = "east|south|right|front|ost|osten|süd|süden|rechts"
FORWARD = "reverse|backwards?|rückwärts"
COMPASS = "clockwise|north|compass|im uhrzeigersinn|nord|norden|kompass"
TURNING = "clockwise|right|im uhrzeigersinn|rechts"
# The last five: words of a description that uses another convention than ours, as parts of a regular expression.
