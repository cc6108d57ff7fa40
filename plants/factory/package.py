"""The FMU as a file: a zip archive that is the same, byte for byte, whenever and wherever it is written."""

import zipfile
from pathlib import Path


def package(root: Path, fmu: Path) -> None:
    """Zip the files below `root` into `fmu`, sorted, with a fixed time and fixed permissions."""
    with zipfile.ZipFile(fmu, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(p.relative_to(root).as_posix() for p in root.rglob("*") if p.is_file()):
            info = zipfile.ZipInfo(path, date_time=(1980, 1, 1, 0, 0, 0))
            info.create_system = 3  # Unix, for the permissions
            info.external_attr = (0o755 if path.startswith("binaries/") else 0o644) << 16
            archive.writestr(info, (root / path).read_bytes(), zipfile.ZIP_DEFLATED)
