"""FMUs of ours as others might have made them: with another model description around the same binary."""

import zipfile
from pathlib import Path

import plants

NAMES = {
    "x": "Chassis.rearAxle.x",
    "y": "Chassis.rearAxle.y",
    "psi": "Chassis.yaw",
    "gamma": "Steering.angle",
    "v": "Chassis.speed",
    "omega": "Steering.rate",
    "tau_drive": "Driveline.torque",
    "tau_steer": "Steering.torque",
    "a": "Chassis.wheelbase",
    "m_c": "Chassis.mass",
    "tau_d_y": "Wind.force",
}


def rewritten(fmu: Path, target: Path, *pairs: tuple[str, str]) -> Path:
    """Copy an FMU with replacements in its model description."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(fmu) as source, zipfile.ZipFile(target, "w") as copy:
        for entry in source.infolist():
            data = source.read(entry)
            if entry.filename == "modelDescription.xml":
                text = data.decode()
                for old, new in pairs:
                    assert old in text
                    text = text.replace(old, new)
                data = text.encode()
            copy.writestr(entry.filename, data)
    return target


def renamed(target: Path, names: dict[str, str] | None = None) -> Path:
    """Copy our car-like robot with other names of its variables."""
    pairs = ((f' name="{old}"', f' name="{new}"') for old, new in (names or NAMES).items())
    return rewritten(plants.build("car_like"), target, *pairs)
