"""Simulates FMUs with FMPy, each in a process of its own, as some kill or hang their process. Reads and writes JSON.

Imports once and forks for each job, which takes a tenth of the time that new interpreters would.
"""

import faulthandler
import json
import os
import resource
import signal
import sys
import tempfile
import time
from typing import Any

import numpy as np
from fmpy import extract, instantiate_fmu, read_model_description, simulate_fmu
from fmpy.fmi1 import FMICallException


def child(job: dict[str, Any], out: Any) -> None:
    """Simulate an FMU and write the state of the process afterwards."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    description = read_model_description(job["fmu"])
    folder = extract(job["fmu"], job["fmu"] + ".unpacked")
    torque = np.array([(0.0, 1.0), (0.5, 1.0)], [("time", float), ("tau_drive", float)])

    def log(*arguments: Any) -> None:
        print(arguments[-1].decode(), file=out, flush=True)

    fmu = instantiate_fmu(folder, description, logger=log)
    try:
        simulate_fmu(
            folder, model_description=description, fmu_instance=fmu, stop_time=0.5, output_interval=0.1, input=torque
        )
    except FMICallException:
        fmu.terminate()
    fmu.freeInstance()
    json.dump({"cwd": os.getcwd(), "sum": 1.0 + float(job["name"] != "") * 1e-17}, out)
    out.flush()
    if job.get("interrupt"):
        os.kill(os.getpid(), signal.SIGINT)
    if job.get("divide"):
        np.ones(1) / np.zeros(1)


def main() -> None:
    faulthandler.disable()
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    # Those that may spin for ever come last.
    jobs = sorted(json.load(sys.stdin), key=lambda job: bool(job.get("hangs")))
    running = {}
    for job in jobs:
        out = tempfile.TemporaryFile("w+")  # noqa: SIM115
        pid = os.fork()
        if pid == 0:
            null = os.open(os.devnull, os.O_RDWR)
            for descriptor in range(3):
                os.dup2(null, descriptor)
            code = 99
            try:
                child(job, out)
                code = 0
            finally:
                os._exit(code)
        running[pid] = (job, out)
    found = {}

    def ended(pid: int, status: int, killed: bool = False) -> None:
        job, out = running.pop(pid)
        out.seek(0)
        lines = out.read().splitlines()
        said = json.loads(lines.pop()) if lines and lines[-1].startswith("{") else {}
        found[job["name"]] = {"exit": os.waitstatus_to_exitcode(status), "killed": killed, "log": lines, "said": said}

    deadline = time.monotonic() + 60.0
    while running:
        pid, status = os.waitpid(-1, os.WNOHANG)
        if pid:
            ended(pid, status)
        elif all(job.get("hangs") and os.fstat(out.fileno()).st_size for job, out in running.values()):
            break  # those left have logged that they hang
        elif time.monotonic() > deadline:
            break
        else:
            time.sleep(0.01)
    time.sleep(0.2)
    for number in (signal.SIGTERM, signal.SIGKILL):
        for pid in running:
            os.kill(pid, number)
        time.sleep(0.2)
        for pid in list(running):
            dead, status = os.waitpid(pid, os.WNOHANG if number == signal.SIGTERM else 0)
            if dead:
                ended(pid, status, killed=True)
    json.dump(found, sys.stdout)


if __name__ == "__main__":
    main()
