"""A moving picture as MP4 (H.264), by the program ffmpeg, which gets the frames through a pipe."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path

from cosim.errors import InputError, OutputError
from cosim.export.film import film_of, frames_of
from cosim.export.formats import Options
from cosim.results.files import replacing
from cosim.results.result import Result


def write(result: Result, path: Path, options: Options) -> None:
    """Write the picture.

    Raises
    ------
    InputError
        There is no ffmpeg, or the options make no sense.
    OutputError
        The file cannot be written, or ffmpeg failed.
    """
    film = film_of(result, options)
    program = shutil.which("ffmpeg")
    if program is None:
        raise InputError(
            f"{path}: MP4 needs the program ffmpeg, which is not on the PATH: install it, or write .gif or .png"
        )
    width, height = film.size
    if width % 2 or height % 2:
        raise InputError(f"the size {width}x{height} is odd, but MP4 needs even numbers")
    with replacing(path) as file, tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "film.mp4"
        raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{film.fps:g}", "-i", "-"]
        coded = ["-an", "-c:v", "libx264", "-pix_fmt", "yuv420p", "-movflags", "+faststart", str(made)]
        command = [program, "-hide_banner", "-loglevel", "error", "-y", *raw, *coded]
        with (
            tempfile.TemporaryFile() as told,
            subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=told) as process,
        ):
            assert process.stdin is not None
            try:
                for frame in frames_of(result, film):
                    process.stdin.write(frame.tobytes())
                process.stdin.close()
            except BrokenPipeError:
                pass  # its end tells why
            status = process.wait()
            told.seek(0)
            said = told.read().decode(errors="replace").strip().splitlines()
        if status or not made.is_file():
            raise OutputError(f"{path} cannot be written: ffmpeg ended with status {status}: {' '.join(said[-2:])}")
        with made.open("rb") as source:
            shutil.copyfileobj(source, file)
