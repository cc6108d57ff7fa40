"""A moving picture in a file of Pillow: GIF or animated PNG, in 128 colours."""

from __future__ import annotations

import io
import itertools
from pathlib import Path

from PIL import Image

from cosim.errors import InputError
from cosim.export.film import STAYS, film_of, frames_of
from cosim.export.formats import Options
from cosim.results.files import replacing
from cosim.results.result import Result

_FASTEST = 50
"""Frames per second of GIF, above which players take their own time."""


def write(result: Result, path: Path, options: Options) -> None:
    """Write the picture, which begins again when it has ended.

    Raises
    ------
    InputError
        The options make no sense.
    OutputError
        The file cannot be written.
    """
    film = film_of(result, options)
    gif = path.suffix.lower() == ".gif"
    if gif and film.fps > _FASTEST:
        raise InputError(f"GIF has at most {_FASTEST} frames per second, not {film.fps:g}")
    frames = list(frames_of(result, film))
    # The last frame has the whole of all paths; this method keeps white nearly white.
    palette = frames[-1].quantize(128, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    first, *others = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
    ends = [1000 / film.fps * number for number in range(len(frames))]
    if gif:  # counts hundredths of a second
        ends = [10 * round(end / 10) for end in ends]
    durations = [end - begin for begin, end in itertools.pairwise(ends)] + [1000 * STAYS]
    picture = io.BytesIO()
    first.save(
        picture,
        "GIF" if gif else "PNG",
        save_all=True,
        append_images=others,
        duration=durations if others else durations[0],
        loop=0,
    )
    with replacing(path) as file:
        file.write(picture.getbuffer())
