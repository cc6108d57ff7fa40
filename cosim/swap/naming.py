"""Names of variables: their words, in English; and conventions in descriptions."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache, lru_cache
from itertools import chain

from cosim.swap.translations import TRANSLATED, plain
from cosim.vehicle.kind import Kind
from cosim.vehicle.kinds import kinds
from cosim.vehicle.words import NEUTRAL, STARTING

_LONGEST = 60
"""Letters of a word that is taken apart."""
_PART = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+|[^\W_]+")


def words_of(name: str) -> tuple[str, ...]:
    """Return the words of a name in lower case, in English: ``vehicle.rearAxle.x0`` has vehicle, rear, axle, x, 0."""
    return in_english(parts_of(name))


def parts_of(name: str) -> tuple[str, ...]:
    """Return the words of a name as they are."""
    return tuple(chain.from_iterable(map(_between_dots, name.split("."))))


@lru_cache(maxsize=10_000)
def _between_dots(component: str) -> tuple[str, ...]:
    words: list[str] = []
    for part in _PART.findall(plain(component)):
        words += (part,) if part.isdigit() else _parts(part)
    return tuple(words)


def in_english(words: tuple[str, ...]) -> tuple[str, ...]:
    """Return words in English, where they are known of another language."""
    if TRANSLATED.keys().isdisjoint(words):
        return words
    return tuple(english for word in words for english in TRANSLATED.get(word, (word,)))


def without_start(words: tuple[str, ...]) -> tuple[str, ...] | None:
    """Return the words of an initial value without words such as "initial"; None if it is no initial value."""
    if STARTING.isdisjoint(words) and words[-1:] != ("0",):
        return None
    rest = tuple(word for word in words if word not in STARTING)
    if rest == words and words[-1:] == ("0",):
        rest = words[:-1]
    return rest if rest and rest != words else None


@lru_cache(maxsize=10_000)
def _parts(part: str) -> tuple[str, ...]:
    """Return the words in a part of a name, such as steer and angle, or p and x."""
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


@cache
def _long_words() -> frozenset[str]:
    """Return the words of three letters and more that are known."""
    return frozenset(word for word in (*NEUTRAL, *STARTING, *TRANSLATED, *_words_of_clues()) if len(word) > 2)


def _words_of_clues() -> Iterator[str]:
    for kind in kinds():
        for recognition in kind.recognised.by_role.values():
            yield from recognition.never
            for clue in recognition.clues:
                for group in clue.groups:
                    yield from group


def doubtful(role: str, kind: Kind, description: str) -> bool:
    """Return whether a description of a variable contradicts the convention of the role that it plays."""
    pattern = kind.recognised.conventions.get(role)
    text = re.sub(r"(?i)(counter|anti)[ -]?clockwise", "", description)
    return pattern is not None and re.search(rf"(?i)\b({pattern})\b", text) is not None
