"""How a run ended: one JSON object, or a few lines for a person. Both from the same results."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.errors import ExitCode

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

__all__ = ["RunReport"]

_WORST_FIRST = (ExitCode.OUR_FAULT, ExitCode.UNKNOWN, ExitCode.FAILED, ExitCode.USAGE, ExitCode.CHANGES)


@dataclass(frozen=True, slots=True)
class RunReport:
    """Results of one run of one site (or of all of them)."""

    site: str
    rehearsed: bool
    devices: Mapping[str, Mapping[str, Any]]
    """Device name to the engine's result."""
    second_pass: Mapping[str, int] = field(default_factory=dict)
    """Rehearsal: device name to the number of changes that a second run still found."""
    not_handled: Mapping[str, str] = field(default_factory=dict)
    """Device name to its kind, for what no role handles yet."""
    not_rehearsed: tuple[str, ...] = ()
    runs: tuple[str, ...] = ()

    @property
    def exit(self) -> ExitCode:
        """The worst that happened to any device; nothing handled is its own code, never a green nothing."""
        if not self.devices:
            return ExitCode.NOTHING
        codes = {ExitCode(result["exit"]) for result in self.devices.values()}
        if any(self.second_pass.values()):
            codes.add(ExitCode.FAILED)
        return next((code for code in _WORST_FIRST if code in codes), ExitCode.DONE)

    def as_json(self) -> dict[str, Any]:
        """The object that `--json` prints."""
        return {
            "site": self.site,
            "rehearsed": self.rehearsed,
            "exit": int(self.exit),
            "runs": list(self.runs),
            "devices": {
                **{name: self._device(name, result) for name, result in self.devices.items()},
                **{name: {"status": "not handled yet", "kind": kind} for name, kind in self.not_handled.items()},
            },
            "errors": [
                {"device": name, "message": result["message"], "hint": result["hint"]}
                for name, result in self.devices.items()
                if result["exit"] not in (ExitCode.DONE, ExitCode.CHANGES)
            ],
        }

    def _device(self, name: str, result: Mapping[str, Any]) -> dict[str, Any]:
        not_rehearsed = list(self.not_rehearsed) if self.rehearsed else []
        return {**result, "second_pass": self.second_pass.get(name), "not_rehearsed": not_rehearsed}

    def as_text(self) -> str:
        """The closing lines that a person reads."""
        return "\n".join(self._lines())

    def _lines(self) -> Iterable[str]:
        for name, result in self.devices.items():
            yield f"  {name:<18} {result['message']}{_cost(result)}"
            if result["hint"]:
                yield f"  {'':<18} {result['hint']}"
            if name in self.second_pass:
                left = self.second_pass[name]
                yield f"  {'':<18} second pass: {f'{left} changes LEFT' if left else '0 changes'}"
            yield from (f"  {'':<18} drift: {drift['message']}" for drift in result["drift"])
        for name, kind in self.not_handled.items():
            yield f"  {name:<18} not handled yet ({kind.replace('_', ' ')})"
        if self.rehearsed:
            yield from (f"  not rehearsed: {one}" for one in self.not_rehearsed)
        if self.runs:
            yield f"  recorded as {', '.join(self.runs)}"


def _cost(result: Mapping[str, Any]) -> str:
    trips = result["round_trips"]
    if not trips:
        return ""
    size = sum(result["bytes"].values()) / 1000
    return f" ({trips} round trips, {size:.1f} kB, {result['seconds']:.1f} s)"
