"""What the names of variables say: their words, and the words by which the roles of a vehicle are known."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache

from cosim.swap.translations import TRANSLATED, plain
from cosim.vehicle.contract import CAR_LIKE, CONTRACTS, TRACTOR_TRAILER, Contract


@dataclass(frozen=True)
class Clue:
    """Words that tell a role.

    Attributes
    ----------
    groups : tuple of frozenset
        Of each group, a word must be there.
    alone : bool
        Whether no other word may be there, but for those that say nothing.
    with_unit : bool
        Whether the words tell too little where the variable has no unit.
    """

    groups: tuple[frozenset[str], ...]
    alone: bool = False
    with_unit: bool = False


@dataclass(frozen=True)
class Recognition:
    """How a role is known: by one of several clues, the best one first, and by the absence of some words."""

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
        How many elements it has.
    roles : tuple of str
        Which roles they would be.
    telling : bool
        Whether its name says so, if the units fit as well.
    """

    words: frozenset[str]
    sizes: tuple[int, ...]
    roles: tuple[str, ...]
    telling: bool = False

    def role(self, words: Collection[str], size: int, place: int) -> str | None:
        """Return the role of the element at a place, from 0, of an array whose name has these words."""
        known = self.words & set(words) and set(words) <= self.words | NEUTRAL
        return self.roles[place] if known and size in self.sizes and place < len(self.roles) else None


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


STARTING = _words("init initial start starting begin ic")
"""Words of a parameter that gives an initial value; so does a zero at the end."""

NEUTRAL = _words(
    "vehicle car robot rover agv ugv chassis body model plant pose position pos p coordinate coordinates state states "
    "out output outputs in input inputs geometry parameter parameters param params axle rear axis angle angular "
    "forward longitudinal actual current front"
)
"""Words that tell no role from another."""


_LONGEST = 60
"""Letters of a word that is taken apart."""
_PART = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+|[^\W_]+")


def words_of(name: str) -> tuple[str, ...]:
    """Return the words of a name in lower case, in English: ``vehicle.rearAxle.x0`` has vehicle, rear, axle, x, 0."""
    return in_english(parts_of(name))


def parts_of(name: str) -> tuple[str, ...]:
    """Return the words of a name as they are."""
    words: list[str] = []
    for part in _PART.findall(plain(name)):
        words += (part,) if part.isdigit() else _parts(part)
    return tuple(words)


def in_english(words: tuple[str, ...]) -> tuple[str, ...]:
    """Return words in English, where they are known of another language."""
    if TRANSLATED.keys().isdisjoint(words):
        return words
    return tuple(english for word in words for english in TRANSLATED.get(word, (word,)))


def without_start(words: tuple[str, ...]) -> tuple[str, ...] | None:
    """Return the words of an initial value without those that say that it is one; None if it is none."""
    if STARTING.isdisjoint(words) and words[-1:] != ("0",):
        return None
    rest = tuple(word for word in words if word not in STARTING)
    if rest == words and words[-1:] == ("0",):
        rest = words[:-1]
    return rest if rest and rest != words else None


@lru_cache(maxsize=10_000)
def _parts(part: str) -> tuple[str, ...]:
    """Return the words of which a part of a name is made, such as steer and angle, or p and x."""
    word = part.lower()
    if match := re.fullmatch(r"(p|pos|position|v|vel|velocity|a|acc)([xyz])", word):
        return match[1], match[2]
    if match := re.fullmatch(r"([xyz])(pos|position|coordinate)", word):
        return match[1], match[2]
    known = _long_words()
    for i in range(3, len(word) - 2) if word not in known and len(word) <= _LONGEST else ():
        rest = _parts(word[i:]) if word[:i] in known else ()
        if rest and all(part in known for part in rest):
            return word[:i], *rest
    return (word,)


# The roles --------------------------------------------------------------------------------------------------


def _clue(text: str, *, alone: bool = False, with_unit: bool = False) -> Clue:
    """Return the clue of groups of words: ``"steer|steering rate|dot"``."""
    return Clue(tuple(frozenset(group.split("|")) for group in text.split()), alone, with_unit)


def _known_by(*clues: str | Clue, never: str = "") -> Recognition:
    return Recognition(tuple(_clue(clue) if isinstance(clue, str) else clue for clue in clues), _words(never))


# Of what is wanted, allowed, measured or estimated instead of what is; of rates; of other quantities.
_OTHER = (
    "target ref reference desired des cmd command commanded setpoint set request requested max min maximum minimum "
    "limit lim upper lower stop error err est estimate estimated noise bias measured meas sensor nominal scale gain "
    "init initial start"
)
_RATES = "dot ddot rate der derivative acc acceleration"
_MOTION = "v vel velocity speed omega w"
_EFFORTS = "tau torque moment force f m i inertia mass"
_DISTURBANCES = "d dist disturbance disturbing load friction resistance brake braking max min limit"
_STEERING = "gamma|delta|steer|steering"
_HEADING = "psi|heading|yaw"
_EFFORT = "tau|torque|moment|m|t"
_TRACTOR = "tractor|truck|cab"

_NO_PLACE = f"{_OTHER} {_RATES} {_MOTION} {_EFFORTS} a front hitch com cog cg camera wheel"
_NO_HEADING = f"{_OTHER} {_RATES} {_MOTION} {_EFFORTS} steer steering gamma delta wheel roll pitch hitch articulation"
_NO_SPEED = (
    f"{_OTHER} {_RATES} {_EFFORTS} x y z lat lateral side slip wind angular yaw steer steering gamma delta psi heading "
    "wheel motor engine omega"
)

RECOGNITIONS: Mapping[str, Mapping[str, Recognition]] = {
    CAR_LIKE.vehicle: {
        "x": _known_by("x", never=_NO_PLACE),
        "y": _known_by("y", never=_NO_PLACE),
        "psi": _known_by(_HEADING, "theta|orientation", never=f"{_NO_HEADING} trailer"),
        "gamma": _known_by(_STEERING, never=f"{_OTHER} {_RATES} {_MOTION} {_EFFORTS} ratio gear motor hand"),
        "v": _known_by("v|vel|velocity|speed", _clue("u", alone=True), never=_NO_SPEED),
        "omega": _known_by(
            f"{_STEERING} rate|dot|velocity|vel|speed|omega",
            _clue("omega", alone=True),
            never=f"{_OTHER} {_EFFORTS} yaw wheel motor engine hand acc acceleration ddot",
        ),
        "tau_drive": _known_by(
            f"{_EFFORT} drive|driving|driveline|drivetrain|traction|propulsion|motor|rear|engine",
            _clue("drive|driving|traction|propulsion|motor", with_unit=True),
            never=f"{_DISTURBANCES} steer steering gamma delta left right angle rate",
        ),
        "tau_steer": _known_by(
            f"{_EFFORT} {_STEERING}",
            _clue("steer|steering", with_unit=True),
            never=f"{_DISTURBANCES} angle rate aligning",
        ),
        "a": _known_by(
            "wheelbase",
            "wheel base",
            "axle|axles distance|spacing",
            _clue("l|a", alone=True),
            never=f"{_OTHER} half front rear",
        ),
    },
    TRACTOR_TRAILER.vehicle: {
        "x": _known_by("trailer x", "x", never=f"{_NO_PLACE} tractor truck cab"),
        "y": _known_by("trailer y", "y", never=f"{_NO_PLACE} tractor truck cab"),
        "theta_1": _known_by(f"trailer {_HEADING}|theta|orientation", never=f"{_NO_HEADING} tractor truck cab"),
        "theta_0": _known_by(
            f"{_TRACTOR} {_HEADING}|theta|orientation",
            _clue(_HEADING, alone=True),
            never=f"{_NO_HEADING} trailer",
        ),
        "v": _known_by("trailer v|vel|velocity|speed", "v|vel|velocity|speed", never=f"{_NO_SPEED} tractor truck cab"),
        "omega": _known_by(
            f"{_TRACTOR} omega",
            f"{_TRACTOR} {_HEADING} rate|dot|velocity|vel",
            f"{_HEADING} rate|dot|velocity|vel",
            _clue("omega", alone=True),
            never=f"{_OTHER} {_EFFORTS} trailer wheel motor engine steer steering",
        ),
        "tau_right": _known_by(
            f"right|r {_EFFORT}",
            _clue("right motor|wheel|drive", with_unit=True),
            never=f"{_DISTURBANCES} left l steer steering",
        ),
        "tau_left": _known_by(
            f"left|l {_EFFORT}",
            _clue("left motor|wheel|drive", with_unit=True),
            never=f"{_DISTURBANCES} right r steer steering",
        ),
        "d": _known_by("hitch|drawbar|coupling length|distance|offset", "trailer length", never=_OTHER),
        "r": _known_by("wheel radius", _clue("radius", alone=True), never=_OTHER),
        "b": _known_by("half track|gauge|width", never=_OTHER),
    },
}
"""By which words a role is known, by vehicle and role; its own name aside."""


def _series(contract: Contract) -> tuple[Series, ...]:
    pose, torque = (tuple(role.name for role in roles) for roles in (contract.pose, contract.torque))
    return (
        Series(_words("pose"), (4,), pose, telling=True),
        Series(_words("q eta state states coordinates configuration"), (4,), pose),
        Series(_words("pose"), (3,), pose[:3], telling=True),
        Series(_words("position pos location"), (2, 3), pose[:2], telling=True),
        Series(_words("p"), (2, 3), pose[:2]),
        Series(_words("tau torque torques moment moments u input inputs"), (2,), torque),
    )


SERIES: Mapping[str, tuple[Series, ...]] = {contract.vehicle: _series(contract) for contract in CONTRACTS}
"""The arrays that may hold roles of a vehicle in the order of its contract."""

ORDER: Mapping[str, Mapping[str, frozenset[str]]] = {
    CAR_LIKE.vehicle: {
        "tau_drive": _words("drive driving traction propulsion motor"),
        "tau_steer": _words("steer steering gamma delta"),
    },
    TRACTOR_TRAILER.vehicle: {"tau_right": _words("right"), "tau_left": _words("left")},
}
"""Words of a description that tell the torques of an array from one another."""


@cache
def _long_words() -> frozenset[str]:
    """Return the words of three letters and more that are known."""
    return frozenset(word for word in (*NEUTRAL, *STARTING, *TRANSLATED, *_words_of_clues()) if len(word) > 2)


def _words_of_clues() -> Iterator[str]:
    for recognitions in RECOGNITIONS.values():
        for recognition in recognitions.values():
            yield from recognition.never
            for clue in recognition.clues:
                for group in clue.groups:
                    yield from group


_OTHER_CONVENTIONS: Mapping[str, str] = {
    "x": "north|south|west|front|nord|norden|süd|süden|westen",
    "y": "east|south|right|front|ost|osten|süd|süden|rechts",
    "v": "reverse|backwards?|rückwärts",
    **dict.fromkeys(("psi", "theta_1", "theta_0"), "clockwise|north|compass|im uhrzeigersinn|nord|norden|kompass"),
    **dict.fromkeys(("gamma", "omega", "tau_steer"), "clockwise|right|im uhrzeigersinn|rechts"),
}


def doubtful(role: str, description: str) -> bool:
    """Return whether the description of what plays a role speaks of another convention than the contract's."""
    pattern = _OTHER_CONVENTIONS.get(role)
    text = re.sub(r"(?i)(counter|anti)[ -]?clockwise", "", description)
    return pattern is not None and re.search(rf"(?i)\b({pattern})\b", text) is not None
