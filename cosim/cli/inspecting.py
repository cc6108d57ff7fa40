"""``formation inspect``: an FMU's content, its capabilities, and the kinds of vehicle that it could be."""

from __future__ import annotations

import argparse

from cosim.beside import beside
from cosim.cli.options import refuse
from cosim.collection import without_collection
from cosim.fmu.package import open_package


@without_collection()
def inspect(options: argparse.Namespace) -> int:
    """Print the description of an FMU and its possible uses, or replay its reference experiments."""
    if options.self_test:
        from cosim.cli.self_testing import self_test

        return self_test(options.fmu, options.time_limit, strict=options.strict, every=options.all)
    refuse(options, ("--time-limit",), "is about the reference experiments: add --self-test, or leave it out")
    with beside(open_package, options.fmu) as opened:
        from cosim.cli.fmu_content import print_content  # takes long, while a large file is parsed

        package = opened()
    try:
        print_content(package, strict=options.strict, every=options.all)
    finally:
        package.close()
    return 0
