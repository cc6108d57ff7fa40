"""``formation build``: FMUs of the built-in models, to use elsewhere."""

from __future__ import annotations

import argparse

import plants
from cosim.cli.console import out, safe
from cosim.errors import InputError, OutputError


def build(options: argparse.Namespace) -> int:
    """Build the models and print the path of each FMU."""
    for model in options.models or plants.models():
        try:
            path = plants.build(model, fmi=options.fmi, platforms=options.platform, out=options.out)
        except plants.PlantError as error:
            raise InputError(str(error)) from None
        except OSError as error:
            raise OutputError(f"the FMU of {model} cannot be written to {options.out}: {error.strerror}") from None
        out().print(safe(str(path)), soft_wrap=True)
    return 0
