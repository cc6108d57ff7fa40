"""FMU files that are broken, or bad on purpose, each in one way."""

import zipfile
from pathlib import Path

from plants.factory.platforms import PLATFORMS, host

from .stub import Options, binary, binary_path, description, write

BROKEN = {
    "empty_file": "has no bytes",
    "no_zip": "is a text",
    "empty_zip": "has no entries",
    "truncated": "ends in the middle",
    "crc": "has a byte of the binary flipped",
    "description_crc": "has a byte of the model description flipped",
    "encrypted": "says that its entries are encrypted",
    "no_description": "has no modelDescription.xml",
    "two_descriptions": "has two entries modelDescription.xml, of other models",
    "no_xml": "has a model description that is not XML",
    "no_utf8": "has a model description that is not in its encoding",
    "fmi_4": "is FMI 4.0",
    "entity_bomb": "has entities that would grow to gigabytes",
    "external_entity": "has an entity that is a file of this machine",
    "parent_entry": "has the entry ../formation-stub-evil",
    "backslash_entry": "has the entry ..\\formation-stub-evil",
    "absolute_entry": "has the entry /tmp/formation-stub-evil",
    "link_entry": "has a symbolic link out of itself, and an entry below that",
    "identifier_outside": "has the model identifier ../../formation-stub-evil",
    "no_identifier": "has an empty model identifier",
    "duplicate_names": "has two variables named x",
    "duplicate_references": "has two variables of one value reference, which only FMI 3 forbids",
    "undefined_unit": "has units that it does not define",
    "no_start": "has an input without a start value",
    "wrong_token": "has a token other than its binary's",
    "no_binaries": "has no folder of binaries",
    "other_platforms": "has binaries only for other platforms",
    "other_machine": "has, for this platform, a binary for another processor",
    "text_binary": "has a text as binary",
    "empty_binary": "has a binary of no bytes",
    "misnamed_binary": "has a binary of another name than the model identifier",
    "no_do_step": "has a binary that lacks the function that takes a step",
}
"""What is wrong with a file that `make_broken` writes."""

EVIL = "formation-stub-evil"
"""Name of the files that should never come into being."""


def make_broken(folder: Path, kind: str, **options: object) -> Path:
    """Write a broken FMU, `folder`/`kind`.fmu, and return its path.

    Parameters
    ----------
    kind
        One of BROKEN.
    options
        Of `make_fmu`, for what is not broken.
    """
    if kind not in BROKEN:
        raise ValueError(f"there is no kind {kind!r}: {', '.join(BROKEN)}")
    chosen = Options(**options)  # type: ignore[arg-type]
    path = folder / f"{kind}.fmu"
    content = _content(kind, chosen)
    xml = "modelDescription.xml"
    if kind == "encrypted":
        return _with_flag(write(path, content), 1)
    write(path, content)
    if kind in ("empty_file", "no_zip"):
        path.write_bytes(b"This is no zip archive.\n" if kind == "no_zip" else b"")
    elif kind == "truncated":
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    elif kind in ("crc", "description_crc"):
        entry = xml if kind == "description_crc" else binary_path(chosen)
        with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
            for name, data in content.items():
                archive.writestr(name, data)
        data = bytearray(path.read_bytes())
        data[data.index(content[entry]) + len(content[entry]) // 2] ^= 1
        path.write_bytes(data)
    elif kind == "two_descriptions":
        another = description(chosen).replace(f'modelName="{chosen.name}"', 'modelName="another"')
        content = {"another_description_": another.encode(), **content}  # of the same length
        write(path, content)
        path.write_bytes(path.read_bytes().replace(b"another_description_", xml.encode()))
    elif kind == "link_entry":
        with zipfile.ZipFile(path, "a") as archive:
            link = zipfile.ZipInfo("resources/link")
            link.external_attr = 0o120777 << 16
            archive.writestr(link, "/tmp")
            archive.writestr(f"resources/link/{EVIL}", b"evil")
    return path


def _content(kind: str, options: Options) -> dict[str, bytes]:
    xml = description(options)
    place = binary_path(options)
    library = binary(options.fmi, options.name, ("WITHOUT_DO_STEP",) if kind == "no_do_step" else ())
    identifier = f'modelIdentifier="{options.name}"'
    bomb = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 12))
    version = {"1.0": "ScalarVariable", "2.0": "ScalarVariable", "3.0": "Float64"}[options.fmi]
    replaced = {
        "fmi_4": (f'fmiVersion="{options.fmi}"', 'fmiVersion="4.0"'),
        "entity_bomb": (
            "<fmiModelDescription ",
            f'<!DOCTYPE d [<!ENTITY e0 "ha">{bomb}]><fmiModelDescription author="&e11;" ',
        ),
        "identifier_outside": (identifier, f'modelIdentifier="../../{EVIL}"'),
        "no_identifier": (identifier, 'modelIdentifier=""'),
        "duplicate_names": (' name="y"', ' name="x"'),
        "duplicate_references": ('valueReference="1"', 'valueReference="0"'),
        "no_start": (
            ' start="0"/></ScalarVariable>\n    <ScalarVariable name="tau_steer"',
            ' /></ScalarVariable>\n    <ScalarVariable name="tau_steer"',
        ),
        "wrong_token": (options.token, "{00000000-0000-0000-0000-000000000000}"),
        "no_utf8": ('generationTool="', 'generationTool="Z\N{LATIN SMALL LETTER U WITH DIAERESIS}rich '),
    }
    if kind == "no_start" and version == "Float64":
        replaced[kind] = (' start="0"/>\n    <Float64 name="tau_steer"', '/>\n    <Float64 name="tau_steer"')
    if kind in replaced:
        old, new = replaced[kind]
        assert old in xml
        xml = xml.replace(old, new)
    if kind == "external_entity":
        xml = xml.replace(
            "<fmiModelDescription ",
            f'<!DOCTYPE d [<!ENTITY e SYSTEM "{Path(__file__).as_uri()}">]><fmiModelDescription ',
        )
        xml = xml.replace("</ModelVariables>", "&e;</ModelVariables>")
    if kind == "undefined_unit":
        xml = (
            xml[: xml.index("  <UnitDefinitions>")]
            + xml[xml.index("</UnitDefinitions>\n") + len("</UnitDefinitions>\n") :]
        )
    text = xml.encode("latin-1" if kind == "no_utf8" else "utf-8")
    if kind == "no_xml":
        text = b"This is no XML.\n"
    if kind == "empty_zip":
        return {}
    content = {"modelDescription.xml": text, place: library}
    if kind == "no_description":
        del content["modelDescription.xml"]
    elif kind in ("no_binaries", "other_platforms", "misnamed_binary"):
        del content[place]
    if kind == "other_platforms":
        for platform in PLATFORMS.values():
            folder = platform.folder(options.fmi)
            if folder != host().folder(options.fmi):
                content[f"binaries/{folder}/{options.name}{platform.suffix}"] = b"for another platform"
    elif kind == "misnamed_binary":
        content[place.replace(options.name + host().suffix, "another" + host().suffix)] = library
    elif kind == "other_machine":  # the processor in the header of ELF, or the beginning of any other format
        content[place] = library[:18] + bytes([library[18] ^ 0xFF]) + library[19:]
    elif kind == "text_binary":
        content[place] = b"This is no shared library.\n"
    elif kind == "empty_binary":
        content[place] = b""
    elif kind == "parent_entry":
        content[f"../{EVIL}"] = b"evil"
    elif kind == "backslash_entry":
        content[f"..\\{EVIL}"] = b"evil"
    elif kind == "absolute_entry":
        content[f"/tmp/{EVIL}"] = b"evil"
    return content


def _with_flag(path: Path, flag: int) -> Path:
    """Set a flag of all entries, in both of their headers."""
    data = bytearray(path.read_bytes())
    for signature, offset in ((b"PK\3\4", 6), (b"PK\1\2", 8)):
        at = data.find(signature)
        while at >= 0:
            data[at + offset] |= flag
            at = data.find(signature, at + 4)
    path.write_bytes(data)
    return path
