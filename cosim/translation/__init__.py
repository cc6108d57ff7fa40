"""Compiled functions of a restricted Python become readable C with the same bits; it knows no law and no effect.

`translate` takes Python functions with example arguments, from which all types follow, and returns a header and a
source file in C11. What lies outside of the subset is refused by `Untranslatable`, with file, line and a way out.
"""

from cosim.translation.refusal import Untranslatable
from cosim.translation.unit import CSource, Entry, translate

__all__ = ["CSource", "Entry", "Untranslatable", "translate"]
