"""A recorded drive under the expectations of a scenario: the file that judged the simulation judges the robots."""

from __future__ import annotations

import json
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from cosim.errors import InputError
from cosim.master.other_runs import run_other
from cosim.master.setup import set_up
from cosim.missing_file import absent
from cosim.moments import nanoseconds_of
from cosim.recordings.drive import Drive, recorded_drive
from cosim.recordings.judging import judged
from cosim.recordings.mapping import Mapping, read_mapping
from cosim.results.json_numbers import without_nan
from cosim.results.summary import Summary, summary_of
from cosim.scenario.reader import read_scenario
from cosim.scenario.scenario import LEADER, Scenario

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True, eq=False)
class JudgedDrive:
    """A recorded drive with the verdicts on it.

    Attributes
    ----------
    drive : Drive
        The drive; the attribute ``verdicts`` of its result has the verdicts.
    summary : Summary
        Its figures and verdicts.
    """

    drive: Drive
    summary: Summary


def judge_recording(
    recording: str | Path,
    scenario: str | Path | Scenario,
    mapping: str | Path | None = None,
    *,
    start: float | str | None = None,
) -> xr.Dataset:
    """Judge a recorded drive by the expectations of a scenario.

    Parameters
    ----------
    recording
        An MCAP file, a ROS 2 bag (its folder, or a ``.db3`` file), a CSV file, or the result of a run.
    scenario
        A scenario, or the path of its file.
    mapping
        The file that says where the recording has the poses; without it, they are looked for by the names that
        `cosim.export_result` gives.
    start
        The time in the recording at which the scenario begins, in place of the mapping's: in seconds, or as a date.

    Returns
    -------
    xarray.Dataset
        The drive at the ticks of the scenario, as a result of it; NaN where the recording has nothing. `summary_of`
        returns the verdicts on it.

    Raises
    ------
    InputError
        The recording, the mapping or the scenario is wrong, or they do not fit.
    """
    return judge_drive(recording, scenario, mapping, start=start).drive.result.dataset


def judge_drive(
    recording: str | Path,
    scenario: str | Path | Scenario,
    mapping: str | Path | None = None,
    *,
    start: float | str | None = None,
) -> JudgedDrive:
    """Judge a recorded drive as `judge_recording` does."""
    path = Path(recording)
    if not path.exists():
        raise InputError(f"the recording {path}: {absent(path)}")
    if not (path.is_file() or path.is_dir()):  # a pipe may never end
        raise InputError(f"the recording {path} is not a regular file")
    read = scenario if isinstance(scenario, Scenario) else read_scenario(scenario)
    robots = {LEADER: None, **{follower.id: None for follower in read.followers}}
    mapped = Mapping() if mapping is None else read_mapping(Path(mapping), robots)
    if start is not None:
        mapped = replace(mapped, start=_moment(start))
    with ExitStack() as ending:
        setup = set_up(read, ending, {})
        drive = recorded_drive(path, read, setup, mapped)
        verdicts = judged(read, setup, drive.result, partial(run_other, setup))
    told = json.dumps(without_nan([asdict(verdict) for verdict in verdicts]))
    result = replace(drive.result, attrs={**drive.result.attrs, "verdicts": told})
    return JudgedDrive(replace(drive, result=result), summary_of(result))


def _moment(start: float | str) -> int:
    try:
        return nanoseconds_of(start)
    except (ValueError, OverflowError):
        raise InputError(
            f"the start {start} is none: expected the time in the recording at which the scenario begins, in seconds "
            "or as a date such as 2026-05-04T09:30:00Z"
        ) from None
