"""``formation export``: a finished run as files of other tools, from its result."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from cosim.cli.console import out, safe
from cosim.errors import InputError
from cosim.export.formats import export_result, format_of, usable
from cosim.quantity import quantity
from cosim.results.files import load_result, writable_file
from cosim.results.result import Result


def export(options: argparse.Namespace) -> int:
    """Write a result in each format that is asked for."""
    paths: list[Path] = options.out or [_usual_place(options.result)]
    for path in paths:
        format_of(path)
        writable_file(path, "--out")
    film: dict[str, Any] = {
        "begin": _seconds(options.begin, "--from"),
        "end": _seconds(options.end, "--to"),
        "speed": options.speed,
        "fps": options.fps,
        "size": _size(options.size),
    }
    result = _load(options.result)
    for path in paths:
        export_result(result, path, options.start_time, **film)
        out().print(safe(f"{path}: {format_of(path).about}"), soft_wrap=True)
    return 0


def _usual_place(result: Path) -> Path:
    return (result if result.is_dir() else result.parent) / "result.mcap"


def _load(path: Path) -> Result:
    result = Result.of(load_result(path))
    try:
        return usable(result)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _seconds(text: str | None, option: str) -> float | None:
    if text is None:
        return None
    try:
        return quantity(text, "s")
    except ValueError as error:
        raise InputError(f"{option}: {error}") from None


def _size(text: str) -> tuple[int, int]:
    width, cross, height = text.lower().partition("x")
    if not (cross and width.isascii() and width.isdigit() and height.isascii() and height.isdigit()):
        raise InputError(f'--size "{text}" is no size: expected width and height in pixels, such as 800x450')
    return int(width[:6]), int(height[:6])
