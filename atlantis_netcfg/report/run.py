"""How a run ended: one JSON object, or a few lines for a person. Both from the same results."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core import printable
from atlantis_netcfg.core.errors import ExitCode, worst

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping


def consent_question(cost: Mapping[str, Any]) -> str:
    """What a person is told before, and asked to pay; above all that it is another link than the declared one."""
    return f"{cost['instead']}; {cost['words']}" if cost["instead"] else str(cost["words"])


def cost_lines(result: Mapping[str, Any], *, rehearsed: bool) -> Iterator[str]:
    """What it came to; of a rehearsal, which costs nothing, what a real run would ask and come to."""
    cost = result.get("cost")
    if cost is None:
        return
    if rehearsed and cost["words"]:
        yield f"a real run asks first: {consent_question(cost)}"
    yield f"{'and comes to' if rehearsed else 'cost over ' + str(cost['bearer'])}: {cost['bill_words']}"


@dataclass(frozen=True, slots=True)
class Pass:
    """A second run over a device of a rehearsal, which must find nothing left to change."""

    device: str
    bearer: str
    result: Mapping[str, Any]

    @property
    def left(self) -> int:
        """Changes that it still found."""
        return int(self.result["planned"])

    def as_json(self) -> dict[str, Any]:
        """What it cost."""
        kept = ("exit", "planned", "round_trips", "bytes", "seconds", "cost")
        return {name: self.result[name] for name in kept if name in self.result}


@dataclass(frozen=True, slots=True)
class RunReport:
    """Results of one run of one site (or of all of them)."""

    site: str
    rehearsed: bool
    devices: Mapping[str, Mapping[str, Any]]
    """Device name to the engine's result."""
    passes: tuple[Pass, ...] = ()
    """Rehearsal: the second runs, one over each bearer."""
    not_handled: Mapping[str, str] = field(default_factory=dict)
    """Device name to its kind, for what no role handles yet."""
    not_rehearsed: tuple[str, ...] = ()
    runs: tuple[str, ...] = ()
    left_out: Mapping[str, str] = field(default_factory=dict)
    """Rehearsal: device name to why nothing stands for it here."""
    stopped_by: str = ""
    """The signal with which a person has stopped the run, as `SIGINT`; what was still to come was not done."""

    @property
    def exit(self) -> ExitCode:
        """The worst that happened to any device; nothing handled is its own code, never a green nothing."""
        if not self.devices:
            return ExitCode.NOTHING
        codes = {ExitCode(result["exit"]) for result in self.devices.values()}
        codes |= {ExitCode.FAILED if item.left else ExitCode(item.result["exit"]) for item in self.passes}
        if self.stopped_by:
            codes.add(ExitCode.FAILED)
        return worst(codes)

    def as_json(self) -> dict[str, Any]:
        """The object that `--json` prints."""
        return {
            "site": self.site,
            "rehearsed": self.rehearsed,
            "exit": int(self.exit),
            "runs": [run for run in self.runs if run],
            "devices": {
                **{name: self._device(name, result) for name, result in self.devices.items()},
                **{name: {"status": "not rehearsed", "message": why} for name, why in self.left_out.items()},
                **{name: {"status": "not handled yet", "kind": kind} for name, kind in self.not_handled.items()},
            },
            "errors": [
                {"device": name, "message": result["message"], "hint": result["hint"]}
                for name, result in self.devices.items()
                if result["exit"] not in (ExitCode.DONE, ExitCode.CHANGES, ExitCode.NOTHING)
            ],
        }

    def _device(self, name: str, result: Mapping[str, Any]) -> dict[str, Any]:
        passes = [item for item in self.passes if item.device == name]
        return {
            **result,
            "second_pass": sum(element.left for element in passes) if passes else None,
            "bearers": {entry.bearer: entry.as_json() for entry in passes},
            "not_rehearsed": list(self.not_rehearsed) if self.rehearsed else [],
        }

    def plan_as_text(self) -> str:
        """What would change, device by device, and what it costs; one that has no plan has its closing line alone."""
        return "".join(
            f"{name}:\n" + "".join(f"{line}\n" for line in _plan(result)) + "\n"
            for name, result in self.devices.items()
            if not _without_plan(result)
        )

    def as_text(self) -> str:
        """The closing lines that a person reads."""
        return "\n".join(self._lines())

    def _lines(self) -> Iterable[str]:
        for name, result in self.devices.items():
            yield f"  {name:<18} {printable.below(result['message'], 21)}{_cost(result)}"
            if result["hint"]:
                yield f"  {'':<18} {printable.below(result['hint'], 21)}"
            yield from self._bill(result)
            for item in self.passes:
                if item.device == name:
                    yield f"  {'':<18} again over {item.bearer}: {_left(item)}{_cost(item.result)}"
                    yield from self._bill(item.result)
            yield from (f"  {'':<18} note: {printable.below(note, 21)}" for note in result["notes"])
            yield from (f"  {'':<18} drift: {printable.below(drift['message'], 21)}" for drift in result["drift"])
        yield from (f"  {name:<18} not rehearsed: {why}" for name, why in self.left_out.items())
        for name, kind in self.not_handled.items():
            yield f"  {name:<18} not handled yet ({kind.replace('_', ' ')})"
        if self.rehearsed:
            yield from (f"  not rehearsed: {item}" for item in self.not_rehearsed)
        if self.stopped_by:
            yield f"  {self._stopped()}"
        recorded = [run for run in self.runs if run]
        if recorded:
            yield f"  recorded as {', '.join(recorded)}"

    def _stopped(self) -> str:
        how = "Ctrl-C" if self.stopped_by == "SIGINT" else self.stopped_by
        scope = "; only emulated devices were changed" if self.rehearsed else ""
        return f"stopped by {how} before its end{scope}"

    def _bill(self, result: Mapping[str, Any]) -> Iterable[str]:
        return (f"  {'':<18} {line}" for line in cost_lines(result, rehearsed=self.rehearsed))


def _without_plan(result: Mapping[str, Any]) -> bool:
    """Whether nothing can be said of what would change: the device was not reached, or failed before it was read."""
    fine = (ExitCode.DONE, ExitCode.CHANGES, ExitCode.NOTHING)
    return result["exit"] not in fine and result["status"] != "declared" and not result["diff"]


def _plan(result: Mapping[str, Any]) -> Iterable[str]:
    if result["status"] == "declared":
        yield f"  {result['message']}"
        return
    nothing = f"  {result['message']}" if result["status"] == "planned" else "  nothing to change"
    diff = result["diff"].rstrip().expandtabs()
    yield from diff.split("\n") if diff else [nothing]
    estimate = result["estimate"]
    if estimate is not None:
        size = estimate["bytes"] / 1000
        cost = f"{estimate['round_trips']} round trips, {size:.0f} kB, about {estimate['seconds']:.0f} s"
        yield f"  {_changes(result)} over {estimate['bearer']}: {cost}"
    elif result["planned"]:
        yield "  no estimate"
    if "cost" in result:
        yield f"  {consent_question(result['cost'])}"
    if result["planned"] or estimate is not None:
        yield f"  protection: {result['protection_words']}"


def _changes(result: Mapping[str, Any]) -> str:
    """Actions, and rows where one action is about several."""
    number, rows = result["planned"], result.get("rows", 0)
    return f"{number} changes" if rows in (0, number) else f"{number} changes of {rows} rows"


def _left(unit: Pass) -> str:
    if unit.result["exit"] != ExitCode.DONE:
        return str(unit.result["message"])
    return f"{unit.left} changes LEFT" if unit.left else "0 changes"


def _cost(result: Mapping[str, Any]) -> str:
    trips = result["round_trips"]
    if not trips:
        return f" ({result['seconds']:.1f} s)" if result["seconds"] else ""
    size = sum(result["bytes"].values()) / 1000
    return f" ({trips} round trips, {size:.1f} kB, {result['seconds']:.1f} s)"
