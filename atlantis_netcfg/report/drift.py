"""Drift as a person reads it, as one JSON object, and as JUnit: all from the engine's results alone."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import datetime
from itertools import groupby
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core import printable
from atlantis_netcfg.core.errors import ExitCode, worst
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.events import worst as worst_verdict
from atlantis_netcfg.report.run import cost_lines

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

_ENDS = {ExitCode.DONE: "PASS", ExitCode.CHECKS_FAILED: "FAIL"}


@dataclass(frozen=True, slots=True)
class DriftReport:
    """How the devices of a site differ from the declaration."""

    site: str
    rehearsed: bool
    devices: Mapping[str, Mapping[str, Any]]
    """Device name to the engine's result."""
    not_handled: Mapping[str, str] = field(default_factory=dict)
    """Device name to its kind, for what no role handles yet."""
    unfinished: Mapping[str, str] = field(default_factory=dict)
    """Device name to the run that left its outcome open."""
    next_commands: Mapping[str, str] = field(default_factory=dict)
    """Device name to what is typed to go on with that run."""
    left_out: Mapping[str, str] = field(default_factory=dict)
    """Rehearsal: device name to why nothing stands for it here."""

    @property
    def skipped(self) -> Mapping[str, str]:
        """Device name to why it was not compared."""
        untold = {name: f"not handled yet ({_kind(kind)})" for name, kind in self.not_handled.items()}
        return {**{name: f"not rehearsed: {why}" for name, why in self.left_out.items()}, **untold}

    @property
    def exit(self) -> ExitCode:
        """The worst of any device: one that could not be read is worse than one that differs."""
        return worst(ExitCode(result["exit"]) for result in self.devices.values())

    def as_json(self) -> dict[str, Any]:
        """The object that `--json` prints; docs/drift.md describes it."""
        return {
            "site": self.site,
            "rehearsed": self.rehearsed,
            "exit": int(self.exit),
            "devices": {
                **{name: self._device(name, result) for name, result in self.devices.items()},
                **{name: {"verdict": "SKIP", "message": why} for name, why in self.skipped.items()},
            },
            "errors": [
                {"device": name, "message": result["message"], "hint": result["hint"]}
                for name, result in self.devices.items()
                if verdict(result) == "ERROR"
            ],
        }

    def _device(self, name: str, result: Mapping[str, Any]) -> dict[str, Any]:
        compared = result["comparison"] or {"menus": [], "confirmed": None, "differences": []}
        kept = ("message", "hint", "notes", "round_trips", "bytes", "seconds", "version", "board")
        return {
            "verdict": verdict(result),
            **compared,
            **{key: result[key] for key in kept},
            **({"cost": result["cost"]} if "cost" in result else {}),
            "unfinished": self.unfinished.get(name),
        }

    def as_text(self) -> str:
        """What a person reads."""
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        for name, result in self.devices.items():
            yield f"{name}: {'ERROR, ' if verdict(result) == 'ERROR' else ''}{printable.below(result['message'], 4)}"
            yield from (f"  {printable.below(line, 4)}" for line in self._beside(name, result))
            if result["comparison"] is not None:
                yield from drift_lines(result["comparison"]).split("\n")[:-1]
            yield ""
        yield from (f"{name}: {why}" for name, why in self.skipped.items())
        if self.rehearsed:
            yield "rehearsed on emulated devices as they are after `provision adopt`: nothing real was read"

    def _beside(self, name: str, result: Mapping[str, Any]) -> Iterator[str]:
        if result["comparison"] is not None:
            yield _last(result["comparison"])
        if result["hint"]:
            yield result["hint"]
        yield from cost_lines(result, rehearsed=self.rehearsed)
        yield from (f"note: {note}" for note in result["notes"])
        if name in self.unfinished:
            yield f"note: run {self.unfinished[name]} left its outcome open: `{self.next_commands[name]}` goes on"


def _last(comparison: Mapping[str, Any]) -> str:
    confirmed = comparison["confirmed"]
    if confirmed is None:
        return "since when is unknown: no run has confirmed a state of this device"
    return f"last confirmed by run {confirmed['run']} of {_time(confirmed['at'])}"


def verdict(result: Mapping[str, Any]) -> str:
    """PASS as declared, FAIL drift, ERROR could not tell; of a satellite terminal what a run says of its evidence."""
    if of_evidence(result):
        return str(worst_verdict([Verdict.PASS, *(Verdict(finding["verdict"]) for finding in result["findings"])]))
    return _ENDS.get(ExitCode(result["exit"]), "ERROR")


def of_evidence(result: Mapping[str, Any]) -> bool:
    """Whether nothing is read from the device itself: a satellite terminal, which has no interface."""
    return result.get("status") == "declared"


def drift_lines(comparison: Mapping[str, Any]) -> str:
    """Return the differences of one device, menu by menu; empty without any."""
    lines: list[str] = []
    for menu, differences in groupby(comparison["differences"], key=lambda item: item["menu"]):
        lines.append(f"  {menu}")
        for difference in differences:
            lines += [f"    {line}" for line in difference_lines(difference, comparison["confirmed"])]
    return "".join(f"{line}\n" for line in lines)


def difference_lines(difference: Mapping[str, Any], confirmed: Mapping[str, str] | None) -> Iterable[str]:
    """Return one difference: what, whose, since when, and who did it as far as the device remembers."""
    yield printable.line(f"{difference['kind']:<8} {difference['subject']}")
    details = [
        f"{field['name']}: declared {_shown(field['declared'])}, found {_shown(field['found'])}"
        for field in difference["fields"]
    ]
    if difference["row"]:
        details.append(difference["row"])
    details.append("; ".join(filter(None, (_owner(difference), _since(difference, confirmed)))))
    if difference["history"]:
        done = difference["history"]
        details.append(f"the device remembers: {done['action']}, by {done['by']}, {done['at']} by its clock")
    yield from (f"{'':<8} {printable.line(detail)}" for detail in details)


def _owner(difference: Mapping[str, Any]) -> str:
    mark = f" ({difference['mark']})" if difference["mark"] and not difference["row"] else ""
    return f"{difference['owner']}{mark}"


def _since(difference: Mapping[str, Any], confirmed: Mapping[str, str] | None) -> str:
    if difference["kind"] == "hidden":
        return str(difference["why_unknown"])
    if confirmed is None:
        return ""  # said once, for the whole device
    if difference["since"] == "unknown":
        return f"since when is unknown: {difference['why_unknown']}"
    if difference["since"] == "after":
        return f"since after run {confirmed['run']}"
    if difference["kind"] == "foreign":
        return f"there already in run {confirmed['run']}, which left it alone"
    return f"already so in run {confirmed['run']}: the declaration is newer"


def _shown(value: str) -> str:
    return value or "nothing"


def _time(at: str) -> str:
    return f"{datetime.fromisoformat(at):%Y-%m-%d %H:%M} UTC"


def _kind(kind: str) -> str:
    return kind.replace("_", " ")
