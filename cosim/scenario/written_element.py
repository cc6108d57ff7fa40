"""An element of a scenario as it is written: its attributes, read as values on demand, and its place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from cosim.errors import InputError, Location
from cosim.quantity import quantity
from plants import units


@dataclass(frozen=True)
class Written:
    """An element as it is written; whom it is for reads its attributes.

    Attributes
    ----------
    kind : str
        The element's name.
    attributes : dict
        Its attributes as they are written, by name.
    where : Location
        Its place.
    folder : Path
        The folder to which its paths are relative.
    """

    kind: str
    attributes: Mapping[str, str]
    where: Location
    folder: Path

    def __contains__(self, name: str) -> bool:
        """Return whether an attribute is given."""
        return name in self.attributes

    def get(self, name: str, default: str = "") -> str:
        """Return an attribute as it is written."""
        return self.attributes.get(name, default)

    def quantity(self, name: str, unit: str | units.Unit) -> float:
        """Return an attribute as a number in a unit.

        Raises
        ------
        InputError
            It is no quantity in a unit that fits, at this place; so do the methods below.
        """
        text = self.get(name)
        try:
            return quantity(text, unit)
        except ValueError as error:
            raise self.error(f'{name}="{text}" of <{self.kind}>: {error}') from None

    def positive(self, name: str, unit: str) -> float:
        """Return an attribute as a number in a unit, which must be greater than zero."""
        value = self.quantity(name, unit)
        if value <= 0:
            raise self.error(f'{name}="{self.get(name)}" of <{self.kind}> must be greater than zero')
        return value

    def not_negative(self, name: str, unit: str) -> float:
        """Return an attribute as a number in a unit, which must not be negative."""
        value = self.quantity(name, unit)
        if value < 0:
            raise self.error(f'{name}="{self.get(name)}" of <{self.kind}> must not be negative')
        return value

    def path(self, name: str) -> Path:
        """Return an attribute that is a path."""
        return (self.folder / self.get(name)).absolute()

    def error(self, message: str) -> InputError:
        """Return an error at this place."""
        return InputError(message, self.where)
