"""Cost of a run on the link in use: a model of what the executor sends, with real sizes if known.

A run without changes logs in and reads. A run with changes also takes safe mode, saves the export, sends one script for
each part that safe mode can record, reads back in a new session, and releases.

Round trips and bytes are counted as in a run's report: TCP payload, handshakes and TLS included.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.routeros import _types, observe
from atlantis_netcfg.routeros.api import READING_WINDOW, WINDOW
from atlantis_netcfg.routeros.commands import Examination, console
from atlantis_netcfg.routeros.diff import existing_row
from atlantis_netcfg.routeros.menus import MARK, MENUS
from atlantis_netcfg.routeros.pin import LTE
from atlantis_netcfg.routeros.planner import simulate
from atlantis_netcfg.routeros.safe_mode import BUDGET

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence


PREFLIGHT: Final = 6
"""Sentences that request facts about the device itself."""
AGAIN: Final = 2
"""Number of those sentences when a run reads the device a second time."""
SCRIPT: Final = 60_000
"""Maximum bytes of one script."""
HANDSHAKE_TRIPS: Final = 3
"""Round trips before the login: one for TCP, two for TLS 1.2. Assumption: tls-version"""
CHECKPOINT_TRIPS: Final = 2
"""Round trips to release safe mode and take it again; the session that verifies access is added."""
RECORD_BYTES: Final = 29
"""Bytes that TLS 1.2 adds to a record; a device sends about one record for each reply."""
HANDSHAKE_BYTES: Final = 1_800
"""Certificate and keys of one session, both directions: fewer with an elliptic-curve key, more with RSA."""
HEADERS: Final = 0.12
"""Overhead bytes per byte of TCP payload: TCP and IP headers, acknowledgements."""
CONNECTION_BYTES: Final = 600
"""Bytes of the packets without payload that open and close a connection."""
EXECUTE_S: Final = 0.01
"""Seconds that a device needs for one action of a script."""
READ_S: Final = 0.05
"""Seconds that a device needs for one batch of reads."""
LOGIN_BYTES: Final = 60
TAG_BYTES: Final = 9
"""Bytes of `.tag=` and a number, in a sentence and in every reply."""
DONE_BYTES: Final = 16
"""Bytes of `!done` with its tag."""
LATER_UP: Final = 400
LATER_DOWN: Final = 1_900
"""Bytes for users, groups, certificates and device-mode, which are read before a change."""
PARSE_FACTOR: Final = 1.3
"""Maximum bytes sent per byte of script when the device's parser checks it first."""
CONTROL_DOWN: Final = 60
"""Bytes of the parser's reply without errors: only the refusal of the control command."""
OFFERED_DOWN: Final = 60
"""Bytes of one word of a completion list, with its tag and its record."""
COUNT_UP: Final = 45
COUNT_DOWN: Final = 25
"""Bytes of the request for a menu's row count (`COUNT_UP`), and of the reply."""
PREFLIGHT_UP: Final = 400
PREFLIGHT_DOWN: Final = 1_500
"""Bytes of the device's facts; `/system/device-mode` is the longest."""
EXPORT_HEAD: Final = 200
TYPICAL_MENUS: Final = tuple(
    path
    for path in MENUS
    if path == "/interface/wifi"
    or (path != "/routing/settings" and not path.startswith(("/interface/wi", "/interface/w60g", "/interface/lte")))
)
"""Menus of a site's router: the radio of an access point; no settings whose arguments need RouterOS 7.21."""
TYPICAL_ROWS: Final = 55_000
"""Bytes of all rows of a configured router, for a device that was not read yet."""
TYPICAL_EXPORT: Final = 32_000
TYPICAL_LINE: Final = 80
"""Bytes of one line of a desired text."""
TYPICAL_FOREIGN: Final = {"list": "blocklist", "address": "198.51.100.100", "comment": "blocked", "disabled": "false"}
"""A foreign row, for a device that was not read yet."""
MOST_TEXT: Final = 45_000
"""Maximum bytes of a desired text: a third more than the longest of the pilot's routers (checked by a test)."""


@dataclass(frozen=True, slots=True)
class LinkMetrics:
    """The link that carries the session to the device."""

    name: str
    rtt_s: float
    rate_up_bps: float
    rate_down_bps: float
    is_metered: bool


@dataclass(frozen=True, slots=True)
class Estimate:
    """Expected cost of a run."""

    link: str
    round_trips: int
    bytes_up: int
    bytes_down: int
    seconds: float
    sessions: int = 1

    @property
    def bytes(self) -> int:
        """Bytes of both directions, as a run reports them."""
        return self.bytes_up + self.bytes_down

    @property
    def wire_bytes(self) -> int:
        """Bytes of both directions on the wire, as billed for a link; VPN headers are not included."""
        return on_the_wire(self.bytes, self.sessions)


def on_the_wire(payload: int, sessions: int) -> int:
    """Return the bytes on the wire for a TCP payload in so many sessions, TCP and IP headers included."""
    return payload + ceil(payload * HEADERS) + sessions * CONNECTION_BYTES


@dataclass(slots=True)
class _CostTally:
    """Cost so far."""

    round_trips: int = 0
    sessions: int = 0
    up: int = 0
    down: int = 0
    device_s: float = 0.0

    def spend(self, *, trips: int = 1, up: int = 0, down: int = 0, device_s: float = 0.0) -> None:
        self.round_trips += trips
        self.up += up
        self.down += down
        self.device_s += device_s

    def log_in(self) -> None:
        self.sessions += 1
        self.spend(trips=HANDSHAKE_TRIPS, up=HANDSHAKE_BYTES // 3, down=HANDSHAKE_BYTES * 2 // 3)
        self.spend(up=LOGIN_BYTES + RECORD_BYTES, down=TAG_BYTES + RECORD_BYTES)


def _read(
    tally: _CostTally, menus: Sequence[str], rows: Mapping[str, Sequence[_types.Row]] | None, preflight: int = PREFLIGHT
) -> None:
    """Count the cost of reading the device's facts and every menu."""
    # A modem is asked beside it, which is more than reading.
    batches = ceil((preflight + len(menus)) / (WINDOW if LTE in menus else READING_WINDOW))
    answer_bytes = TYPICAL_ROWS if rows is None else sum(_answer(row) for each in rows.values() for row in each)
    tally.spend(
        trips=batches,
        up=PREFLIGHT_UP + sum(map(_question, menus)),
        down=PREFLIGHT_DOWN + answer_bytes + len(menus) * (DONE_BYTES + RECORD_BYTES),
        device_s=batches * READ_S,
    )


def _read_back(
    tally: _CostTally,
    menus: Sequence[str],
    touched_menus: Collection[str],
    rows: Mapping[str, Sequence[_types.Row]] | None,
) -> None:
    """Count the cost of reading back everything, or the changed menus and the row counts of the rest."""
    if rows is None or not observe.LEAVES.issuperset(touched_menus):
        again = [path for path in menus if path in touched_menus or path not in observe.LATER]
        _read(tally, again, rows and {path: rows[path] for path in again}, AGAIN)
        return
    answer_bytes = sum(_answer(row) for path in touched_menus for row in rows.get(path, ()))
    count_queries = len(menus) - len(touched_menus)
    tally.spend(
        up=sum(map(_question, touched_menus)) + count_queries * COUNT_UP,
        down=answer_bytes + count_queries * (COUNT_DOWN + RECORD_BYTES),
        device_s=READ_S,
    )


def _look_again(tally: _CostTally, rows: Mapping[str, Sequence[_types.Row]]) -> None:
    """Count the cost of the second read before the first change; very long menus are only counted."""
    short = {path: there for path, there in rows.items() if len(there) <= _types.FEW_FOREIGN}
    _read(tally, tuple(short), short, PREFLIGHT if len(short) == len(rows) else AGAIN)
    tally.spend(trips=0, up=(len(rows) - len(short)) * COUNT_UP, down=(len(rows) - len(short)) * COUNT_DOWN)


def estimate(plan: _types.Plan, link: LinkMetrics, observation: _types.Observation | None = None) -> Estimate:
    """Estimate the cost of applying a plan; for an empty plan, the cost of the read.

    With `observation`, from which the plan was made, the sizes of reads are real ones instead of typical ones.
    """
    observation = observation and replace(
        observation, rows={path: _whole(rows) for path, rows in observation.rows.items()}
    )
    menus = tuple(observation.rows) if observation is not None else TYPICAL_MENUS
    tally = _CostTally()
    tally.log_in()
    _read(tally, menus, observation.rows if observation is not None else None)
    if plan.actions:
        _change(tally, plan, observation, menus)
    return _build_estimate(tally, link)


def _whole(rows: tuple[_types.Row, ...]) -> tuple[_types.Row, ...]:
    """Assume for each row read by `.id` only the size of the last foreign row that was read in full."""
    if not any(map(_types.is_bare, rows)):
        return rows
    others = (row for row in reversed(rows) if not _types.is_bare(row) and not row.get("comment", "").startswith(MARK))
    sample = next(others, TYPICAL_FOREIGN)
    return tuple({**sample, ".id": row[".id"]} if _types.is_bare(row) else row for row in rows)


def beforehand(link: LinkMetrics, *, writes: bool = False, plans: bool = False, exports: bool = False) -> Estimate:
    """Estimate a run on a device that was not read yet, so that the cost is known before the first byte.

    The device is read once. With `plans`, a whole desired text is checked by its parser. With `writes`, it is also
    written, saved and read back, which is the maximum for a run without failures. `exports`: only its export is read.
    """
    tally = _CostTally()
    tally.log_in()
    if exports:
        tally.spend(up=200, down=TYPICAL_EXPORT + 4 * TAG_BYTES)
        return _build_estimate(tally, link)
    _read(tally, TYPICAL_MENUS, None)
    if plans or writes:
        tally.spend(up=ceil(PARSE_FACTOR * MOST_TEXT) + LATER_UP, down=LATER_DOWN)
    if writes:
        tally.spend(up=200, down=TYPICAL_EXPORT + 4 * TAG_BYTES)
        # As many rows as lines of ordinary length: each is answered by a line, and weighs one in safe mode.
        rows = ceil(MOST_TEXT / TYPICAL_LINE)
        tally.spend(trips=ceil(MOST_TEXT / SCRIPT), up=2 * MOST_TEXT, down=10 * rows, device_s=rows * EXECUTE_S)
        for _ in range(rows // BUDGET):
            tally.log_in()
            tally.spend(trips=1 + CHECKPOINT_TRIPS, up=180, down=180)
        tally.log_in()
        _read(tally, TYPICAL_MENUS, None, AGAIN)
        tally.spend(trips=1, up=120, down=120)
    return _build_estimate(tally, link)


def _build_estimate(tally: _CostTally, link: LinkMetrics) -> Estimate:
    return Estimate(link.name, tally.round_trips, tally.up, tally.down, _seconds(tally, link), tally.sessions)


def _change(
    tally: _CostTally, plan: _types.Plan, observation: _types.Observation | None, menus: tuple[str, ...]
) -> None:
    """Count the cost of parser check, save, safe mode, writes, read-back and release."""
    tally.spend(up=LATER_UP, down=LATER_DOWN)
    _parse(tally, plan, observation)
    stages = _stages(plan)
    # With safe mode from the first change to the last, the state is saved in the round trip that takes it.
    alone = len(stages.pieces) == 1 and not stages.before and not stages.behind
    beside = alone and (observation is None or observation.facts.has_safe_mode)
    tally.spend(trips=not beside, up=200, down=_export_bytes(observation) + 4 * TAG_BYTES)
    if observation is not None and observation.facts.history >= observe.HISTORY - 1:
        _look_again(tally, observation.rows)
    if stages.before:
        _add_script_cost(tally, stages.before)
        tally.spend(up=60, down=60)  # safe mode is taken, which else goes beside what is read later
    for number, piece in enumerate(stages.pieces):
        if number:
            tally.log_in()
            tally.spend(trips=CHECKPOINT_TRIPS, up=180, down=180)
        _add_script_cost(tally, piece)
    if stages.behind:
        _add_script_cost(tally, stages.behind)
    tally.log_in()
    touched_menus = {action.menu for action in plan.actions}
    _read_back(tally, menus, touched_menus, simulate(observation.rows, plan) if observation is not None else None)
    tally.spend(up=60, down=60)


@dataclass(frozen=True, slots=True)
class _StageCosts:
    """How a plan is sent; harmless additions may go outside safe mode, before it or after it."""

    before: list[_types.Action]
    pieces: list[list[_types.Action]]
    behind: list[_types.Action]

    @property
    def trips(self) -> int:
        """Round trips beyond those of one script."""
        checkpoints = max(0, len(self.pieces) - 1)
        return 2 * bool(self.before) + bool(self.behind) + (HANDSHAKE_TRIPS + 2 + CHECKPOINT_TRIPS) * checkpoints


def _stages(plan: _types.Plan) -> _StageCosts:
    """Return the cheapest way to send the plan."""
    ways = ((), (True,), (False,), (True, False))
    return min((_split_stages(plan.actions, outside) for outside in ways), key=lambda stages: stages.trips)


def _split_stages(actions: Sequence[_types.Action], outside: Sequence[bool]) -> _StageCosts:
    """Put harmless additions to the foundation (True), or to other layers (False), outside safe mode."""
    out = [each for each in actions if _is_harmless(each) and (each.layer is _types.Layer.FOUNDATION) in outside]
    numbers = {each.number for each in out}
    return _StageCosts(
        before=[each for each in out if each.layer is _types.Layer.FOUNDATION],
        pieces=list(_pieces(each for each in actions if each.number not in numbers)),
        behind=[each for each in out if each.layer is not _types.Layer.FOUNDATION],
    )


def _is_harmless(action: _types.Action) -> bool:
    return action.inert and action.verb is _types.Verb.ADD


def _pieces(actions: Iterable[_types.Action]) -> Iterator[list[_types.Action]]:
    """Split where safe mode is full; an action on very many rows fills several parts, and is listed in the first."""
    piece: list[_types.Action] = []
    weight = 0
    for action in actions:
        if piece and weight + action.weight > BUDGET:
            yield piece
            piece, weight = [], 0
        piece.append(action)
        weight += action.weight
        while weight > BUDGET:
            yield piece
            piece, weight = [], weight - BUDGET
    if weight:
        yield piece


def _add_script_cost(tally: _CostTally, actions: Sequence[_types.Action]) -> None:
    size = sum(_word(console(action)) + _word(f'\n:put "ok {action.number}"\n') for action in actions)
    reply = sum(len(f"ok {action.number}\r\n") for action in actions)
    trips = max(1, ceil(size / SCRIPT))
    tally.spend(trips=trips, up=size + 40, down=reply + 40, device_s=len(actions) * EXECUTE_S)


def _parse(tally: _CostTally, plan: _types.Plan, observation: _types.Observation | None) -> None:
    """Count the cost of the parser check, which is sent together with the reads before a change."""
    commands = Examination().questions(plan.actions, observation.rows if observation is not None else {})
    up = sum(_word(word) for command in commands for word in command.words()) + len(commands) * (TAG_BYTES + 1)
    words = sum(1 for command in commands for query in command.queries if query != "?#|")
    scripts = sum(1 for command in commands if not command.queries)
    down = scripts * (CONTROL_DOWN + DONE_BYTES) + words * OFFERED_DOWN + len(commands) * RECORD_BYTES
    tally.spend(trips=0, up=up, down=down, device_s=len(plan.actions) * EXECUTE_S)


def _export_bytes(observation: _types.Observation | None) -> int:
    # The firewall is read of every router, but not for an order of its links: the export holds more than that.
    if observation is None or "/ip/firewall/filter" not in observation.rows:
        return TYPICAL_EXPORT
    exported_menus = (
        (MENUS[path], rows) for path, rows in observation.rows.items() if path in MENUS and MENUS[path].is_exported
    )
    return EXPORT_HEAD + sum(len(existing_row(menu, row)) + 2 for menu, rows in exported_menus for row in rows)


def _question(path: str) -> int:
    """Return the size in bytes of the sentence that reads a menu."""
    return sum(map(_word, observe.printing(path).words())) + TAG_BYTES + 1


def _answer(row: _types.Row) -> int:
    """Return the size in bytes of the sentence with one row."""
    return 4 + TAG_BYTES + sum(_word(f"={name}={value}") for name, value in row.items()) + 1


def _word(text: str) -> int:
    """Return the size of one word with its length prefix (manual, API: one byte below 128, two below 16384)."""
    size = len(text.encode("utf-8", "surrogateescape"))
    return size + (1 if size < 0x80 else 2 if size < 0x4000 else 3)  # noqa: PLR2004 - the limits of the format


def _seconds(tally: _CostTally, link: LinkMetrics) -> float:
    up = tally.up * (1 + HEADERS) * 8 / link.rate_up_bps
    down = tally.down * (1 + HEADERS) * 8 / link.rate_down_bps
    return tally.round_trips * link.rtt_s + up + down + tally.device_s
