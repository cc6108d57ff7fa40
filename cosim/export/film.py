"""The frames of a moving picture: the robots of a run from above, to scale.

Frames are drawn at twice their size and reduced. Whatever stays is drawn once, and a path grows on that ground from
frame to frame, so that a frame costs its robots alone.
"""

from __future__ import annotations

import colorsys
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from cosim.errors import InputError, printable
from cosim.export.formats import Options
from cosim.results.colours import BAD, COLOURS
from cosim.results.drawable_part import drawable
from cosim.results.outlines import outlined_vehicles
from cosim.results.provenance import Provenance
from cosim.results.result import Result
from cosim.results.sight import desired_points, sight_points
from cosim.scenario.scenario import LEADER
from cosim.vehicle.outline import placed

Floats = NDArray[np.float64]
Colour = tuple[int, int, int]

MOST_FRAMES = 3000
LASTS = 12.0
"""A picture whose speed is not given lasts about so long [s]."""
STAYS = 1.5
"""How long the last frame of a picture stays that begins again [s]."""
_SIZES = (64, 4096)
_TWICE = 2
_MARGIN, _FOOT = 1.2, 30
"""Around the paths [m], and below for time and scale [px]."""
_MOST_NAMED, _MOST_DETAILED = 12, 60
"""Followers whose names are written, and who are drawn with lines of sight, desired places and wheels."""
_BLACK, _GREY, _FAINT, _GRID = (28, 33, 38), (140, 148, 156), (205, 210, 215), (232, 235, 238)
_WHITE = (255, 255, 255)


@dataclass(frozen=True)
class Film:
    """When the frames of a picture are, and how large.

    Attributes
    ----------
    samples : ndarray
        The sample of the result that each frame shows, (frames,).
    speed : float
        Seconds of the run in a second of the picture.
    fps : float
        Frames in a second of the picture.
    size : tuple of int
        Width and height of a frame [px].
    """

    samples: NDArray[np.int_]
    speed: float
    fps: float
    size: tuple[int, int]


def film_of(result: Result, options: Options) -> Film:
    """Return the frames that are asked for.

    Raises
    ------
    InputError
        They make no sense, or are too many.
    """
    time = result["time"].values
    start = float(time[0]) if options.begin is None else options.begin
    stop = float(time[-1]) if options.end is None else options.end
    if not time[0] <= start <= stop <= time[-1] + 1e-9:
        whole = f"{time[0]:.12g} s to {time[-1]:.12g} s"
        raise InputError(f"a picture from {start:.12g} s to {stop:.12g} s is not within the result, which has {whole}")
    if not all(_SIZES[0] <= side <= _SIZES[1] for side in options.size):
        width, height = options.size
        raise InputError(f"the size {width}x{height} is not between {_SIZES[0]} and {_SIZES[1]} pixels a side")
    speed = options.speed if options.speed is not None else _usual_speed(stop - start)
    for name, number in (("speed", speed), ("fps", options.fps)):
        if not (math.isfinite(number) and number > 0):
            raise InputError(f"the {name} {number:g} is not greater than zero")
    frames = math.floor((stop - start) / speed * options.fps + 1e-9) + 1
    if frames > MOST_FRAMES:
        raise InputError(
            f"that makes {frames} frames, more than {MOST_FRAMES}: choose more speed, less fps or a shorter part"
        )
    moments = np.append(start + np.arange(frames) * (speed / options.fps), stop)
    samples = np.round(np.interp(moments, time, np.arange(len(time)))).astype(int)  # the nearest ones
    return Film(samples if samples[-1] > samples[-2] else samples[:-1], speed, options.fps, options.size)


def _usual_speed(span: float) -> float:
    """Return a round speed at which a picture lasts about as long as people look at one."""
    wanted = max(span / LASTS, 1e-3)
    power = 10.0 ** math.floor(math.log10(wanted))
    return min((factor * power for factor in (1, 2, 3, 5, 8, 10)), key=lambda speed: abs(math.log(speed / wanted)))


def frames_of(result: Result, film: Film) -> Iterator[Image.Image]:
    """Yield the frames of a run, in RGB."""
    scene = _Scene(drawable(result), film)
    for number in range(len(film.samples)):
        yield scene.frame(number)


class _Scene:
    """The run as it is drawn, in pixels of frames of twice the size."""

    def __init__(self, result: Result, film: Film) -> None:
        self.film = film
        self.result = result
        self.size = (_TWICE * film.size[0], _TWICE * film.size[1])
        self.names = (LEADER, *result.robots)
        self.colours = [_BLACK, *(_colour(row) for row in range(len(result.robots)))]
        self.detailed = len(result.robots) <= _MOST_DETAILED
        self.fonts = [_font(_TWICE * points) for points in (12, 10)]
        self.failure = Provenance.of(result.attrs).failure
        samples = film.samples
        poses = np.concatenate(
            [result["leader_pose"].values[:, np.newaxis, :3], result["pose"].values[..., :3]], axis=1
        )
        self.places, self.headings = poses[samples, :, :2], poses[samples, :, 2]
        shown = poses[samples[0] : samples[-1] + 1, :, :2]
        self.view = _View.of(shown.reshape(-1, 2), self.size)
        self.parts = self._parts()
        self.sights, self.desired = sight_points(result)[samples], desired_points(result)[samples]
        self.ground = self._ground(shown)

    def _parts(self) -> list[list[tuple[Floats, bool]]]:
        """Return for each robot the corners (frames, n, 2) of its parts, and whether each is a body."""
        outlined = outlined_vehicles(self.result)
        found: list[list[tuple[Floats, bool]]] = []
        for name in self.names:
            if name not in outlined:
                found.append([])
                continue
            own = outlined[name].within(self.film.samples)
            corners = placed(own.outline, own.pose)
            found.append([(one, part.collides) for one, part in zip(corners, own.outline, strict=True)])
        return found

    def _ground(self, shown: Floats) -> Image.Image:
        """Draw what stays: the grid, the paths that are still to come, and the scale."""
        image = Image.new("RGB", self.size, _WHITE)
        pen, view = ImageDraw.Draw(image), self.view
        step = _round(70 * _TWICE / view.scale)
        width, height = self.size
        bottom = height - _TWICE * _FOOT
        for line in view.lines(step, 0, width):
            pen.line([(line, 0), (line, bottom)], fill=_GRID, width=2)
        for line in view.lines(step, 1, bottom):
            pen.line([(0, line), (width, line)], fill=_GRID, width=2)
        if self.detailed:
            for row in range(shown.shape[1]):
                _strip(pen, view.pixels(shown[:: max(1, len(shown) // 1000), row]), _FAINT, 2)
        right, y = width - 2 * 12, height - 2 * 9
        pen.line([(right - step * view.scale, y), (right, y)], fill=_BLACK, width=4)
        pen.text((right - step * view.scale - 12, y), f"{step:g} m", fill=_BLACK, font=self.fonts[0], anchor="rm")
        return image

    def frame(self, number: int) -> Image.Image:
        """Draw a frame; frames are asked for in their order."""
        view = self.view
        if number:
            pen = ImageDraw.Draw(self.ground)
            for row, colour in enumerate(self.colours):
                _strip(pen, view.pixels(self.places[number - 1 : number + 1, row]), colour, 3 if self.detailed else 1)
        image = self.ground.copy()
        pen = ImageDraw.Draw(image)
        if self.detailed:
            self._sight_lines(pen, number)
        for row in range(len(self.names)):
            self._robot(pen, number, row)
        self._words(pen, number)
        return image.reduce(_TWICE)

    def _sight_lines(self, pen: ImageDraw.ImageDraw, number: int) -> None:
        leader = self.view.pixels(self.places[number, :1])[0]
        sights, desired = self.view.pixels(self.sights[number]), self.view.pixels(self.desired[number])
        for row, colour in enumerate(self.colours[1:]):
            _strip(pen, np.stack([sights[row], leader]), _GREY, 2)
            x, y = desired[row]
            for cross in ([(x - 9, y), (x + 9, y)], [(x, y - 9), (x, y + 9)]):
                _strip(pen, np.array(cross), colour, 3)

    def _robot(self, pen: ImageDraw.ImageDraw, number: int, row: int) -> None:
        (place,) = self.view.pixels(self.places[number, row : row + 1])
        if not np.isfinite(place).all():
            return
        colour = self.colours[row]
        for corners, body in self.parts[row]:
            points = self.view.pixels(corners[number])
            if np.isfinite(points).all() and (body or self.detailed):
                polygon = [tuple(point) for point in points.tolist()]
                pen.polygon(polygon, fill=_pale(colour, row) if body else colour, outline=colour, width=3)
        if not self.parts[row]:
            ahead = self.headings[number, row]
            turn = ahead + np.array([0.0, 2.5, -2.5])
            tip = place + 14 * np.stack([np.cos(turn), -np.sin(turn)], axis=-1)
            pen.polygon([tuple(point) for point in tip.tolist()], fill=colour)
        if len(self.names) <= _MOST_NAMED + 1:
            pen.text(
                (place[0] + 18, place[1] - 18), printable(self.names[row]), fill=colour, font=self.fonts[1], anchor="ls"
            )

    def _words(self, pen: ImageDraw.ImageDraw, number: int) -> None:
        """Write the time, and in the last frame of a failed run why it ended."""
        time = self.result["time"].values[self.film.samples[number]]
        y = self.size[1] - 2 * 9
        every = self.film.speed / self.film.fps
        words = f"t = {time:.{1 if every >= 0.05 else 2 if every >= 0.005 else 3}f} s"
        pen.text((2 * 10, y), words, fill=_BLACK, font=self.fonts[0], anchor="lm")
        beside = f"{self.film.speed:g} times as fast as real time" if self.film.speed != 1 else ""
        colour = _GREY
        if self.failure is not None and number == len(self.film.samples) - 1:
            beside, colour = printable(str(self.failure))[:100], _rgb(BAD)
        pen.text((2 * 92, y), beside, fill=colour, font=self.fonts[1], anchor="lm")


@dataclass(frozen=True)
class _View:
    """Where the plane lies in a frame: the place [m] of its middle, that middle [px], and pixels a metre."""

    centre: Floats
    middle: Floats
    scale: float

    @classmethod
    def of(cls, places: Floats, size: tuple[int, int]) -> _View:
        """Return a view of all places."""
        places = places[np.isfinite(places).all(axis=1)]
        low, high = (places.min(axis=0), places.max(axis=0)) if len(places) else (np.zeros(2), np.zeros(2))
        room = np.array([size[0], size[1] - _TWICE * _FOOT])
        return cls((low + high) / 2, room / 2, float(np.min(room / (high - low + 2 * _MARGIN))))

    def pixels(self, places: Floats) -> Floats:
        """Return places (n, 2) [m] in pixels; x to the right, y upwards."""
        return np.asarray(self.middle + (places - self.centre) * (self.scale, -self.scale))

    def lines(self, step: float, axis: int, most: int) -> list[float]:
        """Return where the lines of a grid are along an axis, up to a pixel."""
        reach = self.middle[axis] / self.scale
        first = math.ceil((self.centre[axis] - reach) / step)
        last = math.floor((self.centre[axis] + reach) / step)
        sign = -1 if axis else 1
        found = [
            float(self.middle[axis] + sign * (k * step - self.centre[axis]) * self.scale)
            for k in range(first, last + 1)
        ]
        return [line for line in found if 0 <= line <= most]


def _strip(pen: ImageDraw.ImageDraw, points: Floats, colour: Colour, width: int) -> None:
    """Draw a line through points; none where one has no place."""
    finite = np.asarray(np.isfinite(points).all(axis=1))
    if finite.all():
        pen.line([tuple(point) for point in points.tolist()], fill=colour, width=width, joint="curve")
        return
    for number in np.flatnonzero(finite[1:] & finite[:-1]):
        pen.line([tuple(point) for point in points[number : number + 2].tolist()], fill=colour, width=width)


def _colour(row: int) -> Colour:
    """Return the colour of a follower, as on the page."""
    if row < len(COLOURS):
        return _rgb(COLOURS[row])
    red, green, blue = colorsys.hls_to_rgb((row * 137.5) % 360 / 360, 0.52, 0.55)
    return round(255 * red), round(255 * green), round(255 * blue)


def _rgb(text: str) -> Colour:
    red, green, blue = bytes.fromhex(text[1:])
    return red, green, blue


def _pale(colour: Colour, row: int) -> Colour:
    """Return the colour of a body: of the leader, who is none of the team, it is white."""
    part = 0.35 if row else 0.0
    red, green, blue = (round(255 - part * (255 - one)) for one in colour)
    return red, green, blue


def _round(least: float) -> float:
    """Return 1, 2 or 5 times a power of ten that is not less."""
    power = 10.0 ** math.floor(math.log10(least))
    return next(factor * power for factor in (1, 2, 5, 10) if factor * power >= 0.999 * least)


def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Return Matplotlib's own font, which has letters of many languages."""
    from matplotlib import get_data_path

    return ImageFont.truetype(str(Path(get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"), size)
