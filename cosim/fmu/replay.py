"""One experiment of an FMU in a process of its own: ``python -m cosim.fmu.replay FOLDER``, which `self_test` starts.

FMPy drives the FMU, as any other importer might. The folder has a request in JSON, and is given the results as numbers,
or a sentence that names the failure.
"""

from __future__ import annotations

import json
import os
import sys
from collections import deque
from pathlib import Path
from typing import TypedDict

from cosim import process_tree

REQUEST, RESULT, FAILURE = "request.json", "result.bin", "failure.txt"


class Stimuli(TypedDict):
    """Values of inputs over time: the columns after the time, and the rows."""

    columns: list[str]
    rows: list[list[float]]


class Request(TypedDict):
    """The experiment."""

    directory: str
    interface: str
    start: float | None
    stop: float | None
    step: float | None
    tolerance: float | None
    values: dict[str, str]
    stimuli: Stimuli | None
    outputs: dict[str, int]


_SAID = 3
"""Number of the FMU's last messages that are reported when it fails."""


def main() -> None:
    """Run the experiment of the folder that the argument names.

    The FMU is neither freed nor unloaded: some crash then, and the process ends anyway.
    """
    folder = Path(sys.argv[1])
    said: deque[str] = deque(maxlen=_SAID)
    try:
        numbers = _replay(json.loads((folder / REQUEST).read_bytes()), said)
        (folder / RESULT).write_bytes(numbers)
    except Exception as error:  # FMPy raises exceptions of any kind
        why = str(error) or type(error).__name__
        (folder / FAILURE).write_text("; it logged: ".join([why, *(["; ".join(said)] if said else [])]), "utf-8")
    os._exit(0)


def _replay(request: Request, said: deque[str]) -> bytes:
    """Return time and variables, row by row, as doubles."""
    import fmpy
    import numpy as np
    from fmpy.simulation import instantiate_fmu

    def say(*arguments: object) -> None:  # the message comes last, in all versions of FMI
        text = arguments[-1]
        said.append(text.decode("utf-8", "replace") if isinstance(text, bytes) else str(text))

    directory, interface = request["directory"], request["interface"]
    description = fmpy.read_model_description(directory, validate=False)
    stimuli = None
    if request["stimuli"] is not None:
        columns = [("time", np.float64), *((name, np.float64) for name in request["stimuli"]["columns"])]
        stimuli = np.array([tuple(row) for row in request["stimuli"]["rows"]], dtype=columns)
    result = fmpy.simulate_fmu(
        directory,
        model_description=description,
        fmu_instance=instantiate_fmu(directory, description, interface, logger=say),
        fmi_type=interface,
        start_time=request["start"],
        stop_time=request["stop"],
        output_interval=request["step"],
        relative_tolerance=request["tolerance"],
        start_values=request["values"],
        input=stimuli,
        output=list(request["outputs"]),
    )
    recorded = [result["time"].astype(np.float64).reshape(-1, 1)]
    for name, size in request["outputs"].items():
        values = np.asarray(result[name], dtype=np.float64).reshape(len(result), -1)
        if values.shape[1] != size:
            raise ValueError(f"{name} has {values.shape[1]} elements, but {size} in the references")
        recorded.append(values)
    return np.hstack(recorded).tobytes()


if __name__ == "__main__":
    process_tree.adopt()
    main()
