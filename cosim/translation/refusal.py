"""The refusal of Python that has no translation to C."""

from __future__ import annotations

from cosim.errors import InputError, Location


class Untranslatable(InputError):
    """A function is outside of the subset; the message shows the text of the line, and what would be right."""

    def __init__(self, message: str, where: Location | None = None, text: str = "") -> None:
        self.text = text
        super().__init__(f"{message}: {text}" if text else message, where)
