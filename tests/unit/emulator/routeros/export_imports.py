"""Exports of other people's devices, imported line by line into a twin of the device that they came from.

    python tests/unit/emulator/routeros/export_imports.py FOLDER...  each refused line of the exports below, and figures

An import of the device stops at its first error. Here each line has its turn: one refusal does not hide the others.
"""

import re
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from atlantis_netcfg.emulator.routeros import ModemSpec
from atlantis_netcfg.emulator.routeros.boot import SYSTEM
from atlantis_netcfg.emulator.routeros.console.run import run_file
from atlantis_netcfg.emulator.routeros.device import Device
from atlantis_netcfg.emulator.routeros.schema import PACKAGE_MENUS
from atlantis_netcfg.emulator.routeros.spec import ManagementSpec, Radio, RouterSpec, User
from atlantis_netcfg.routeros.menus import MENUS

_VERSION = re.compile(r"^# .*by RouterOS (\d\S*)", re.MULTILINE)
_MODEL = re.compile(r"^# model = (\S+)", re.MULTILINE)
_PORT = re.compile(r"(?<![\w-])(?:ether|sfp|sfp-sfpplus|sfp28-|sfpplus|qsfpplus|qsfp28-|combo)\d+(?:-\d+)?(?![\w-])")
_RADIO = re.compile(r"(?<![\w-])default-name=(w(?:lan|ifi)\d+)")
_CERTIFICATE = re.compile(r"(?<![\w-])certificate=([^\s\"]+)")
_MODEM = re.compile(
    r"default-name=(lte\d+)|^/interface lte\n(?:#.*\n)*set \[ find \](?:[^\n]*\\\n)*[^\n]* name=(lte\d+)", re.MULTILINE
)
_BY_ID = re.compile(r"=!?\*[0-9A-F]+\b")
_PATH = re.compile(r"/[a-z0-9][a-z0-9 /-]*$")
_COMMAND = re.compile(r"^(/[a-z0-9][a-z0-9 /-]*?) (?=(?:add|set|remove|unset|enable|disable|print)(?:\s|$))")


@dataclass(frozen=True, slots=True)
class Line:
    """One command of an export: its menu, and its text with the continuations as they were printed."""

    number: int
    menu: str
    text: str

    @property
    def path(self) -> str:
        """The menu as the table of menus writes it."""
        return self.menu.replace(" ", "/")

    @property
    def whole(self) -> str:
        """The text without its continuations."""
        return re.sub(r"\\\n *", "", self.text)


class Cause(StrEnum):
    """Why a line is refused."""

    GONE = "gone"
    """It names a row by the id that a removal left behind; what is not there is refused.

    Recorded of `/interface/vlan/add` on 7.23 (`tests/data/recorded/cases.jsonl`).
    """
    SCRIPT = "script"
    """No line of an export but a script that somebody added; the twin has no scripting language."""
    NOT_REHEARSED = "not rehearsed"
    """The twin says that it does not stand for it."""
    FALSE = "false"
    """Everything else: the device took it, or nobody knows better."""


@dataclass(frozen=True, slots=True)
class Refusal:
    line: Line
    words: str

    @property
    def cause(self) -> Cause:
        if self.words.startswith("not rehearsed by the twin"):
            return Cause.NOT_REHEARSED
        if self.words.startswith("input does not match any value of") and _BY_ID.search(self.line.whole):
            return Cause.GONE
        return Cause.SCRIPT if self.line.text.lstrip()[:1] in tuple(":{}[($") else Cause.FALSE


@dataclass(frozen=True, slots=True)
class Imported:
    version: str
    lines: tuple[Line, ...]
    refusals: tuple[Refusal, ...]
    device: Device


def lines_of(text: str) -> Iterator[Line]:
    menu, start, parts = "/", 0, list[str]()
    for number, raw in enumerate(text.replace("\r\n", "\n").split("\n"), start=1):
        start = start if parts else number
        parts.append(raw)
        if (len(raw) - len(raw.rstrip("\\"))) % 2:
            continue
        whole, parts = "\n".join(parts), []
        if not whole.strip() or whole.startswith("#"):
            continue
        if _PATH.match(whole.rstrip()) and not _COMMAND.match(whole):
            menu = whole.rstrip()
        elif match := _COMMAND.match(whole):
            yield Line(start, match[1], whole[match.end() :])
        else:
            yield Line(start, menu, whole)


def spec_of(text: str) -> RouterSpec:
    """Return the device of an export: its version and model, the ports, radios and packages that the export shows."""
    lines = list(lines_of(text))
    ports = tuple(dict.fromkeys(_PORT.findall(text))) or ("ether1",)
    radios = tuple(dict.fromkeys(_RADIO.findall(text)))
    modem = _MODEM.search(text)
    model = _MODEL.search(text)
    menus = {line.path for line in lines}
    packages = {package for package, menu in PACKAGE_MENUS if any(f"{path}/".startswith(f"{menu}/") for path in menus)}
    if any(radio.startswith("wifi") for radio in radios):
        packages.add("wifi-qcom")
    version = _VERSION.search(text)
    assert version is not None, "no header with a version"
    return RouterSpec(
        name="MikroTik",
        version=version[1],
        board=model[1] if model else "CHR",
        architecture="arm64" if model else "x86_64",
        ports=ports,
        poe_ports=ports if model else (),
        radios=tuple(Radio(name=name) for name in radios),
        modem=ModemSpec(name=modem[1] or modem[2]) if modem else None,
        packages=("routeros", *sorted(packages)),
        management=ManagementSpec(port=ports[-1]),
        certificates=tuple(dict.fromkeys({*_CERTIFICATE.findall(text.replace("\\\n    ", ""))} - {"none"})),
        users=(User(name="provision"),),
    )


def imported(text: str) -> Imported:
    spec = spec_of(text)
    device = Device(spec, lambda: 1000.0)
    lines = tuple(lines_of(text))
    refusals = []
    for line in lines:
        error = run_file(device.core, SYSTEM, f"{line.menu}\n{line.text}").error
        if error is not None:
            refusals.append(Refusal(line, error))
    return Imported(spec.version, lines, tuple(refusals), device)


def figures(imports: Iterable[Imported]) -> dict[str, Counter[str]]:
    """Count exports, lines and refusals by version: in all menus, in those of the templates, and by their cause."""
    counts: dict[str, Counter[str]] = {}
    for result in imports:
        ours = sum(line.path in MENUS for line in result.lines)
        found = Counter(exports=1, lines=len(result.lines), template_lines=ours, refused=len(result.refusals))
        for refusal in result.refusals:
            found[f"{'template' if refusal.line.path in MENUS else 'other'}: {refusal.cause}"] += 1
        for version in (result.version, "all"):
            counts.setdefault(version, Counter()).update(found)
    return counts


def row(name: str, refusal: Refusal) -> str:
    shown = " ".join(refusal.line.whole.split())
    return "\t".join((name, str(refusal.line.number), refusal.line.menu, refusal.cause, refusal.words, shown))


def main() -> None:
    files = [path for folder in sys.argv[1:] for path in sorted(Path(folder).rglob("*.rsc"))]
    results = {path: imported(path.read_bytes().decode("utf-8", "surrogateescape")) for path in files}
    for path, result in results.items():
        for refusal in result.refusals:
            sys.stdout.write(f"{row(f'{path.parent.name}/{path.name}', refusal)}\n")
    for version, counts in figures(results.values()).items():
        sys.stdout.write(f"{version}: {', '.join(f'{name} {count}' for name, count in sorted(counts.items()))}\n")


if __name__ == "__main__":
    main()
