"""What a page shows of one run, as plain data: robots, motion, signals, verdicts, and where it comes from."""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.clock import ROUNDING
from cosim.errors import InputError
from cosim.report.columns import MOST_NUMBERS, Columns, Floats, Rows, extremes, samples_in_bucket
from cosim.results.bands import bands_of_kind, kinds_of
from cosim.results.drawable_part import Part, drawable_parts
from cosim.results.events import events_of
from cosim.results.expectations import Kind
from cosim.results.expectations.recorded import units_by_component
from cosim.results.expectations.shown import Band
from cosim.results.form import has_first_ticks, in_form
from cosim.results.groups import group_of
from cosim.results.json_numbers import without_nan
from cosim.results.outlines import outlines_of
from cosim.results.provenance import Part as RunPart
from cosim.results.provenance import Provenance
from cosim.results.result import Result
from cosim.results.sight import sight_ahead
from cosim.results.summary import PART, Summary, summary_of
from cosim.scenario import in_words
from cosim.scenario.document import parse_document
from cosim.scenario.grammar import named_files
from cosim.scenario.scenario import LEADER
from cosim.storage import blocks, forget

Json: TypeAlias = dict[str, Any]

MOST_POSES = 1_500_000
"""Numbers of the playback of a run."""
_ERRORS = ("range_error", "bearing_error", "range")


def content_of(result: Result, summary: Summary | None = None, *, share: int = 1) -> Json:
    """Return what a page shows of a run.

    Parameters
    ----------
    result
        Its result, of this version or an earlier one, complete or not.
    summary
        Its summary; without it, it is read from the result.
    share
        How many runs share the room of a page.

    Returns
    -------
    dict
        Plain data, without NaN; under ``numbers`` the columns that it refers to, packed (`Columns.packed`).

    Raises
    ------
    InputError
        It is not the result of a run, or it has no sample.
    """
    result = in_form(result)
    summary = summary_of(result) if summary is None else summary
    samples = result.sizes.get("time", 0)
    if not samples:
        raise InputError("the result holds no sample, so there is nothing to show")
    step = float(result.attrs["step"])
    horizon = float(result.attrs["horizon"])
    columns = Columns()
    kinds = kinds_of(result)
    bands = [[band for band in bands_of_kind(kind, result) if band.signal in result] for kind in kinds]
    courses = courses_of(result, columns, share, drawable_parts(result))
    content = {
        "name": summary.scenario,
        "title": summary.title,
        "status": summary.status,
        "passed": summary.passed,
        "failure": _failure(summary),
        "step": step,
        "horizon": horizon,
        "samples": samples,
        "end": summary.end_time,
        "vehicles": _vehicles(result),
        **courses,
        **({} if has_first_ticks(result) else {"sample_times": _sample_times(result, courses)}),
        "verdicts": _verdicts(summary, kinds, bands, result),
        "bands": [
            {**asdict(band), "robots": list(kind.written.robots), "text": kind.text}
            for kind, own in zip(kinds, bands, strict=True)
            for band in own
        ],
        "events": events_told(result, _reached(summary, horizon)),
        "messages": [asdict(message) for message in summary.messages],
        "messages_left_out": summary.messages_left_out,
        "followers": [asdict(figures) for figures in summary.followers],
        "distance": _distances(summary),
        "notes": summary.notes,
        "provenance": _provenance(result, summary),
        "scenario": result.attrs["scenario"],
    }
    return {**without_nan(content), "numbers": columns.packed()}


def events_told(result: Result, until: float) -> list[Json]:
    """Return the events of a run up to a time [s], in words."""
    return [
        {"time": event.time, "robot": event.robot, "text": in_words.event(event)}
        for event in events_of(result)
        if event.time <= until + ROUNDING
    ]


def courses_of(
    result: Result, columns: Columns | Rows, share: int = 1, parts: Mapping[str, Part] | None = None
) -> Json:
    """Return the motion and the signals of a result, or of a part of one, whose numbers are added to columns.

    ``parts`` returns samples of a signal as they are shown; without it, they are shown as they are.
    """
    if parts is None:
        parts = {name: signal.values.__getitem__ for name, signal in result.data_vars.items()}
    return {
        "motion": _motion(result, parts, columns, MOST_POSES // share),
        "signals": _signals(result, parts, columns, MOST_NUMBERS // share),
    }


# Robots and their motion ------------------------------------------------------------------------------------


def _vehicles(result: Result) -> list[Json]:
    """Return the leader and the followers, each with the parts of its outline; an earlier result has no outlines."""
    outlines = outlines_of(result)
    return [
        {
            "id": robot,
            "kind": _text(result, "vehicle_kind", row),
            "pose": _pose_entries(result, row),
            "ahead": sight_ahead(result, row),
            "parts": [asdict(part) for part in outlines.get(robot, ())],
        }
        for row, robot in enumerate((LEADER, *result.robots))
    ]


def _text(result: Result, name: str, row: int) -> str:
    return str(result[name].values[row]) if name in result else ""


def _pose_entries(result: Result, row: int) -> list[str]:
    """Return the names of a vehicle's pose entries, empty for columns that it does not have."""
    names = result["pose_name"].values[row] if "pose_name" in result else result["pose_component"].values
    return [str(name) for name in names]


def _motion(result: Result, parts: Mapping[str, Part], columns: Columns | Rows, most: int) -> Json:
    """Return poses and errors of place at evenly spaced samples, the last one among them."""
    samples, robots = result.sizes["time"], range(len(result.robots))
    entries = result.sizes["pose_component"]
    width = (1 + len(robots)) * entries + len(robots) * len(_ERRORS)
    every = max(1, math.ceil(samples * width / most))
    chosen = _spaced(samples, every)
    leader, poses = _at(chosen, parts["leader_pose"]), _at(chosen, parts["pose"])
    errors = [_at(chosen, parts[name]) for name in _ERRORS if name in result]
    return {
        "every": every,
        "samples": len(chosen),
        "poses": [
            [columns.add(one[:, k]) for k in range(entries)] for one in (leader, *(poses[:, robot] for robot in robots))
        ],
        "errors": [[columns.add(one[:, robot]) for one in errors] for robot in robots],
    }


def _spaced(samples: int, every: int) -> NDArray[np.intp]:
    """Return evenly spaced samples, and the last one."""
    return np.unique(np.append(np.arange(0, samples, every), samples - 1))


def _at(chosen: NDArray[np.intp], part: Part) -> Floats:
    """Return the chosen samples of a signal, which may lie far apart in a large file."""
    ends = np.searchsorted(chosen, [block.stop for block in blocks(int(chosen[-1]) + 1)])
    found = []
    for some in np.split(chosen, ends[:-1]):
        found.append(part(some))
        forget()
    return np.concatenate(found)


def _sample_times(result: Result, courses: Json) -> dict[str, list[float]]:
    """Return the times of motion and signals [s], which the page cannot count as samples are left out.

    The two extremes of a bucket of samples are shown a quarter of it from its ends, as the page has them.
    """
    time = result["time"].values
    last, bucket = len(time) - 1, courses["signals"]["bucket"]
    places = np.arange(float(len(time)))
    if bucket > 1:
        places = np.minimum((np.arange(2.0 * -(-len(time) // bucket)) / 2 + 0.25) * bucket, last)
    before = places.astype(np.intp)
    after = np.minimum(before + 1, last)
    return {
        "motion": time[_spaced(len(time), courses["motion"]["every"])].tolist(),
        "signals": (time[before] + (places - before) * (time[after] - time[before])).tolist(),
    }


# Signals ----------------------------------------------------------------------------------------------------


def _signals(result: Result, parts: Mapping[str, Part], columns: Columns | Rows, most: int) -> Json:
    """Return all signals over time; of many samples the extremes of each bucket of them."""
    names = [name for name, signal in result.data_vars.items() if signal.dims[:1] == ("time",)]
    width = sum(math.prod(result[name].values.shape[1:]) for name in names)
    size = samples_in_bucket(result.sizes["time"], width, most)
    return {"bucket": size, "list": [_signal(result, name, parts[name], size, columns) for name in names]}


def _signal(result: Result, name: str, part: Part, size: int, columns: Columns | Rows) -> Json:
    signal = result[name]
    robots = result.robots if "robot" in signal.dims else (LEADER,)
    labels = result.components(name)
    units = units_by_component(labels, str(signal.attrs.get("units", "")))
    count = len(robots) * len(labels)

    def courses_in(some: slice) -> Floats:
        values = part(some)
        return values.reshape(len(values), count)

    courses = extremes(courses_in, len(signal.values), size)
    return {
        "name": name,
        "about": str(signal.attrs.get("long_name", name)),
        "group": group_of(name, signal.attrs),
        "components": [{"name": label, "unit": units[label]} for label in labels],
        "robots": list(robots),
        "columns": [
            [columns.add(courses[:, row * len(labels) + k]) for k in range(len(labels))] for row in range(len(robots))
        ],
    }


# Verdicts ---------------------------------------------------------------------------------------------------


def _verdicts(summary: Summary, kinds: Sequence[Kind], bands: Sequence[Sequence[Band]], result: Result) -> list[Json]:
    """Return the verdicts, each with the time and the signals at which a reader sees why."""
    having = kinds if summary.verdicts else ()
    moments = {(kind.text, robot): time for kind in having for robot, time in kind.moments(result).items()}
    signals = {
        kind.text: [[band.signal, band.component] for band in own] for kind, own in zip(kinds, bands, strict=True)
    }
    return [
        {
            **{name: value for name, value in asdict(verdict).items() if name != "where"},
            "moment": moments.get((verdict.expectation, verdict.robot)),
            "signals": signals.get(verdict.expectation, []),
        }
        for verdict in summary.verdicts
    ]


# Where it comes from ----------------------------------------------------------------------------------------


def _reached(summary: Summary, horizon: float) -> float:
    """Return up to when the run came [s], of which the result may have less."""
    failure = summary.provenance.failure
    if failure is not None:
        return max(summary.end_time, failure.time)
    return horizon if summary.status == PART else summary.end_time


def _failure(summary: Summary) -> Json | None:
    failure = summary.provenance.failure
    if failure is None and summary.status not in ("completed", PART):
        return {"robot": "", "time": summary.end_time, "text": f"it was recorded up to {summary.end_time:.12g} s"}
    return None if failure is None else {"robot": failure.robot, "time": failure.time, "text": str(failure)}


def _distances(summary: Summary) -> list[Json]:
    found = (
        ("reference points", summary.smallest_distance, summary.smallest_distance_between),
        ("bodies", summary.smallest_distance_of_bodies, summary.smallest_distance_of_bodies_between),
    )
    return [
        {"of": of, "distance": distance, "between": between}
        for of, distance, between in found
        if distance is not None and between is not None
    ]


def _provenance(result: Result, summary: Summary) -> Json:
    told = summary.provenance
    return {
        "file": told.file,
        "changes": told.changes,
        "seed": None if told.seed is None else str(told.seed),  # JavaScript rounds numbers above 2**53
        "versions": told.versions,
        "command": "" if "recording" in result.attrs else _command(told, summary.scenario),
        "resumed": told.resumed,
        "before": [f"{part.until:.12g} s: {' '.join(part.changes) or 'unchanged'}" for part in _other_parts(told)],
        "given": {robot: list(times) for robot, times in told.given.items()},
        "files": _files(result),
        "recording": _recording(result),
        "plants": _plants(result),
        "controllers": _controllers(result),
    }


def _other_parts(told: Provenance) -> list[RunPart]:
    """Return the parts of a run that had other changes than its last one."""
    return [part for part in told.parts if part.changes != told.changes]


def _files(result: Result) -> dict[str, str | None]:
    """Return the checksum of each file that the scenario names; None where the result, an older one, has it not."""
    told = _loaded(result, "files")
    if isinstance(told, dict):
        return {str(name): str(checksum) for name, checksum in told.items()}
    try:
        root = parse_document(result.attrs["scenario"], Path("scenario")).root
    except InputError:
        return {}
    return dict.fromkeys(named_files(root))


def _recording(result: Result) -> str:
    """Return the recording that was judged, and from where on; empty for a run."""
    told = result.attrs
    return f"{told['recording']} from {told.get('recording_start', 0)} s" if "recording" in told else ""


def _command(told: Provenance, scenario: str) -> str:
    """Return the command that repeats a run, or the last part of one that branched off; empty if none does."""
    if told.given:
        return ""
    changes, begin = told.changes, ["formation", "run", Path(told.file).name or f"{scenario}.xml"]
    branched = _other_parts(told)
    if branched:
        if not branched[-1].run:  # by a program, or an older version
            return ""
        begin = ["formation", "resume", branched[-1].run, "--at", f"{branched[-1].until:.12g} s"]
        changes = changes[len(branched[-1].changes) :]
    return " ".join((shlex.join(begin), *changes))


def _plants(result: Result) -> Json:
    """Return file, version of FMI and checksum of each plant."""
    told = _loaded(result, "plants")
    plants = told.items() if isinstance(told, dict) else ()
    return {
        name: {key: str(plant.get(key, "unknown")) for key in ("file", "fmi_version", "sha256")}
        for name, plant in plants
        if isinstance(plant, dict)
    }


def _environment(versions: object) -> str:
    """Return the versions of a controller's own environment in words; empty without one."""
    return ", ".join(f"{name} {version}" for name, version in versions.items()) if isinstance(versions, dict) else ""


def _controllers(result: Result) -> list[Json]:
    """Return the controllers, each with its robots."""
    told = _loaded(result, "controllers")
    return [
        {
            **{key: str(law.get(key, "unknown")) for key in ("name", "package", "version")},
            "files": str(law.get("files", "")),
            "robots": [str(robot) for robot in law.get("robots") or ()],
            "environment": _environment(law.get("environment")),
        }
        for law in (told if isinstance(told, list) else ())
        if isinstance(law, dict)
    ]


def _loaded(result: Result, name: str) -> Any:
    try:
        return json.loads(result.attrs.get(name, "null"))
    except (TypeError, ValueError, RecursionError):  # of another program
        return None
