"""Moving pictures of a run: frames to scale, files that others read, options that make no sense."""

import os
import stat
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import cosim
from cosim.cli import main
from cosim.errors import InputError, OutputError
from cosim.export.film import STAYS, _pale, _Scene, film_of, frames_of
from cosim.export.formats import Options
from cosim.results.files import save
from cosim.results.outlines import outlined_vehicles
from cosim.results.result import Result
from cosim.results.sight import desired_points, sight_points
from cosim.vehicle.outline import placed

SMALL = {"size": (320, 180), "fps": 5.0, "speed": 1.0}


@pytest.fixture(scope="module")
def mixed(scenarios: Path) -> Result:
    return Result.of(cosim.run(scenarios / "mixed_team.xml", horizon=2.0, expectations=False))


def test_robots_are_where_their_outlines_are(mixed: Result) -> None:
    """The middles of bodies have the colours of their robots, and the ground beside them has not."""
    film = film_of(mixed, Options(size=(640, 360), fps=5.0, speed=1.0))
    scene = _Scene(mixed, film)
    frames = [scene.frame(number) for number in range(len(film.samples))]
    number = len(frames) - 1
    pixels = np.asarray(frames[number]).astype(int)
    for row, (name, own) in enumerate(outlined_vehicles(mixed).items()):
        colour, pale = np.array(scene.colours[row]), np.array(_pale(scene.colours[row], row))
        corners = placed(own.outline, own.within(film.samples[number : number + 1]).pose)
        for part, (points,) in zip(own.outline, corners, strict=True):
            if part.collides:
                for x, y in scene.view.pixels(points) / 2:
                    near = pixels[max(round(y) - 2, 0) : round(y) + 3, max(round(x) - 2, 0) : round(x) + 3]
                    edge, hidden = (np.abs(near - one).sum(axis=-1) for one in (colour, pale))
                    assert (edge < 120).any() or (row and (hidden < 20).all()), (name, part.name)
    assert (pixels[2, 2] == 255).all()


def test_frames_follow_speed_and_span(mixed: Result) -> None:
    film = film_of(mixed, Options(begin=0.5, end=1.5, speed=0.5, fps=10.0))
    assert mixed["time"].values[film.samples[[0, -1]]].tolist() == pytest.approx([0.5, 1.5])
    assert len(film.samples) == 21
    assert np.diff(mixed["time"].values[film.samples]) == pytest.approx(0.05, abs=0.011)
    usual = film_of(mixed, Options())
    assert 8 < len(usual.samples) / usual.fps < 16


def test_frames_of_a_result_that_lacks_samples_are_at_their_times(mixed: Result) -> None:
    time = mixed["time"].values
    thinned = mixed.within(np.r_[0:20, 20 : len(time) : 10])
    film = film_of(thinned, Options(speed=1.0, fps=5.0))
    assert thinned["time"].values[film.samples].tolist() == pytest.approx(np.arange(0.0, 2.1, 0.2).tolist())


def test_desired_places_are_those_of_the_errors(mixed: Result) -> None:
    desired, leader = desired_points(mixed), mixed["leader_pose"].values[:, np.newaxis, :2]
    assert np.hypot(*np.moveaxis(leader - desired, -1, 0)) == pytest.approx(mixed["desired_range"].values)
    assert np.hypot(*np.moveaxis(leader - sight_points(mixed), -1, 0)) == pytest.approx(mixed["range"].values)


@pytest.mark.parametrize("fps", [12.0, 30.0, 40.0])
def test_a_gif_plays_as_fast_as_it_says(mixed: Result, tmp_path: Path, fps: float) -> None:
    """GIF counts hundredths of a second, which is no whole number of frames here."""
    cosim.export_result(mixed, tmp_path / "a.gif", **SMALL | {"fps": fps, "speed": 0.2})
    with Image.open(tmp_path / "a.gif") as picture:
        shown = 0
        for number in range(picture.n_frames):
            picture.seek(number)
            shown += picture.info["duration"]
    film = film_of(mixed, Options(**SMALL | {"fps": fps, "speed": 0.2}))
    assert shown - 1000 * STAYS == pytest.approx(1000 * (len(film.samples) - 1) / fps, abs=10)


@pytest.mark.parametrize(("suffix", "kind"), [(".gif", "GIF"), (".png", "PNG")])
def test_a_file_holds_all_frames_and_begins_again(mixed: Result, tmp_path: Path, suffix: str, kind: str) -> None:
    path = tmp_path / f"a{suffix}"
    cosim.export_result(mixed, path, **SMALL)
    with Image.open(path) as picture:
        assert picture.format == kind
        assert picture.size == (320, 180)
        assert picture.n_frames == 11
        assert picture.info["loop"] == 0
        seen = []
        for number in range(picture.n_frames):
            picture.seek(number)
            seen.append(np.asarray(picture.convert("RGB")).astype(int))
        assert picture.info["duration"] >= 1500
    drawn = [np.asarray(frame).astype(int) for frame in frames_of(mixed, film_of(mixed, Options(**SMALL)))]
    for shown, meant in zip(seen, drawn, strict=True):
        assert np.abs(shown - meant).mean() < 3
    assert np.abs(seen[0] - seen[-1]).mean() > 1


def test_a_failed_run_and_one_of_an_earlier_version(mixed: Result, tmp_path: Path) -> None:
    poses = mixed["pose"].values.copy()
    poses[60:] = np.nan
    failure = '{"robot": "car_1", "time": 1.2, "variable": "", "message": "it diverged"}'
    attrs = {**mixed.attrs, "failure": failure, "status": "incomplete"}
    data_vars = {**mixed.data_vars, "pose": replace(mixed["pose"], values=poses)}
    coords = {name: one for name, one in mixed.coords.items() if not name.startswith(("outline_", "vehicle_"))}
    for number, samples in enumerate((slice(None), slice(1))):
        cosim.export_result(Result(data_vars, coords, attrs).within(samples), tmp_path / f"{number}.gif", **SMALL)
        assert (tmp_path / f"{number}.gif").read_bytes().startswith(b"GIF89a")


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"begin": 1.0, "end": 9.0}, "from 1 s to 9 s is not within the result, which has 0 s to 2 s"),
        ({"begin": 2.0, "end": 1.0}, "from 2 s to 1 s is not within"),
        ({"begin": float("nan")}, "is not within the result"),
        ({"speed": 0.0}, "the speed 0 is not greater than zero"),
        ({"speed": float("nan")}, "the speed nan is not greater"),
        ({"fps": -1.0}, "the fps -1 is not greater than zero"),
        ({"fps": 60.0}, "GIF has at most 50 frames per second"),
        ({"speed": 1e-9}, "frames, more than 3000"),
        ({"size": (10, 99999)}, "the size 10x99999 is not between 64 and 4096"),
    ],
)
def test_options_that_make_no_sense(mixed: Result, tmp_path: Path, options: dict, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        cosim.export_result(mixed, tmp_path / "a.gif", **options)
    assert not list(tmp_path.iterdir())


def test_the_command_line(mixed: Result, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save(mixed, tmp_path / "result.nc")
    command = ["export", str(tmp_path), "--out", str(tmp_path / "a.gif"), "--from", "0.5 s", "--to", "1500 ms"]
    assert main([*command, "--speed", "1", "--fps", "4", "--size", "200x120"]) == 0
    with Image.open(tmp_path / "a.gif") as picture:
        assert (picture.size, picture.n_frames) == ((200, 120), 5)
    for wrong, sentence in (
        (["--from", "0.5"], "--from: "),
        (["--to", "3 m"], "--to: "),
        (["--size", "200"], '--size "200" is no size: expected width and height in pixels, such as 800x450'),
    ):
        assert main(["export", str(tmp_path), "--out", str(tmp_path / "b.gif"), *wrong]) == 2
        assert sentence in capsys.readouterr().err


# Films ------------------------------------------------------------------------------------------------------


def encoder(folder: Path, program: str) -> None:
    """Put a program named ffmpeg into a folder."""
    path = folder / "ffmpeg"
    path.write_text(f"#!{sys.executable}\nimport sys\n{program}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)


@pytest.mark.skipif(os.name != "posix", reason="the encoder is a script")
def test_a_film_is_what_the_encoder_makes_of_all_frames(
    mixed: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    encoder(tmp_path, "open(sys.argv[-1], 'wb').write(b'film' + sys.stdin.buffer.read())")
    monkeypatch.setenv("PATH", str(tmp_path))
    cosim.export_result(mixed, tmp_path / "a.mp4", **SMALL)
    frames = [frame.tobytes() for frame in frames_of(mixed, film_of(mixed, Options(**SMALL)))]
    assert (tmp_path / "a.mp4").read_bytes() == b"film" + b"".join(frames)
    with pytest.raises(InputError, match="321x180 is odd"):
        cosim.export_result(mixed, tmp_path / "b.mp4", size=(321, 180))


@pytest.mark.skipif(os.name != "posix", reason="the encoder is a script")
@pytest.mark.parametrize("read", ["", "sys.stdin.buffer.read(); "])
def test_an_encoder_that_fails(mixed: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, read: str) -> None:
    encoder(tmp_path, f"{read}print('no such codec', file=sys.stderr); sys.exit(3)")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(OutputError, match="ffmpeg ended with status 3: no such codec"):
        cosim.export_result(mixed, tmp_path / "a.mp4", **SMALL)
    assert not (tmp_path / "a.mp4").exists()


def test_a_missing_encoder(mixed: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InputError, match="needs the program ffmpeg, which is not on the PATH: install it"):
        cosim.export_result(mixed, tmp_path / "a.mp4", **SMALL)
