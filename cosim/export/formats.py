"""The formats in which a result can be exported, by the ending of a file's name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from cosim.errors import InputError
from cosim.moments import SECOND, nanoseconds_of
from cosim.results.form import in_form
from cosim.results.result import Result

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class Options:
    """What the user chose, besides result and file.

    Attributes
    ----------
    start : int
        Time of the run's start, as nanoseconds since 1970; 0: times are those of the run.
    begin, end : float or None
        The part of the run that a moving picture shows [s]; None: from the start, to the end.
    speed : float or None
        Seconds of the run in a second of the picture; None: as many as let it last about 12 s.
    fps : float
        Frames in a second of the picture.
    size : tuple of int
        Width and height of the picture [px].
    """

    start: int = 0
    begin: float | None = None
    end: float | None = None
    speed: float | None = None
    fps: float = 20.0
    size: tuple[int, int] = (800, 450)


@dataclass(frozen=True)
class Format:
    """A format.

    Attributes
    ----------
    about : str
        The format and who reads it, in a few words.
    module : str
        Its module, whose function ``write(result, path, options)`` writes the file whole or not at all. It is imported
        when it is needed.
    dated : bool
        Whether its times can be those of a clock, which the option ``start`` sets.
    moving : bool
        Whether it is a moving picture, of which the other options are.
    """

    about: str
    module: str
    dated: bool = False
    moving: bool = False


FORMATS: Mapping[str, Format] = {
    ".mcap": Format("ROS 2 messages, for Foxglove, PlotJuggler, RViz and ros2 bag", "cosim.export.mcap", dated=True),
    ".csv": Format("a wide table with units, for spreadsheets and pandas", "cosim.export.csv"),
    ".mat": Format("structs, for MATLAB, Octave and SciPy", "cosim.export.mat"),
    ".gif": Format("a moving picture, for pages and slides", "cosim.export.animated", moving=True),
    ".png": Format("a moving picture (APNG), for browsers", "cosim.export.animated", moving=True),
    ".mp4": Format("a film, made by ffmpeg", "cosim.export.mp4", moving=True),
}
"""The formats, by the ending of the file's name."""


def export_result(
    result: xr.Dataset | Result,
    path: str | Path,
    start_time: float | str = 0.0,
    *,
    begin: float | None = None,
    end: float | None = None,
    speed: float | None = None,
    fps: float = 20.0,
    size: tuple[int, int] = (800, 450),
) -> None:
    """Write a result as a file of another tool.

    Parameters
    ----------
    result
        The result of a run.
    path
        The file; the ending of its name, such as ``.mcap``, ``.csv`` or ``.gif``, states the format.
    start_time
        Time of the run's start for formats with clock time (``.mcap``): seconds since 1970, or a date such as
        ``2026-05-04T09:30:00Z``; 0: times are those of the run.
    begin, end
        The part of the run that a moving picture (``.gif``, ``.png``, ``.mp4``) shows [s]; by default all of it.
    speed
        Seconds of the run in a second of the picture; by default as many as let it last about 12 s.
    fps, size
        Frames in a second of the picture, and its width and height [px].

    Raises
    ------
    InputError
        There is no such format or time, a package is not installed, the result is not that of a run, or it does not fit
        into the format.
    OutputError
        The file cannot be written.
    """
    path = Path(path)
    module = import_module(format_of(path).module)
    options = Options(_start(start_time), begin, end, speed, fps, size)
    module.write(_with_samples(in_form(Result.of(result))), path, options)


def _start(moment: float | str) -> int:
    try:
        start = nanoseconds_of(moment)
    except (ValueError, OverflowError):
        raise InputError(
            f"the start time {moment} is none: expected a date with a time, such as 2026-05-04T09:30:00Z, or seconds "
            "since 1970"
        ) from None
    if not 0 <= start < 2**31 * SECOND:
        raise InputError(f"the start time {moment} is not within those of ROS, from 1970 to 2038")
    return start


def format_of(path: Path) -> Format:
    """Return the format of a file, by the ending of its name.

    Raises
    ------
    InputError
        There is none of this ending.
    """
    if (found := FORMATS.get(path.suffix.lower())) is None:
        known = "; ".join(f"{suffix}: {one.about}" for suffix, one in FORMATS.items())
        raise InputError(f"{path}: the ending of the name states the format, one of these: {known}")
    return found


def _with_samples(result: Result) -> Result:
    if not result.sizes["time"]:
        raise InputError("the result holds no sample, so there is nothing to export")
    return result
