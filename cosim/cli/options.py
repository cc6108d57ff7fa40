"""A parser of options that refuses abbreviations, and options that are given twice."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import takewhile
from typing import Any, NoReturn

from cosim.errors import InputError, brief, nearest, printable


class Parser(argparse.ArgumentParser):
    """An `argparse.ArgumentParser` that guesses nothing; the parsers of its commands are of this kind too."""

    def __init__(self, **keywords: Any) -> None:
        super().__init__(**{**keywords, "allow_abbrev": False})
        self.register("action", None, _Once)
        self.register("action", "store", _Once)

    def options(self, arguments: Sequence[str] | None) -> argparse.Namespace:
        """Return the options of a command line; refuse an unknown one, with the nearest known one.

        Their attribute ``given`` holds the names of those that were given, such as ``--seed``.
        """
        arguments = sys.argv[1:] if arguments is None else arguments
        options, rest = self.parse_known_args(arguments)
        if rest:
            self._refuse(getattr(options, "command", ""), rest[0])
        own = takewhile(lambda argument: argument != "--", arguments)
        options.given = frozenset(argument.partition("=")[0] for argument in own if argument.startswith("--"))
        return options

    def error(self, message: str) -> NoReturn:
        """Print how the command is used, and a message that quotes at most a line of a value; exit with status 2."""
        super().error(printable(brief(message)))

    def _refuse(self, command: str, argument: str) -> NoReturn:
        parser = self
        for action in self._actions:
            if isinstance(action, argparse._SubParsersAction):
                parser = action.choices.get(command, self)
        if not argument.startswith("-"):
            parser.error(
                f"unexpected argument: {argument} (write all file names together, before or after the options)"
            )
        option = argument.split("=")[0]
        known = [name for name in parser._option_string_actions if name.startswith("--")]
        parser.error(f"unknown option {option}: {nearest(option, known)}")


class _Once(argparse.Action):
    """Keeps a value like ``store``; a second one is refused, because either could be meant."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: object, option: str | None = None
    ) -> None:
        given = vars(namespace).setdefault("_given", {})
        if option is not None and self.dest in given:
            raise argparse.ArgumentError(self, f"is given twice, as {given[self.dest]} and as {values}: give it once")
        given[self.dest] = values
        setattr(namespace, self.dest, values)


def refuse(options: argparse.Namespace, names: Iterable[str], why: str) -> None:
    """Refuse options that would have no effect.

    Parameters
    ----------
    options
        Those of the command.
    names
        The names of those without effect, such as ``--port``.
    why
        The rest of the sentence that begins with the name.

    Raises
    ------
    InputError
        One of them was given.
    """
    for name in names:
        if name in options.given:
            raise InputError(f"{name} {why}")


class Lazy:
    """The choices of an option that are found only when they are asked for."""

    def __init__(self, find: Callable[[], Iterable[str]]) -> None:
        self._find = find

    def __iter__(self) -> Iterator[str]:
        return iter(self._find())

    def __contains__(self, choice: object) -> bool:
        return choice in list(self._find())
