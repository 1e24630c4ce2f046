"""Checks of the assumptions on a device: read-only requests with pure evaluation, and tests with scratch rows.

Scratch rows are disabled rows that nothing uses (static DNS names, a bridge with a route, a scheduler job), added and
undone under safe mode. They are never left behind: what safe mode does not undo is removed, and if a device does not
confirm that they are gone, its state is unknown.
"""

from __future__ import annotations

import asyncio
import re
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.errors import DeviceError, OutcomeUnknown
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.routeros import api, pin, safe_mode
from atlantis_netcfg.routeros.assumptions import ASSUMPTIONS, TRY
from atlantis_netcfg.routeros.commands import build_completion_query, refusal, script_command

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from atlantis_netcfg.routeros._types import Row

MARK: Final = "atlantis: scratch row of verify"
"""Comment by which a person recognises the scratch rows."""
CLOSE_S: Final = 10.0
UNDO_S: Final = 720.0
"""Maximum time for which a dead session keeps safe mode: about nine minutes, and a margin."""
_SOON_S: Final = 60.0
"""Timeout for changes to be undone when the device knows of the end of the session."""
_MENU: Final = "/ip/dns/static"
_SAFE_MODE: Final = safe_mode.ApiSafeMode()
_ISO = re.compile(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d")
_TIME = re.compile(r"(\d+(\.\d+)?(ms|us|[wdhms]))+|(\d+[wd])*\d\d:\d\d:\d\d(\.\d+)?")
_SHARE = re.compile(r"\d+(\.\d+)?%?")
_NAMES_A_ROW = re.compile(r"/(set|remove|move|enable|disable|comment|unset)\b|[ /](set|remove|move|unset) ")


Judgement = tuple[Verdict, str]
_WHO = re.compile(r"\S+@(?=\S)|\b\d{1,3}(?:\.\d{1,3}){3}\b|\b[0-9A-Fa-f]{0,4}(?::[0-9A-Fa-f]{0,4}){3,}")
"""A user before an address, addresses of either family, MAC addresses: they may occur in a device's messages."""


@dataclass(frozen=True, slots=True)
class AssumptionFinding:
    """Result of one assumption on a device."""

    id: str
    verdict: Verdict
    """PASS: it holds; FAIL: it does not; SKIP: cannot be shown on this device now; INCONCLUSIVE: no usable reply."""
    evidence: str
    """Evidence without addresses and user names: it is sent to others."""

    @classmethod
    def of(cls, name: str, judgement: Judgement) -> AssumptionFinding:
        """Create a finding; MAC addresses and the like in the device's evidence are replaced."""
        verdict, evidence = judgement
        return cls(name, verdict, _WHO.sub("…", evidence))


@dataclass(frozen=True, slots=True)
class SeenAnswers:
    """Version and board of a device, and one finding for each assumption."""

    version: str
    board: str
    architecture: str
    findings: tuple[AssumptionFinding, ...] = field(default=())
    system: str = "RouterOS"

    def with_findings(self, updates: Iterable[AssumptionFinding]) -> SeenAnswers:
        """Return a copy with these findings in place of those on the same assumptions."""
        fresh = {finding.id: finding for finding in updates}
        return replace(self, findings=tuple(fresh.get(finding.id, finding) for finding in self.findings))


@dataclass(frozen=True, slots=True)
class AssumptionCheck:
    """Read-only requests, and the function that evaluates the replies."""

    questions: tuple[api.Command, ...]
    judge: Callable[[Sequence[api.Reply]], Judgement]


def _print(menu: str, properties: str) -> api.Command:
    return api.Command(f"{menu}/print", ((".proplist", properties),))


def _refusal_text(reply: api.Reply) -> str | None:
    """Return the device's message if it has refused the request; None otherwise."""
    return None if reply.trap is None else msg(f"refused: {arg(reply.trap.message)}")


def _judge_unknown_property(replies: Sequence[api.Reply]) -> Judgement:
    (reply,) = replies
    words = _refusal_text(reply)
    if words is not None:
        return Verdict.FAIL, words
    if len(reply.rows) == 1 and "name" in reply.rows[0] and "atlantis-unknown" not in reply.rows[0]:
        return Verdict.PASS, "ignored; the known property was returned"
    return Verdict.FAIL, msg(f"{arg(len(reply.rows))} rows, none with only the known property")


def _judge_count(replies: Sequence[api.Reply]) -> Judgement:
    number, list_reply = replies
    words = _refusal_text(number)
    if words is not None or number.ret is None or not number.ret.isdecimal():
        return Verdict.FAIL, words or msg(f"no number, and {arg(len(number.rows))} rows")
    same = int(number.ret) == len(list_reply.rows)
    return (Verdict.PASS if same else Verdict.FAIL), msg(
        f"counted {arg(number.ret)}, listed {arg(len(list_reply.rows))}"
    )


def _order(rows: Sequence[Row], moment: str) -> Verdict | None:
    """Return PASS if oldest first, FAIL if newest first, None if unclear; by times, else by ids."""
    times = [row.get(moment, "") for row in rows]
    ids = [int(row[".id"].removeprefix("*"), 16) for row in rows if re.fullmatch(r"\*[0-9A-Fa-f]+", row.get(".id", ""))]
    clear = all(map(_ISO.fullmatch, times)) and len(set(times)) > 1
    keys: Sequence[str | int] = times if clear else ids if len(ids) == len(rows) else []
    pairs = list(pairwise(keys))
    if pairs and all(str(a) <= str(b) if clear else int(a) < int(b) for a, b in pairs):
        return Verdict.PASS
    if pairs and all(str(a) >= str(b) if clear else int(a) > int(b) for a, b in pairs):
        return Verdict.FAIL
    return None


def _judge_sessions(replies: Sequence[api.Reply]) -> Judgement:
    (reply,) = replies
    if reply.trap is not None:
        return Verdict.INCONCLUSIVE, str(_refusal_text(reply))
    order = _order(reply.rows, "when")
    if order is None:
        return Verdict.INCONCLUSIVE, msg(f"{arg(len(reply.rows))} sessions, in no visible order")
    return order, msg(f"{arg(len(reply.rows))} sessions, {'oldest' if order is Verdict.PASS else 'newest'} first")


def _judge_history_order(replies: Sequence[api.Reply]) -> Judgement:
    (reply,) = replies
    if reply.trap is not None:
        return Verdict.INCONCLUSIVE, str(_refusal_text(reply))
    if len(reply.rows) < 2:  # noqa: PLR2004 - an order needs two
        return (
            Verdict.SKIP,
            msg(f"{arg(len(reply.rows))} entries in the history: change something, then run the same command again"),
        )
    order = _order(reply.rows, "time")
    if order is None:
        return Verdict.INCONCLUSIVE, msg(f"{arg(len(reply.rows))} entries, in no visible order")
    verdict = {Verdict.PASS: Verdict.FAIL, Verdict.FAIL: Verdict.PASS}[order]
    return verdict, msg(f"{arg(len(reply.rows))} entries, {'newest' if verdict is Verdict.PASS else 'oldest'} first")


def _judge_history_names(replies: Sequence[api.Reply]) -> Judgement:
    (reply,) = replies
    if reply.trap is not None:
        return Verdict.INCONCLUSIVE, str(_refusal_text(reply))
    commands = [row.get(name, "") for row in reply.rows for name in ("undo", "redo")]
    about = [command for command in commands if _NAMES_A_ROW.search(command)]
    if not about:
        return (
            Verdict.SKIP,
            msg(
                f"{arg(len(reply.rows))} entries, none of an existing row: change one, then run the same command again"
            ),
        )
    naming = [command for command in about if re.search(r"\*[0-9A-Fa-f]+", command)]
    # Settings have no row to name, so that a few may name none.
    return (Verdict.PASS if naming else Verdict.FAIL), msg(
        f"{arg(len(naming))} of {arg(len(about))} commands name an .id"
    )


def _judge_netwatch(replies: Sequence[api.Reply]) -> Judgement:
    (reply,) = replies
    if reply.trap is not None:
        return Verdict.SKIP, str(_refusal_text(reply))
    values = [(row[name], form) for row in reply.rows for name, form in _NETWATCH.items() if row.get(name)]
    if not values:
        return Verdict.SKIP, "there is no netwatch row"
    other = next((value for value, form in values if not form.fullmatch(value)), None)
    return (Verdict.PASS, msg(f"{arg(len(values))} values")) if other is None else (Verdict.FAIL, f"`{other}`")


_FROM_B_TO_T = ("?<name=b", "?#!", "?<name=t", "?#&")


def _judge_text_order(replies: Sequence[api.Reply]) -> Judgement:
    every, some = ([row.get("name", "") for row in reply.rows] for reply in replies)
    between = [name for name in every if "b" <= name < "t"]
    if not 0 < len(between) < len(every):
        return Verdict.INCONCLUSIVE, msg(f"of {arg(len(every))} services {arg(len(between))} lie between b and t")
    return (Verdict.PASS if some == between else Verdict.FAIL), msg(
        f"{arg(join(', ', some) or 'none')} between b and t"
    )


_NETWATCH = {"interval": _TIME, "timeout": _TIME, "thr-loss-percent": _SHARE}


def _judge_pin_words(replies: Sequence[api.Reply]) -> Judgement:
    _, reply = replies
    if reply.trap is not None or not reply.rows:
        return Verdict.SKIP, "there is no modem"
    word = reply.rows[0].get("pin-status")
    if word is None:
        return Verdict.SKIP, "the modem does not mention a PIN"
    is_known = pin.sim_of({"pin-status": word}) is not pin.PinSim.UNKNOWN
    return (Verdict.PASS if is_known else Verdict.FAIL), f"`{word}`"


def _judge_ping(replies: Sequence[api.Reply]) -> Judgement:
    (reply,) = replies
    if reply.trap is None:
        return Verdict.PASS, msg(f"{arg(len(reply.rows))} responses of the device to itself")
    missing = reply.trap.message.startswith(("no such command", "bad command name"))
    return (Verdict.FAIL if missing else Verdict.INCONCLUSIVE), str(_refusal_text(reply))


def _parse(line: str) -> api.Command:
    """Return the command that lets the device parse a line without executing it."""
    return script_command(f':put [:parse "{line}"]')


def _judge_refusal(replies: Sequence[api.Reply]) -> Judgement | None:
    """Return SKIP if the device lacks the commands, INCONCLUSIVE for another refusal, None if none was refused."""
    trap = next((reply.trap for reply in replies if reply.trap is not None), None)
    if trap is None:
        return None
    missing = trap.message.startswith(("no such command", "bad command name", "unknown parameter"))
    return (Verdict.SKIP if missing else Verdict.INCONCLUSIVE), msg(f"refused: {arg(trap.message)}")


_PARSE_LINES = ("/system/identity/print", "/system/identity/set atlantis=no", "/atlantis")
"""A line that every version accepts, one with an unknown argument, one with an unknown menu."""


def _judge_parse_words(replies: Sequence[api.Reply]) -> Judgement:
    judgement = _judge_refusal(replies)
    if judgement is not None:
        return judgement
    valid_text, *wrong = [(reply.ret or "").strip() for reply in replies]
    if not valid_text.startswith("(evl /"):
        return Verdict.FAIL, msg(f"for a valid line it prints `{arg(valid_text)}`")
    other = next((text for text in wrong if not refusal(text)), None)
    return (
        (Verdict.PASS, f"`{wrong[0]}`")
        if other is None
        else (Verdict.FAIL, msg(f"for an invalid line it prints `{arg(other)}`"))
    )


def _judge_parse_nested(replies: Sequence[api.Reply]) -> Judgement:
    judgement = _judge_refusal(replies)
    if judgement is not None:
        return judgement
    text = (replies[0].ret or "").strip()
    return (Verdict.PASS if text == "atlantis" else Verdict.FAIL), msg(f"the inner script's output is `{arg(text)}`")


def _ambiguous(replies: Sequence[api.Reply]) -> Judgement:
    """Compare the replies for an ambiguous name and an unknown name, which should differ in the name only."""
    judgement = _judge_refusal(replies)
    if judgement is not None:
        return judgement
    several, nobody = [(reply.ret or "").strip() for reply in replies]
    if nobody.startswith("(evl /") or not nobody:
        return Verdict.INCONCLUSIVE, msg(f"for an unknown argument it prints `{arg(nobody)}`")
    # The column may be that behind the name.
    same = re.sub(r"\bco\b|column \d+", "", several) == re.sub(r"\batlantis\b|column \d+", "", nobody)
    return (Verdict.PASS if same else Verdict.FAIL), f"`{several}`"


_LIST_ARGUMENT = ("/interface/bridge", "protocol-mode")
_QUERY_WORDS = ("none", "rstp")
_TIMES = 10
"""Number of requests for the same list: over the API a long list sometimes loses a word."""


def _judge_inspection(replies: Sequence[api.Reply]) -> Judgement:
    judgement = _judge_refusal(replies)
    if judgement is not None:
        return judgement
    *lists, query_result = [tuple(sorted(row.get("completion", "") for row in reply.rows)) for reply in replies]
    if not set(_QUERY_WORDS) < set(lists[0]):
        return Verdict.FAIL, msg(f"the list of `{arg(_LIST_ARGUMENT[1])}` is {arg(join(', ', lists[0]) or 'empty')}")
    if len(set(lists)) > 1:
        return Verdict.FAIL, msg(f"{arg(len(set(lists)))} different lists in {arg(len(lists))} responses")
    return (Verdict.PASS if query_result == _QUERY_WORDS else Verdict.FAIL), msg(
        f"the same {arg(len(lists[0]))} words in {arg(len(lists))} responses, of which a query selects "
        f"{arg(join(', ', query_result) or 'none')}"
    )


CHECKS: Final[Mapping[str, AssumptionCheck]] = {
    "api-unknown-property": AssumptionCheck(
        (_print("/system/identity", "name,atlantis-unknown"),), _judge_unknown_property
    ),
    "api-count-only": AssumptionCheck(
        (api.Command("/ip/service/print", (("count-only", ""),)), _print("/ip/service", ".id")),
        _judge_count,
    ),
    "api-query-order": AssumptionCheck(
        (_print("/ip/service", "name"), replace(_print("/ip/service", "name"), queries=_FROM_B_TO_T)), _judge_text_order
    ),
    "api-sessions-newest-last": AssumptionCheck((_print("/user/active", ".id,when"),), _judge_sessions),
    "api-ping-path": AssumptionCheck(
        (api.Command("/tool/ping", (("address", "127.0.0.1"), ("count", "1"))),), _judge_ping
    ),
    "history-names-ids": AssumptionCheck((_print("/system/history", ".id,time,undo,redo"),), _judge_history_names),
    "history-newest-first": AssumptionCheck((_print("/system/history", ".id,time"),), _judge_history_order),
    "netwatch-values": AssumptionCheck((_print("/tool/netwatch", ",".join(_NETWATCH)),), _judge_netwatch),
    "lte-pin-words": AssumptionCheck((pin.MODEMS, pin.MONITOR), _judge_pin_words),
    "parse-words": AssumptionCheck(tuple(map(_parse, _PARSE_LINES)), _judge_parse_words),
    "parse-nested": AssumptionCheck(
        (script_command(':put [:execute script=":put atlantis" as-string]'),), _judge_parse_nested
    ),
    "console-ambiguous": AssumptionCheck(
        (_parse("/ip/address/add co=x"), _parse("/ip/address/add atlantis=x")), _ambiguous
    ),
    "inspect-whole": AssumptionCheck(
        (
            *[build_completion_query(*_LIST_ARGUMENT)] * _TIMES,
            build_completion_query(*_LIST_ARGUMENT, among=_QUERY_WORDS),
        ),
        _judge_inspection,
    ),
}
"""Checks of single replies. `api-flight-100` and `tls-version` are shown by `read`: they belong to the session."""
_RESOURCE = _print("/system/resource", "version,board-name,architecture-name")


async def read(endpoint: api.Endpoint) -> SeenAnswers:
    """Check what can be checked read-only, in two sessions. Raises DeviceError."""
    narrow: list[bool] = []

    def on_window_shrink() -> None:
        narrow.append(True)
        endpoint.on_window_shrink()

    large = replace(endpoint, window=api.READING_WINDOW, on_window_shrink=on_window_shrink)
    # Both at once, so that the device has two sessions to list.
    async with await api.Session.open(endpoint) as session, await api.Session.open(large) as other:
        many = await other.flight([_print("/system/identity", ".id")] * api.READING_WINDOW)
        questions = [question for check in CHECKS.values() for question in check.questions]
        resource, *replies = await session.flight([_RESOURCE, *questions])
        monitor = pin.monitor_of(replies[questions.index(pin.MODEMS)].rows)
        if monitor != pin.MONITOR:
            replies[questions.index(pin.MONITOR)] = await session.command(monitor)
        tls = session.tls_version
    silent = msg(f"no response with {arg(api.READING_WINDOW)} requests in flight, responses with {arg(api.WINDOW)}")
    judgements = {
        "api-flight-100": (Verdict.FAIL, silent) if narrow else (Verdict.PASS, msg(f"{arg(len(many))} responses")),
        "tls-version": (Verdict.PASS if tls == "TLSv1.2" else Verdict.FAIL, tls),
    }
    for name, check in CHECKS.items():
        mine, replies = replies[: len(check.questions)], replies[len(check.questions) :]
        unread = next((reply for reply in mine if _is_forbidden(reply)), None)
        judgements[name] = check.judge(mine) if unread is None else (Verdict.INCONCLUSIVE, str(_refusal_text(unread)))
    row = next(iter(resource.check().rows), {})
    findings = tuple(
        AssumptionFinding.of(each.id, judgements.get(each.id, (Verdict.SKIP, each.proof))) for each in ASSUMPTIONS
    )
    return SeenAnswers(row.get("version", ""), row.get("board-name", ""), row.get("architecture-name", ""), findings)


def _is_forbidden(reply: api.Reply) -> bool:
    return reply.trap is not None and reply.trap.message.startswith("not enough permissions")


# With scratch rows.

TRIES: Final = tuple(each.id for each in ASSUMPTIONS if each.proof == TRY)
"""Assumptions that `try_out` shows."""


def _scratch_arguments(name: str) -> tuple[tuple[str, str], ...]:
    return (
        ("name", f"{name}.atlantis.invalid"),
        ("address", "192.0.2.1"),
        ("disabled", "yes"),
        ("comment", MARK),
    )


def _add_command(name: str) -> api.Command:
    return api.Command(f"{_MENU}/add", _scratch_arguments(name))


def _add_line(name: str) -> str:
    words = " ".join(f'{key}="{value}"' for key, value in _scratch_arguments(name))
    return f"/ip dns static add {words}\n"


def _scratch_query(menu: str) -> api.Command:
    return api.Command(f"{menu}/print", ((".proplist", ".id,name"),), (f"?comment={MARK}",))


_SCRATCH_ROWS = _scratch_query(_MENU)
_ROUTE, _BRIDGE, _JOB = "/ip/route", "/interface/bridge", "/system/scheduler"
_SCRATCH_MENUS = (_MENU, _ROUTE, _BRIDGE, _JOB)
"""Menus with scratch rows, in the order of removal."""
_EVERY_MARKED = tuple(map(_scratch_query, _SCRATCH_MENUS))
_BY_HAND = join(
    "; ", (f'{menu.replace("/", " ").replace(" ", "/", 1)} remove [find comment="{MARK}"]' for menu in _SCRATCH_MENUS)
)
_ALL = _print(_MENU, ".id")
_HISTORY = _print("/system/history", ".id")
_SCRIPT_ROWS: Final = 3
"""Number of rows that the first script adds."""
_NOT_TRIED = (Verdict.INCONCLUSIVE, "not tried: the session was already lost")


async def try_out(endpoint: api.Endpoint) -> tuple[AssumptionFinding, ...]:
    """Check what needs scratch rows. Raises DeviceError (device unchanged) or OutcomeUnknown (rows may be left)."""
    judgements: dict[str, Judgement] = dict.fromkeys(TRIES, _NOT_TRIED)
    async with await api.Session.open(endpoint) as watcher:
        await _refuse(watcher)
        try:
            with suppress(api.SessionLost):
                await _by_rows(endpoint, watcher, judgements)
            await _clean_up(endpoint)
            with suppress(api.SessionLost):
                await _by_two(endpoint, watcher, judgements)
            with suppress(api.SessionLost):
                await _by_close(endpoint, watcher, judgements)
        finally:
            await _clean_up(endpoint)
    return tuple(AssumptionFinding.of(name, judgement) for name, judgement in judgements.items())


async def _refuse(session: api.Session) -> None:
    """Raise DeviceError if there is no safe mode, somebody holds it, or scratch rows of an earlier test exist."""
    state, *replies = await session.flight([safe_mode.READ, *_EVERY_MARKED])
    if state.trap is not None:
        raise DeviceError(
            "nothing was tried: this device has no safe mode over the API",
            hint="it exists since RouterOS 7.18; without `--try` the device is only read",
        )
    if safe_mode.Holder.of(state).is_taken:
        raise DeviceError(
            "nothing was tried: somebody else holds safe mode on this device",
            hint=(
                "wait until they have ended, or ten minutes if their link was lost; without `--try` the device is "
                "only read"
            ),
        )
    leftover_count = sum(len(reply.check().rows) for reply in replies)
    if leftover_count:
        raise DeviceError(
            f"nothing was tried: {arg(leftover_count)} scratch rows of an earlier try are left",
            hint=f"on the device:  {arg(_BY_HAND)}",
        )


async def _by_rows(endpoint: api.Endpoint, watcher: api.Session, judgements: dict[str, Judgement]) -> None:
    """Add rows by sentences and by scripts under safe mode, then undo everything."""
    before = [row.get(".id") for row in (await watcher.command(_ALL)).check().rows]
    async with await api.Session.open(endpoint) as session:
        await _SAFE_MODE.take(session)
        try:
            replies = await session.flight([_add_command(f"flight-{number}") for number in range(api.WINDOW)])
        except api.SessionLost:
            judgements["api-flight-24"] = (
                Verdict.FAIL,
                msg(f"the session was lost with {arg(api.WINDOW)} writes in flight"),
            )
            raise
        judgements["api-flight-24"] = (Verdict.PASS, msg(f"{arg(len(replies))} responses"))
        judgements["api-tagged-order"], ids = _judge_id_order(replies)
        if ids:
            await session.command(api.Command(f"{_MENU}/remove", ((".id", f"*{max(ids):X}"),)))
            again = _parse_row_id((await session.command(_add_command("again"))).ret)
            has_grown = again is not None and again > max(ids)
            words = "greater than all before it" if has_grown else "not greater than all before it"
            judgements["api-ids-grow"] = (
                Verdict.PASS if has_grown else Verdict.FAIL,
                msg(f"the .id after a removal is {arg(words)}"),
            )
        await _by_scripts(session, judgements)
        judgements["name-in-routes"] = await _by_name(session)
        judgements["on-event-60k"] = await _by_job(session)
        await session.command(safe_mode.UNROLL)
    after = [row.get(".id") for row in (await watcher.command(_ALL)).check().rows]
    scratch_rows = (await watcher.command(_SCRATCH_ROWS)).check().rows
    script_rows = [row for row in scratch_rows if row.get("name", "").startswith("script-")]
    if script_rows:
        judgements["safe-mode-undoes-scripts"] = (Verdict.FAIL, msg(f"{arg(len(script_rows))} script rows are left"))
    elif after != before:
        judgements["safe-mode-undoes-scripts"] = (Verdict.INCONCLUSIVE, "the menu is not as before the test")
    elif judgements["execute-stops"][0] is not Verdict.INCONCLUSIVE:
        judgements["safe-mode-undoes-scripts"] = (Verdict.PASS, "all rows are gone, the menu is as before the test")


def _parse_row_id(text: str | None) -> int | None:
    return int(text[1:], 16) if text is not None and re.fullmatch(r"\*[0-9A-Fa-f]+", text) else None


def _judge_id_order(replies: Sequence[api.Reply]) -> tuple[Judgement, list[int]]:
    ids = [_parse_row_id(reply.ret) for reply in replies]
    known_ids = [each for each in ids if each is not None]
    if len(known_ids) < len(ids):
        words = next(
            (_refusal_text(reply) for reply in replies if reply.trap is not None), "the response contains no .id"
        )
        return (Verdict.INCONCLUSIVE, str(words)), []
    rising = all(a < b for a, b in pairwise(known_ids))
    words = "in the order of sending" if rising else "not in the order of sending"
    return (
        Verdict.PASS if rising else Verdict.FAIL,
        msg(f"{arg(len(known_ids))} rows were added {arg(words)}"),
    ), known_ids


async def _by_scripts(session: api.Session, judgements: dict[str, Judgement]) -> None:
    """Run a correct script, and one with an error in the middle."""
    before = _ids(await session.command(_HISTORY))
    right = await session.command(
        _script_command("".join(_add_line(f"script-{number}") for number in range(_SCRIPT_ROWS)))
    )
    after = _ids(await session.command(_HISTORY))
    if right.trap is not None:
        missing = right.trap.message.startswith("no such command")
        words = str(_refusal_text(right))
        judgements["execute-error-text"] = (Verdict.FAIL if missing else Verdict.INCONCLUSIVE, words)
        for name in ("safe-mode-counts-rows", "safe-mode-undoes-scripts", "execute-stops"):
            judgements[name] = (Verdict.INCONCLUSIVE, words)
        return
    # The rows that were added before have left entries: none at all says nothing.
    number = len(after - before)
    verdict = (
        Verdict.INCONCLUSIVE if not before or not after else Verdict.PASS if number == _SCRIPT_ROWS else Verdict.FAIL
    )
    judgements["safe-mode-counts-rows"] = (verdict, msg(f"{arg(number)} entries for {arg(_SCRIPT_ROWS)} rows"))
    wrong = await session.command(
        _script_command(
            f'{_add_line("script-first")}/ip dns static set *FFFFFF comment="{MARK}"\n{_add_line("script-after")}'
        )
    )
    if wrong.trap is not None:
        judgements["execute-error-text"] = (Verdict.FAIL, f"`!trap` {wrong.trap.message}")
    else:
        is_confirmed = "no such item" in (wrong.ret or "")
        judgements["execute-error-text"] = (
            Verdict.PASS if is_confirmed else Verdict.FAIL,
            msg(f"the output is `{arg(wrong.ret or '')}`"),
        )
    names = {row.get("name", "").partition(".")[0] for row in (await session.command(_SCRATCH_ROWS)).check().rows}
    if "script-first" not in names:
        judgements["execute-stops"] = (Verdict.INCONCLUSIVE, "the line before the error was not executed either")
    elif "script-after" in names:
        judgements["execute-stops"] = (Verdict.FAIL, "the line after the error was executed")
    else:
        judgements["execute-stops"] = (
            Verdict.PASS,
            "the line before the error was executed, the line after it was not",
        )


_BEFORE, _AFTER = "atlantis-verify", "atlantis-verified"


async def _by_name(session: api.Session) -> Judgement:
    """Rename a bridge, and read the route that refers to it."""
    bridge = (("name", _BEFORE), ("disabled", "yes"), ("comment", MARK))
    route = (("dst-address", "192.0.2.0/24"), ("gateway", _BEFORE), ("disabled", "yes"), ("comment", MARK))
    ids: list[str] = []
    for menu, values in ((_BRIDGE, bridge), (_ROUTE, route)):
        reply = await session.command(api.Command(f"{menu}/add", values))
        if reply.trap is not None or reply.ret is None:
            return Verdict.INCONCLUSIVE, _refusal_text(reply) or "the response contains no .id"
        ids.append(reply.ret)
    rename_reply = await session.command(api.Command(f"{_BRIDGE}/set", ((".id", ids[0]), ("name", _AFTER))))
    if rename_reply.trap is not None:
        return Verdict.INCONCLUSIVE, str(_refusal_text(rename_reply))
    route_reply = await session.command(replace(_print(_ROUTE, "gateway"), queries=(f"?.id={ids[1]}",)))
    gateway = next((row.get("gateway", "") for row in route_reply.rows), "")
    return (Verdict.PASS if gateway == _AFTER else Verdict.FAIL), msg(
        f"renamed to {arg(_AFTER)}, the route shows `{arg(gateway)}`"
    )


ON_EVENT: Final = 60_000
"""Bytes of the largest job that the engine writes."""


async def _by_job(session: api.Session) -> Judgement:
    """Add a long job that never runs, and read back its stored text."""
    words = (("name", _BEFORE), ("disabled", "yes"), ("comment", MARK), ("on-event", "#" * ON_EVENT))
    add_reply = await session.command(api.Command(f"{_JOB}/add", words))
    if add_reply.trap is not None:
        return Verdict.FAIL, str(_refusal_text(add_reply))
    job_reply = await session.command(replace(_print(_JOB, "on-event"), queries=(f"?comment={MARK}",)))
    if job_reply.trap is not None or len(job_reply.rows) != 1:
        return Verdict.INCONCLUSIVE, _refusal_text(job_reply) or msg(f"{arg(len(job_reply.rows))} jobs are shown")
    stored_bytes = len(job_reply.rows[0].get("on-event", ""))
    return (Verdict.PASS if stored_bytes == ON_EVENT else Verdict.FAIL), msg(
        f"of {arg(ON_EVENT):,} bytes it stored {arg(stored_bytes):,}"
    )


def _ids(reply: api.Reply) -> set[str]:
    return {row[".id"] for row in reply.rows if ".id" in row}


def _script_command(text: str) -> api.Command:
    return api.Command("/execute", (("script", text), ("as-string", "")))


async def _by_two(endpoint: api.Endpoint, watcher: api.Session, judgements: dict[str, Judgement]) -> None:
    """Let a second session take safe mode from the first, which has made no changes."""
    async with await api.Session.open(endpoint) as session:
        await _SAFE_MODE.take(session)
        second = await watcher.command(safe_mode.TAKE)
        still, watcher_holds = (await _SAFE_MODE.look(session)).ours, (await _SAFE_MODE.look(watcher)).ours
        if watcher_holds:
            await watcher.command(safe_mode.UNROLL)
        elif still:
            await session.command(safe_mode.UNROLL)
    if second.trap is not None and still and not watcher_holds:
        judgements["safe-mode-second-taker"] = (Verdict.PASS, f"`{second.trap.message}`")
    else:
        words = "was refused" if second.trap is not None else "was not refused"
        outcome = "kept" if still else "lost"
        judgements["safe-mode-second-taker"] = (
            Verdict.FAIL,
            msg(f"the second session {arg(words)}, the first has {arg(outcome)} safe mode"),
        )


async def _by_close(endpoint: api.Endpoint, watcher: api.Session, judgements: dict[str, Judgement]) -> None:
    """Close a session that holds safe mode, and see how long its row stays."""
    async with await api.Session.open(endpoint) as session:
        await _SAFE_MODE.take(session)
        (await session.command(_add_command("close"))).check()
    elapsed_s = await _wait_until_gone(watcher, CLOSE_S)
    if elapsed_s is None:
        judgements["safe-mode-close"] = (Verdict.FAIL, msg(f"not undone {arg(CLOSE_S):.0f} s after the close"))
    else:
        judgements["safe-mode-close"] = (Verdict.PASS, msg(f"undone within {arg(max(1.0, elapsed_s)):.0f} s"))


async def fall_silent(endpoint: api.Endpoint) -> AssumptionFinding:
    """Cut off a session that holds safe mode, and measure when its row is undone. Raises like `try_out`."""
    name = "api-silent-session"
    async with await api.Session.open(endpoint) as session:
        await _refuse(session)
        try:
            await _SAFE_MODE.take(session)
            (await session.command(_add_command("silence"))).check()
            session.fall_silent()
            async with await api.Session.open(endpoint) as watcher:
                elapsed_s = await _wait_until_gone(watcher, UNDO_S, every_s=15.0)
        finally:
            await _clean_up(endpoint)
    if elapsed_s is None:
        judgement = (Verdict.FAIL, msg(f"not undone after {arg(UNDO_S / 60):.0f} minutes"))
    elif elapsed_s < _SOON_S:
        judgement = (
            Verdict.INCONCLUSIVE,
            msg(f"undone within {arg(elapsed_s):.0f} s: the session had ended, it was not just silent"),
        )
    else:
        judgement = (Verdict.PASS, msg(f"undone after {arg(elapsed_s / 60):.1f} minutes of silence"))
    return AssumptionFinding.of(name, judgement)


async def _wait_until_gone(session: api.Session, within_s: float, every_s: float = 1.0) -> float | None:
    """Wait until safe mode is free and no scratch row is left; return the seconds, or None on timeout."""
    clock = asyncio.get_running_loop().time
    start = clock()
    while True:
        state, scratch_reply = await session.flight([safe_mode.READ, _SCRATCH_ROWS])
        if not safe_mode.Holder.of(state).is_taken and not scratch_reply.check().rows:
            return clock() - start
        if clock() - start >= within_s:
            return None
        await asyncio.sleep(every_s)


async def _clean_up(endpoint: api.Endpoint) -> None:
    """Check in a new session that no row is left; remove what safe mode has not undone. Raises OutcomeUnknown."""
    unknown = OutcomeUnknown(
        "the device does not confirm that the scratch rows are gone",
        hint=f"after ten minutes, on the device:  {arg(_BY_HAND)}",
    )
    try:
        async with await api.Session.open(endpoint) as session:
            clock = asyncio.get_running_loop().time
            until = clock() + UNDO_S
            while (await _SAFE_MODE.look(session)).is_taken and clock() < until:  # noqa: ASYNC110 - the device tells when
                await asyncio.sleep(1.0)
            for menu, scratch_reply in zip(_SCRATCH_MENUS, await session.flight(_EVERY_MARKED), strict=True):
                ids = ",".join(row[".id"] for row in scratch_reply.check().rows)
                if ids:
                    (await session.command(api.Command(f"{menu}/remove", ((".id", ids),)))).check()
            state, *leftover_replies = await session.flight([safe_mode.READ, *_EVERY_MARKED])
            if safe_mode.Holder.of(state).is_taken or any(reply.check().rows for reply in leftover_replies):
                raise unknown
    except DeviceError as lost:
        raise unknown from lost
