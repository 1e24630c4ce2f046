"""Last lines of a run: verdict, counts, the most urgent device, the next command, the record.

They are sufficient on their own: a reader of nothing else knows what happened and what to do. They are generated from
the results, so that screen and `--json` agree; texts are English until they are displayed.
"""

from __future__ import annotations

import re
import textwrap
from collections import Counter
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core import messages, printable
from atlantis_netcfg.core.errors import WORST_FIRST, ExitCode
from atlantis_netcfg.core.language import as_typed, translate
from atlantis_netcfg.core.messages import Message, arg, join, msg

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

_AGAIN = "remove the cause, then run the same command again"
"""Hint for failures without a better one."""
_STOP_HINT = "run the same command again to continue"
_LABEL = 10
_LINES = 8
"""Last lines that a user sees on returning to the terminal."""


class DeviceEnd(StrEnum):
    """Result category of a device in the counts; each device has exactly one."""

    CHANGED = "changed"
    UNCHANGED = "unchanged"
    FAILED = "failed"
    NOT_REACHED = "not reached"
    TO_CHANGE = "to change"
    DIFFERENT = "different"
    REFUSED = "refused"
    ROLLED_BACK = "rolled back"
    UNKNOWN = "unknown"
    NOT_PROVED = "not proved"
    DECLARED = "inventory only"
    NOT_CHECKED = "not checked"
    NOT_REHEARSED = "not rehearsed"
    NOT_HANDLED = "not supported yet"


ALWAYS = (DeviceEnd.CHANGED, DeviceEnd.UNCHANGED, DeviceEnd.FAILED, DeviceEnd.NOT_REACHED)
"""Results that are counted even if zero: a zero is information, too."""
_ACTIVE_ENDS = frozenset(DeviceEnd) - {DeviceEnd.NOT_CHECKED, DeviceEnd.NOT_REHEARSED, DeviceEnd.NOT_HANDLED}
_BY_STATUS = {
    "changed": DeviceEnd.CHANGED,
    "declared": DeviceEnd.DECLARED,
    "refused": DeviceEnd.REFUSED,
    "rolled-back": DeviceEnd.ROLLED_BACK,
}
_BY_CODE = {
    ExitCode.CHANGES: DeviceEnd.TO_CHANGE,
    ExitCode.UNKNOWN: DeviceEnd.UNKNOWN,
    ExitCode.NOTHING: DeviceEnd.NOT_CHECKED,
}


def ending(result: Mapping[str, Any]) -> DeviceEnd:
    """Return the result category of one device."""
    code, status = ExitCode(result["exit"]), str(result["status"])
    if code is ExitCode.DONE:
        return _BY_STATUS.get(status, DeviceEnd.UNCHANGED)
    if code in _BY_CODE:
        return _BY_CODE[code]
    if code is ExitCode.CHECKS_FAILED:
        return DeviceEnd.DIFFERENT if status == "drifted" else DeviceEnd.NOT_PROVED
    if code is ExitCode.FAILED and not result.get("reached", True):
        return DeviceEnd.NOT_REACHED
    end = _BY_STATUS.get(status, DeviceEnd.FAILED)
    return end if end in {DeviceEnd.REFUSED, DeviceEnd.ROLLED_BACK} else DeviceEnd.FAILED


_VERDICT = re.compile(f"^{messages.TEXT}?WARN{messages.END}?: {messages.END}?")


def warnings(result: Mapping[str, Any]) -> list[str]:
    """Return the warnings on a device that succeeded."""
    notes = [note for note in result.get("notes", ()) if note.startswith("WARN: ")]
    sources = (note.source if isinstance(note, Message) else note for note in notes)
    warning_notes = [Message(_VERDICT.sub("", source)) for source in sources]
    return [*warning_notes, *(row["message"] for row in result.get("drift", ()))]


_BAD = {
    DeviceEnd.REFUSED: ("REFUSED", "{device} was not changed", "{count} devices were not changed"),
    DeviceEnd.ROLLED_BACK: ("ROLLED BACK", "{device} is as it was before", "{count} devices are as they were before"),
    DeviceEnd.NOT_REACHED: (
        "NOT REACHED",
        "no session with {device}, which was not changed",
        "no session with {count} devices, which were not changed",
    ),
    DeviceEnd.UNKNOWN: (
        "UNKNOWN",
        "the state of {device} is not known",
        "the state of {count} devices is not known",
    ),
    DeviceEnd.NOT_PROVED: (
        "NOT PROVED",
        "work is left to do on {device}",
        "work is left to do on {count} devices",
    ),
    DeviceEnd.DIFFERENT: (
        "DIFFERENT",
        "{device} differs from the inventory",
        "{count} devices differ from the inventory",
    ),
    DeviceEnd.FAILED: ("FAILED", "{device} ended with an error", "{count} devices ended with an error"),
    DeviceEnd.NOT_CHECKED: ("NOTHING DONE", "no device took part", "no device took part"),
}
"""For the worst result of a run: the verdict, and the sentence for one device and for several."""


@dataclass(frozen=True, slots=True)
class Summary:
    """Data of the summary lines."""

    site: str
    is_rehearsal: bool
    purpose: str
    """`plan`, `apply`, `resume`, `backup`: the mode of the run."""
    exit: ExitCode
    results: Mapping[str, Mapping[str, Any]]
    """Result of each device; in a rehearsal with a finding in a later pass, the result of that pass."""
    unseen: Mapping[str, tuple[DeviceEnd, str]]
    """Devices that did not take part, with the reason."""
    rows: tuple[int, int, int] = (0, 0, 0)
    """Rows to add, to change and to remove, for a plan."""
    limits: int = 0
    """Number of limits of the rehearsal."""
    passes: int = 0
    stopped_by: str = ""
    next_command: str = ""
    record: str = ""

    @property
    def endings(self) -> dict[str, DeviceEnd]:
        """Result category by device name."""
        return {
            **{name: ending(result) for name, result in self.results.items()},
            **{name: how for name, (how, _) in self.unseen.items()},
        }

    @property
    def warned_devices(self) -> list[str]:
        """Devices that succeeded with a warning."""
        return [name for name, result in self.results.items() if _is_fine(result) and warnings(result)]

    def rows_for_screen(self, width: int = printable.NARROW) -> list[printable.Row]:
        """Return the summary, wrapped at `width` where words allow; nothing is cut.

        Where that takes more than the last lines on a screen, reason and counts come before the verdict and the advice.
        """
        style, mark = self._style()
        verdict_lines = _wrap(f"{mark} {self.verdict()}", width, len(mark) + 1)
        verdict: list[printable.Row] = [printable.StyledText(line, style) for line in verdict_lines]
        counts = list(_label_lines("devices", self._counts(), width))
        if self.purpose == "plan" and any(self.rows):
            add_count, change_count, remove_count = self.rows
            plan = translate(
                f"{arg(add_count)} rows to add, {arg(change_count)} to change, {arg(remove_count)} to remove"
            )
            counts += _label_lines("plan", plan, width)
        reason = list(_label_lines("check", self._reason(), width)) if self._reason() else []
        advice = list(_advice(self._advice_text(), width)) if self._advice_text() else []
        if self.limits:
            advice += _label_lines("limits", translate(count_limits(self.limits, "--verbose")), width)
        if self.next_command:
            advice += _command(self.next_command, width)
        if self.record:
            advice += _label_lines("record", translate(self.record), width)
        rows: list[printable.Row] = [*verdict, *counts, *reason, *advice]
        height = sum(1 + (len(printable.plain(row)) - 1) // width for row in rows)
        return ["", *rows] if height <= _LINES else ["", *reason, *counts, *verdict, *advice]

    def verdict(self) -> str:
        """Return the verdict: a word in capitals, and a sentence."""
        word, sentence = self._headline()
        return f"{translate(word)}: {translate(sentence)}"

    def _headline(self) -> tuple[str, str]:
        if self.stopped_by:
            return msg(f"STOPPED by {arg(self.stopped_by)}"), self._stopped_text()
        if self.exit is ExitCode.DONE:
            return self._success_words()
        if self.exit is ExitCode.CHANGES:
            number = list(self.endings.values()).count(DeviceEnd.TO_CHANGE)
            return "PLANNED", msg(f"{arg(_devices(number))} would change; nothing was changed")
        return self._failure_words()

    def _stopped_text(self) -> str:
        if self.purpose == "plan":
            return "nothing was changed"
        if self.is_rehearsal:
            return "only emulated devices were changed"
        if DeviceEnd.UNKNOWN in self.endings.values():
            return "the state of a device is not known"
        return "changes that were read back stay, nothing else was changed"

    def _success_words(self) -> tuple[str, str]:
        how = self.endings.values()
        whole, in_part, warning_text, sentence = self._good_words()
        active_count = sum(each in _ACTIVE_ENDS for each in how)
        if active_count < len(how):
            return in_part, msg(f"{arg(active_count)} of {arg(_devices(len(how)))} took part; {arg(sentence)}")
        return warning_text if self.warned_devices else whole, sentence

    def _good_words(self) -> tuple[str, str, str, str]:
        """Return the words for full success, partial success and success with warnings, and the sentence."""
        how = set(self.endings.values())
        if self.is_rehearsal and self.purpose != "plan":
            words = ("REHEARSED", "REHEARSED IN PART", "REHEARSED, WITH WARNINGS")
            return *words, self._rehearsed_words()
        if self.purpose == "backup":
            return "SAVED", "SAVED IN PART", "SAVED, WITH WARNINGS", "nothing was changed"
        if DeviceEnd.CHANGED in how:
            return "DONE", "DONE IN PART", "DONE, WITH WARNINGS", self._changed_words()
        if DeviceEnd.UNCHANGED in how:
            words = ("NOTHING TO CHANGE", "NOTHING TO CHANGE IN PART", "NOTHING TO CHANGE, WITH WARNINGS")
            return *words, "read, no differences from the inventory"
        return "LOOKED AT", "LOOKED AT IN PART", "LOOKED AT, WITH WARNINGS", "nothing was sent to any device"

    def _changed_words(self) -> str:
        """Return the text for changed devices; computers report their tasks, other devices are read back."""
        computers = any("changes" in result for result in self.results.values() if ending(result) is DeviceEnd.CHANGED)
        return "changed to match the inventory" if computers else "changed to match the inventory, and read back"

    def _rehearsed_words(self) -> str:
        if self.passes:
            return msg(f"repeated over {arg(_links(self.passes))}: no further changes")
        if DeviceEnd.CHANGED in self.endings.values():
            return "emulated devices were changed to match the inventory, and read back"
        return "emulated devices were read, nothing was changed"

    def _failure_words(self) -> tuple[str, str]:
        worst = self.endings.get(self._worst(), DeviceEnd.NOT_CHECKED)
        devices = [device for device, how in self.endings.items() if how is worst]
        word, single, several = _BAD[worst]
        if len(devices) == 1:
            return word, msg(single.format(device=arg(devices[0])))
        return word, msg(several.format(count=arg(len(devices))))

    def _style(self) -> tuple[printable.Style, str]:
        """Return colour and symbol of the verdict: green only if every device was read and none has a warning."""
        if self.exit is ExitCode.DONE and not self.stopped_by:
            whole = all(how in _ACTIVE_ENDS for how in self.endings.values())
            return (
                (printable.Style.GOOD, "[OK]")
                if whole and not self.warned_devices
                else (printable.Style.WARNING, "[!]")
            )
        if self.exit is ExitCode.CHANGES:
            return printable.Style.TITLE, "[~]"
        if self.stopped_by and not self._worst():
            return printable.Style.WARNING, "[!]"
        return (printable.Style.WARNING, "[?]") if self.exit is ExitCode.UNKNOWN else (printable.Style.BAD, "[FAIL]")

    def _counts(self) -> str:
        count_by_end = Counter(self.endings.values())
        present_ends = [how for how in DeviceEnd if how in ALWAYS or count_by_end[how]]
        parts = [translate(f"{arg(count_by_end[how])} {how}") for how in present_ends]
        if self.warned_devices:
            parts.append(translate(f"{arg(len(self.warned_devices))} with a warning"))
        return msg(f"{arg(len(self.endings))}: {arg(join(', ', parts))}")

    def _worst(self) -> str:
        """Return the most urgent device; empty if none needs attention."""
        for code in WORST_FIRST:
            if code in {ExitCode.DONE, ExitCode.CHANGES}:
                break
            for name, result in self.results.items():
                if result["exit"] == code:
                    return name
        return ""

    def _reason(self) -> str:
        """Return the most urgent device with its reason; else the first warning, else a device left out."""
        if name := self._worst():
            return f"{name}: {translate(self.results[name]['message'])}"
        if self.stopped_by:
            return ""
        if self.warned_devices:
            first = self.warned_devices[0]
            words = translate(warnings(self.results[first])[0])
            return words if first in words else msg(f"{arg(first)}: {arg(words)}")
        for device, (how, why) in self.unseen.items():
            return f"{device}: {translate(how.value)}{f': {translate(why)}' if why else ''}"
        return ""

    def _advice_text(self) -> str:
        """Return what to do about the most urgent device, or after a stop."""
        if name := self._worst():
            return translate(self.results[name]["hint"] or (_STOP_HINT if self.stopped_by else _AGAIN))
        return translate(_STOP_HINT) if self.stopped_by else ""


def _is_fine(result: Mapping[str, Any]) -> bool:
    return result["exit"] in {ExitCode.DONE, ExitCode.CHANGES}


def _devices(number: int) -> str:
    return msg("1 device" if number == 1 else f"{arg(number)} devices")


def _links(number: int) -> str:
    return msg("1 link" if number == 1 else f"{arg(number)} links")


def count_limits(number: int, option: str = "--json") -> str:
    """Return how many limits a rehearsal has, and the option that lists them."""
    if number == 1:
        return msg(f"1 limit of this rehearsal (`{arg(option)}` lists it)")
    return msg(f"{arg(number)} limits of this rehearsal (`{arg(option)}` lists them)")


def _wrap(text: str, width: int, indent: int) -> list[str]:
    """Wrap text at `width` columns; longer words are not split, so that they can be copied."""
    return textwrap.wrap(
        text, width, subsequent_indent=" " * indent, break_long_words=False, break_on_hyphens=False
    ) or [""]


def _label_lines(label: str, text: str, width: int) -> Iterator[printable.Row]:
    """Yield lines after a label."""
    room = max(width - _LABEL, 20)
    lines = _wrap(re.sub(r"\s+", " ", text).strip(), room, 0)
    for place, line in enumerate(lines):
        yield _label("" if place else label), line


def _command(command: str, width: int) -> Iterator[printable.Row]:
    """Yield the next command, which can be pasted even where it needs several lines."""
    for place, line in enumerate(printable.fill_command(as_typed(command), max(width - _LABEL, 20))):
        yield _label("" if place else "next"), line


def _label(label: str) -> printable.StyledText:
    return printable.StyledText(f"{translate(label) if label else '':<{_LABEL - 1}} ", printable.Style.QUIET)


_COMMAND = re.compile(r"(?:`|:\s+)(provision [a-z][^`\n]*?)(?=`|$)")


def _advice(hint: str, width: int) -> Iterator[printable.Row]:
    """Yield the advice; a command that would be broken over two lines gets its own line."""
    text = re.sub(r"\s+", " ", hint).strip()
    command = _COMMAND.search(text)
    if command is None or len(text) <= width - _LABEL:
        yield from _label_lines("do", text, width)
        return
    before = text[: command.start()].rstrip(" ,;:`")
    if before:
        yield from _label_lines("do", f"{before}:", width)
    yield from _command(command[1], width)
    if after := text[command.end() :].strip(" ,;:`"):
        yield from _label_lines("", after, width)


def rows_of_plan(results: Iterable[Mapping[str, Any]]) -> tuple[int, int, int]:
    """Count rows to add, change and remove in the plans; for a computer, count changes."""
    add_count = change_count = remove_count = 0
    for result in results:
        if "changes" in result:
            change_count += int(result["planned"])
            continue
        diff_lines = [line for line in result["diff"].split("\n") if line.startswith(("+ ", "- "))]
        pairs = _pairs(diff_lines)
        change_count += pairs
        add_count += sum(line.startswith("+ ") for line in diff_lines) - pairs
        remove_count += sum(line.startswith("- ") for line in diff_lines) - pairs
    return add_count, change_count, remove_count


def _pairs(diff_lines: Sequence[str]) -> int:
    """Count rows changed in place: an old line directly followed by the new line of the same row."""
    return sum(old.startswith("- set") and new.startswith("+ set") for old, new in pairwise(diff_lines))
