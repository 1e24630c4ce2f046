"""The result of a run as JSON object or as text, both from the same results."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core import printable
from atlantis_netcfg.core.errors import ExitCode, worst
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.runs.report.summary import DeviceEnd, Summary, ending, rows_of_plan

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence


def consent_question(cost: Mapping[str, Any]) -> str:
    """Return the cost text shown before consent; use of a link other than the expected one comes first."""
    return msg(f"{arg(cost['instead'])}; {arg(cost['words'])}") if cost["instead"] else str(cost["words"])


def cost_lines(result: Mapping[str, Any], *, is_rehearsal: bool) -> Iterator[str]:
    """Yield the cost of a run; for a rehearsal, what a real run would ask and cost."""
    cost = result.get("cost")
    if cost is None:
        return
    if is_rehearsal and cost["words"]:
        yield msg(f"a real run needs your consent: {arg(consent_question(cost))}")
    yield msg(f"{arg('and costs' if is_rehearsal else 'cost over ' + str(cost['bearer']))}: {arg(cost['bill_words'])}")


@dataclass(frozen=True, slots=True)
class Pass:
    """A second run over a device in a rehearsal, which must find nothing left to change."""

    device: str
    bearer: str
    result: Mapping[str, Any]

    @property
    def remaining_changes(self) -> int:
        """Number of changes still found."""
        return int(self.result["planned"])

    def as_json(self) -> dict[str, Any]:
        """Return the cost and exit code of the second run."""
        keys = ("exit", "planned", "round_trips", "bytes", "seconds", "cost")
        return {name: self.result[name] for name in keys if name in self.result}


@dataclass(frozen=True, slots=True)
class RunReport:
    """Results of one run of one site (or of all of them)."""

    site: str
    is_rehearsal: bool
    devices: Mapping[str, Mapping[str, Any]]
    """Maps a device name to the engine's result."""
    passes: tuple[Pass, ...] = ()
    """Rehearsal: the repeated runs, one over each link."""
    not_handled: Mapping[str, str] = field(default_factory=dict)
    """Maps a device name to its kind, for devices that no role supports yet."""
    not_rehearsed: tuple[str, ...] = ()
    runs: tuple[str, ...] = ()
    left_out: Mapping[str, str] = field(default_factory=dict)
    """Rehearsal: maps a device name to why it has no emulated device here."""
    stopped_by: str = ""
    """Signal with which the user stopped the run, such as `SIGINT`; the remaining steps were not done."""
    purpose: str = "apply"
    """Mode of the run, such as `plan`."""
    verbose: bool = False
    next_command: str = ""
    """Next command for the user after success; failures have their own hints."""
    record: str = ""
    """Run ids, and the folder that contains their records."""

    @property
    def exit(self) -> ExitCode:
        """The worst exit code of all devices; if no device was handled, a separate code, never success."""
        if not self.devices:
            return ExitCode.NOTHING
        codes = {ExitCode(result["exit"]) for result in self.devices.values()}
        codes |= {ExitCode.FAILED if item.remaining_changes else ExitCode(item.result["exit"]) for item in self.passes}
        if self.stopped_by:
            codes.add(ExitCode.FAILED)
        return worst(codes)

    def as_json(self) -> dict[str, Any]:
        """The object that `--json` prints."""
        return {
            "site": self.site,
            "rehearsed": self.is_rehearsal,
            "exit": int(self.exit),
            "runs": [run for run in self.runs if run],
            "devices": {
                **{name: self._device(name, result) for name, result in self.devices.items()},
                **{name: {"status": "not rehearsed", "message": why} for name, why in self.left_out.items()},
                **{name: {"status": "not supported yet", "kind": kind} for name, kind in self.not_handled.items()},
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
            "second_pass": sum(element.remaining_changes for element in passes) if passes else None,
            "bearers": {entry.bearer: entry.as_json() for entry in passes},
            "not_rehearsed": list(self.not_rehearsed) if self.is_rehearsal else [],
        }

    def plan_rows(self) -> list[printable.Row]:
        """Return the changes of each device and their cost; a device without plan has only its closing line."""
        rows: list[printable.Row] = []
        for name, result in self.devices.items():
            if not _without_plan(result):
                rows += [printable.StyledText(f"{name}:", printable.Style.TITLE), *_plan(result), ""]
        return rows

    def cost_rows(self) -> list[printable.Row]:
        """Return the number of changes of each device and their cost, without the differences."""
        rows: list[printable.Row] = []
        for name, result in self.devices.items():
            if not _without_plan(result):
                rows += [printable.StyledText(f"{name}:", printable.Style.TITLE), *_plan_cost(result), ""]
        return rows

    def plan_as_text(self) -> str:
        """The plan as plain text."""
        return "".join(f"{printable.plain(row)}\n" for row in self.plan_rows())

    def as_text(self) -> str:
        """Return the closing lines as plain text."""
        return "\n".join(map(printable.plain, self.rows()))

    def rows(self, width: int = 0) -> list[printable.Row]:
        """Return the closing lines: devices, wrapped at `width` columns unless 0 (no terminal), and the summary.

        On a terminal a successful rehearsal shows one line for each device; `--verbose` shows all.
        """
        column = _NARROW_COLUMN if 0 < width < _ROOMY else _COLUMN
        is_brief = bool(width) and self.is_rehearsal and not self.verbose and self.exit is ExitCode.DONE
        device_rows = self._brief_rows(column) if is_brief else self._device_rows(column)
        devices = [part for row in device_rows for part in printable.wrap_row(row, width, column)]
        return [*devices, *self.summary().rows_for_screen(min(width or printable.NARROW, printable.NARROW))]

    def summary(self) -> Summary:
        """Return the data of the summary."""
        return Summary(
            site=self.site,
            is_rehearsal=self.is_rehearsal,
            purpose=self.purpose,
            exit=self.exit,
            results={name: self._decisive(name, result) for name, result in self.devices.items()},
            unseen={
                **{name: (DeviceEnd.NOT_REHEARSED, why) for name, why in self.left_out.items()},
                **dict.fromkeys(self.not_handled, (DeviceEnd.NOT_HANDLED, "")),
            },
            rows=rows_of_plan(self.devices.values()),
            limits=len(self.not_rehearsed) if self.is_rehearsal and not self.verbose else 0,
            passes=len({item.bearer for item in self.passes}),
            stopped_by="Ctrl-C" if self.stopped_by == "SIGINT" else self.stopped_by,
            next_command=self.next_command,
            record=self.record,
        )

    def _decisive(self, name: str, result: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the decisive result: that of a second run if it failed or found changes."""
        for item in self.passes:
            if item.device == name and item.result["exit"] != ExitCode.DONE:
                return item.result
            if item.device == name and item.remaining_changes:
                words = msg(f"a second run over {arg(item.bearer)} still finds {arg(item.remaining_changes)} changes")
                return {**item.result, "exit": ExitCode.FAILED, "status": "unknown", "message": words, "hint": None}
        return result

    def _brief_rows(self, column: int) -> Iterable[printable.Row]:
        for name, result in self.devices.items():
            style = _STYLES.get(ending(result), printable.Style.BAD)
            words = translate(result["message"]).removeprefix("WARN: ")
            yield (f"  {name:<{column - 3}} ", printable.StyledText(printable.below(words, column), style))
            yield from _packets(result, column)
        yield from self._absent_rows(column)
        yield f"  {translate('costs, repeated runs and notes: type --verbose, too')}"

    def _device_rows(self, column: int) -> Iterable[printable.Row]:
        below, start = " " * column, f"<{column - 3}"
        for name, result in self.devices.items():
            words = printable.below(translate(result["message"]), column)
            style = _STYLES.get(ending(result), printable.Style.BAD)
            yield (f"  {name:{start}} ", printable.StyledText(words, style), _cost(result))
            if result["hint"]:
                yield f"{below}{printable.below(translate(result['hint']), column)}"
            yield from self._bill(result, below)
            for item in self.passes:
                if item.device == name:
                    words = translate(f"second run over {arg(item.bearer)}")
                    yield msg(f"{arg(below)}{arg(words)}: {arg(_remaining_text(item))}{arg(_cost(item.result))}")
                    yield from self._bill(item.result, below)
            yield from _packets(result, column)
            yield from (_note("note", note, column) for note in result["notes"])
            yield from (_note("drift", drift["message"], column) for drift in result["drift"])
        yield from self._absent_rows(column)
        if self.is_rehearsal and self.verbose:
            yield from (f"  {translate(f'not rehearsed: {arg(item)}')}" for item in self.not_rehearsed)

    def _absent_rows(self, column: int) -> Iterable[printable.Row]:
        start = f"<{column - 3}"
        for name, reason in self.left_out.items():
            why = translate(reason)
            words = translate(f"not rehearsed: {arg(why)}")
            yield (f"  {name:{start}} ", printable.StyledText(words, printable.Style.WARNING))
        for name, kind in self.not_handled.items():
            words = translate(f"not supported yet ({arg(msg(kind.replace('_', ' ')))})")
            yield (f"  {name:{start}} ", printable.StyledText(words, printable.Style.WARNING))

    def _bill(self, result: Mapping[str, Any], below: str) -> Iterable[printable.Row]:
        return (f"{below}{translate(line)}" for line in cost_lines(result, is_rehearsal=self.is_rehearsal))


_COLUMN, _NARROW_COLUMN = 21, 4
"""Column at which the text about a device begins; the second on terminals under `_ROOMY` columns."""
_ROOMY = 60
_STYLES = {
    DeviceEnd.CHANGED: printable.Style.GOOD,
    DeviceEnd.UNCHANGED: printable.Style.GOOD,
    DeviceEnd.TO_CHANGE: printable.Style.TITLE,
    DeviceEnd.DECLARED: printable.Style.WARNING,
    DeviceEnd.NOT_CHECKED: printable.Style.WARNING,
    DeviceEnd.UNKNOWN: printable.Style.WARNING,
}


def _packets(result: Mapping[str, Any], column: int) -> Iterator[printable.Row]:
    """Yield what became of the packets of a rehearsal; differences one a line."""
    for name in ("flows", "link_cuts", "data", "checklist"):
        section = result.get(name, {"differences": ()})
        if "words" in section:
            words = printable.below(translate(section["words"]), column)
            yield (" " * column, printable.StyledText(words, printable.Style.GOOD))
        yield from (f"{' ' * column}{printable.below(translate(line), column)}" for line in section["differences"])


def _note(label: str, message: str, column: int) -> printable.Row:
    words = printable.below(translate(message), column)
    style = printable.Style.WARNING if message.startswith("WARN: ") else None
    return (f"{'':<{column}}{translate(label)}: ", printable.StyledText(words, style) if style is not None else words)


def _without_plan(result: Mapping[str, Any]) -> bool:
    """Return True if changes are unknown: the device was not reached, or failed before it was read."""
    fine = (ExitCode.DONE, ExitCode.CHANGES, ExitCode.NOTHING)
    return result["exit"] not in fine and result["status"] != "declared" and not result["diff"]


def _plan(result: Mapping[str, Any]) -> Iterable[printable.Row]:
    diff = result["diff"].rstrip().expandtabs()
    if diff and result["status"] != "declared":
        yield from map(_difference, _join_changes(diff.split("\n")))
    yield from _plan_cost(result)


_SET_HEAD = re.compile(r"set (?:\[[^\]]*\] |[^ =!]+ )?")
_SET_VALUE = re.compile(r'(!?)([\w.-]+)(?:=("(?:\\.|[^"\\])*"|\S*))?(?: |$)')


def _join_changes(lines: Sequence[str]) -> Iterator[str]:
    """Replace the pair of a removed and an added `set` of the same values by one line: `~ set name: old → new`."""
    rest = list(lines)
    while rest:
        line = rest.pop(0)
        change = _change(line, rest[0]) if rest else None
        if change is not None:
            rest.pop(0)
        yield change or line


def _change(removal: str, addition: str) -> str | None:
    """Return one line for two that set the same values of the same row; None for any others."""
    heads = [
        _SET_HEAD.match(line[2:]) if line[:2] == sign else None for line, sign in ((removal, "- "), (addition, "+ "))
    ]
    if heads[0] is None or heads[1] is None or heads[0][0] != heads[1][0]:
        return None
    old, new = (_values(line[2 + heads[0].end() :]) for line in (removal, addition))
    if not old or old.keys() != new.keys():
        return None
    return f"~ {heads[0][0].removeprefix('set ')}{', '.join(f'{key}: {old[key]} → {new[key]}' for key in old)}"


def _values(text: str) -> dict[str, str]:
    return {match[2]: "unset" if match[1] else str(match[3]) for match in _SET_VALUE.finditer(text)}


def _difference(line: str) -> printable.Row:
    """Return a line of a plan, coloured by its sign: `+` adds, `-` removes, `~` changes."""
    signs = {"+": printable.Style.ADDITION, "-": printable.Style.REMOVAL, "~": printable.Style.WARNING}
    style = signs.get(line[:1])
    return printable.StyledText(line, style) if style is not None else line


def _plan_cost(result: Mapping[str, Any]) -> Iterable[printable.Row]:
    """Yield the number of changes on a device, their cost, and the protection."""
    if result["status"] == "declared":
        yield f"  {translate(result['message'])}"
        return
    if not result["diff"]:
        nothing = result["message"] if result["status"] == "planned" else "nothing to change"
        yield f"  {translate(nothing)}"
    estimate = result["estimate"]
    if estimate is not None:
        size = estimate["bytes"] / 1000
        cost = msg(
            f"{arg(estimate['round_trips'])} round trips, {arg(size):.0f} kB, about {arg(estimate['seconds']):.0f} s"
        )
        words = msg(f"{arg(_changes(result))} over {arg(estimate['bearer'])}: {arg(cost)}")
        yield f"  {translate(words)}"
    elif result["planned"]:
        yield f"  {translate('no estimate')}"
    if "cost" in result:
        yield f"  {translate(consent_question(result['cost']))}"
    if result["planned"] or estimate is not None:
        yield f"  {translate('protection')}: {translate(result['protection_words'])}"


def _changes(result: Mapping[str, Any]) -> str:
    """Return the number of actions, and of rows if an action covers several."""
    number, rows = result["planned"], result.get("rows", 0)
    return msg(f"{arg(number)} changes" if rows in (0, number) else f"{arg(number)} changes of {arg(rows)} rows")


def _remaining_text(unit: Pass) -> str:
    if unit.result["exit"] != ExitCode.DONE:
        return translate(unit.result["message"])
    return translate(f"{arg(unit.remaining_changes)} changes LEFT" if unit.remaining_changes else "0 changes")


def _cost(result: Mapping[str, Any]) -> str:
    trips = result["round_trips"]
    if not trips:
        return f" ({result['seconds']:.1f} s)" if result["seconds"] else ""
    size = sum(result["bytes"].values()) / 1000
    words = msg(f"{arg(trips)} round trips, {arg(size):.1f} kB, {arg(result['seconds']):.1f} s")
    return f" ({translate(words)})"
