"""One round: a command meets its fault, a person follows the advice, and strangers see what came of it."""

import contextlib
import fcntl
import json
import os
import shutil
import signal
import subprocess
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.emulator.routeros import ControlError
from campaign import advice
from campaign.command import ORPHAN_S, PYTHON, SILENCE_S, Command, Ended, end, living
from campaign.commands import AFTER_S, AGREED, CHANGING, COMMANDS, SITE, CommandKind
from campaign.faults import FAULTS, Fault, Round, Struck, draw
from campaign.judge import Picture, Stranger, menus_of
from campaign.site import ADDRESSES, Site, Stage, disturb

STEPS = 6
"""So often is advice followed; a person would have asked somebody by then."""
HANG_S = 600.0
DEAD_S = 180.0
"""Without news, and without a record in its journal."""
SETTLE_S = 90.0
"""What a task may need to take back what it has open, once the process that a person has started is killed."""
STRIDE_S = 60.0
"""What passes at the devices for each second for which a run waits in silence."""
BOOT_S = 90.0
"""What a device needs after a power cut; less than what passes before a job of ours runs."""
_POLL_S = 0.02
_STATE_SIZE = "16m"
_AS_DECLARED = ("changed", "unchanged")
"""What a run says of a device that it has read back."""

Pictures = dict[str, Picture]


@dataclass
class Reference:
    flash: Path
    menus: Mapping[str, list[str]]
    declared: Pictures


@dataclass
class Table:
    site: Site
    plan: Round
    store: Path
    menus: Mapping[str, list[str]]
    before: Pictures
    target: Pictures
    """What devices are once the command has ended with its green."""
    final: Pictures = field(default_factory=dict)
    """What they come to by themselves later; without it the target stays."""
    violations: list[str] = field(default_factory=list)
    steps: list[dict[str, Any]] = field(default_factory=list)
    log: list[str] = field(default_factory=list)
    struck: list[str] = field(default_factory=list)
    green: bool = False
    settling: dict[str, str] = field(default_factory=dict)
    """Marks of commands that were killed, of which a task lives on, and what was typed."""

    def wrong(self, what: str) -> None:
        if what not in self.violations:
            self.violations.append(what)

    @property
    def kind(self) -> CommandKind:
        return COMMANDS[self.plan.command]

    @property
    def typed(self) -> tuple[str, ...]:
        return (*self.kind.words, *(("--json",) if self.plan.json else ()))


class Player:
    def __init__(self, stage: Stage, stranger: Stranger, references: Path) -> None:
        self._stage = stage
        self._stranger = stranger
        self._references = references

    def play(self, seed: int) -> dict[str, Any]:
        plan = draw(seed)
        begun = time.monotonic()
        reference = self.reference(plan.version)
        name = f"seed-{seed}"
        shutil.rmtree(self._stage.folder / name, ignore_errors=True)
        flash = None if plan.state == "adopted" else reference.flash
        with self._stage.site(name, plan.state, plan.version, flash) as site, laptop(site.folder / "laptop") as store:
            self._stage.pin(store, site.twins)
            disturb(site, Random(f"drift {seed}"))  # noqa: S311 - a test's seed
            before = self._stranger.read(site, reference.menus)
            table = Table(site, plan, store, reference.menus, before, _with_foreign(reference.declared, before))
            extra = self._prepare(table)
            self._follow(table, extra)
            self._await_settled(table, tuple(table.settling))
            self._judge_the_end(table)
            if table.violations and store.exists():
                shutil.copytree(store, site.folder / "state")
        record = {
            **plan.as_dict(),
            "struck": table.struck,
            "steps": table.steps,
            "green": table.green,
            "violations": table.violations,
            "seconds": round(time.monotonic() - begun, 1),
        }
        folder = self._stage.folder / name
        (folder / "log.txt").write_text("\n".join(table.log), encoding="utf-8")
        if not table.violations:
            shutil.rmtree(folder)
        return record

    # Before.

    def reference(self, version: str) -> Reference:
        """Devices that an undisturbed run has configured: made once, for every process of the campaign."""
        self._references.mkdir(parents=True, exist_ok=True)
        folder = self._references / version
        with (self._references / "lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not folder.exists():
                self._make_reference(version, folder)
        kept = json.loads((folder / "declared.json").read_text(encoding="utf-8"))
        declared = {host: Picture(host, menus) for host, menus in kept.items()}
        return Reference(folder / "flash", {host: list(menus) for host, menus in kept.items()}, declared)

    def _make_reference(self, version: str, folder: Path) -> None:
        name = f"reference-{version}"
        with self._stage.site(name, "adopted", version, None) as site, laptop(site.folder / "laptop") as store:
            self._stage.pin(store, site.twins)
            factory = {host: str(site.do(host, "export")) for host in ADDRESSES}
            ended = self.run(site, store, (f"site={SITE}", *AGREED))
            assert ended.code == 0, ended.output
            menus = {host: menus_of([factory[host], str(site.do(host, "export"))]) for host in ADDRESSES}
            declared = self._stranger.read(site, menus)
            site.skip(3600.0)
            later = self._stranger.read(site, menus)
            for host, picture in declared.items():
                assert not picture.error, picture.error
                assert not later[host].differs(picture), later[host].differs(picture)
                assert not picture.armed, picture.armed
        kept = {host: picture.menus for host, picture in declared.items()}
        making = folder.with_name(f"{version}.making")
        shutil.copytree(self._stage.folder / name / "twins", making / "flash")
        (making / "declared.json").write_text(json.dumps(kept), encoding="utf-8")
        making.rename(folder)

    def _prepare(self, table: Table) -> tuple[str, ...]:
        words = table.kind.prepare(table, _Undisturbed(self, table))
        self._stage.lead(table.site.twins)
        return words

    def run(self, site: Site, store: Path, typed: tuple[str, ...]) -> Ended:
        command = self._command(site, store, typed)
        command.start(PYTHON)
        while command.alive:
            time.sleep(_POLL_S)
        return command.finish()

    @staticmethod
    def _command(site: Site, store: Path, typed: tuple[str, ...]) -> Command:
        environment = {
            **{name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "ATLANTIS"))},
            "ATLANTIS_STATE": str(store),
            "ATLANTIS_NO_MACHINES": "campaign",
            "ANSIBLE_VAULT_PASSWORD_FILE": str(site.inventory.parent / "vault-password"),
        }
        return Command((*typed, f"inventory={site.inventory}"), environment, site.folder)

    def read(self, table: Table) -> Pictures:
        return self._stranger.read(table.site, table.menus)

    # The command, and what its advice leads to.

    def _follow(self, table: Table, extra: tuple[str, ...]) -> None:
        first = (*table.typed, *extra)
        typed, faults = first, list(table.plan.faults)
        seen: dict[object, int] = {}
        for step in range(STEPS):
            fault = faults.pop(0) if faults else None
            earlier = tuple(table.settling)
            ended, struck = self._meet(table, typed, fault)
            self._heal(table)
            found = advice.read(ended.advice_text, SITE)
            self._note(table, ended, found, struck=struck)
            self._await_settled(table, earlier, ended)
            self._judge(table, ended, typed, table.store)
            if (
                advice.name_of(typed) in advice.TERMINAL
            ):  # it asks about a whole site, of which only some devices are here
                typed = first
                continue
            if ended.code in (table.kind.green if typed == first else (0,)):
                table.green = True
                return
            if (
                ended.code == ExitCode.NOTHING
                and advice.name_of(typed) == advice.name_of(table.kind.words)
                and table.kind.needs_a_run
                and _is_lost(table)
            ):
                return
            if found is None and ended.code is not None and ended.code in advice.TABLE:
                found = advice.Advice(advice.TABLE[ended.code], waits=False, text=f"exit {ended.code}")
            elif found is None and ended.code is not None and ended.code > ExitCode.OUR_FAULT:
                table.wrong(f"no advice: `{' '.join(typed)}` ended with {ended.code} and names no next step")
            _judge_advice(table, ended, typed, found)
            key = (ended.typed, ended.code, found and found.text)
            seen[key] = seen.get(key, 0) + 1
            if seen[key] > 2 and not struck:
                table.wrong(
                    f"circle: `{' '.join(typed)}` ended with {ended.code}, advice {found and found.text!r}, thrice"
                )
                return
            repeated = seen[key] > 1 or (found is not None and found.waits and step > 0)
            table.site.skip(3600.0 if repeated else table.plan.pause_s)
            if found is not None and found.typed is not None:
                typed = (*found.typed, *_agreement(found.typed, table.plan))
            elif ended.code is None or ended.code < 0:
                typed = first
        table.wrong(f"no end: after {STEPS} steps of its own advice the command has not come to an end")

    def _meet(self, table: Table, typed: tuple[str, ...], fault: Fault | None) -> tuple[Ended, bool]:
        """Run a command until it ends, with a fault at its moment; time passes faster while it waits after that."""
        site = table.site
        command = self._command(site, table.store, typed)
        command.answer = "yes" if advice.name_of(typed) in advice.TERMINAL else ""
        others: list[Command] = []

        def second() -> None:
            other = self._command(site, table.store.with_name("other"), typed)
            other.start(PYTHON)
            others.append(other)

        trap = Trap(fault, Struck(site, command, table.store, fault, second) if fault else None, table.store)
        trap.watch(command)
        command.start(PYTHON)
        last_skip = time.monotonic()
        killed = False
        while running := [each for each in (command, *others) if each.alive]:
            trap.look()
            now = time.monotonic()
            idle = min((*(each.idle_s for each in running), trap.quiet_s))
            dead = idle > DEAD_S and not command.stopped and "--json" not in typed
            if dead or now - command.begun > HANG_S:
                killed = True
                break
            late = not table.kind.by_the_clock and (trap.sprung or fault is None or idle > SILENCE_S)
            if late and idle > table.plan.quiet_s and now - last_skip > 1.0 and not command.stopped:
                site.skip(STRIDE_S)
                last_skip = now
            time.sleep(_POLL_S)
        site.relay.on_request = lambda _way: None
        ended = command.finish(killed=killed)
        self._judge_orphans(table, command, ended)
        if killed:
            last = f"{command.idle_s:.0f} s after its last news"
            table.wrong(f"hang: `{' '.join(typed)}` was alive after {ended.seconds:.0f} s, {last}")
        for other in others:
            told = other.finish(killed=killed)
            self._judge_orphans(table, other, told)
            self._note(table, told, None, struck=False)
            if told.code == 0 and ended.code is not None:
                self._judge(table, told, typed, table.store.with_name("other"))
        if trap.error:
            table.log.append(f"the fault itself failed: {trap.error}")
        if trap.sprung:
            table.struck.append(str(fault))
        return ended, trap.sprung

    @staticmethod
    def _heal(table: Table) -> None:
        """A person has put right what was wrong around: the link, the disk, the colleague."""
        site = table.site
        site.relay.heal()
        site.do("coastal-cpe", "air", loss_db=0.0)
        (table.store.parent / "ballast").unlink(missing_ok=True)
        while f" {table.store} " in Path("/proc/self/mountinfo").read_text(encoding="utf-8"):
            subprocess.run(["umount", "--lazy", str(table.store)], check=True)

    @staticmethod
    def _note(table: Table, ended: Ended, found: advice.Advice | None, *, struck: bool) -> None:
        words = " ".join(word for word in ended.typed if not word.startswith("inventory="))
        table.steps.append(
            {
                "typed": words,
                "code": ended.code,
                "seconds": round(ended.seconds, 1),
                "silent_s": round(ended.silent_s, 1),
                "struck": struck,
                "advice": found.text if found is not None else None,
            }
        )
        table.log.append(f"$ provision {words}\n{ended.err}\n{ended.out}\n[{ended.code}]\n")

    # Who lives on.

    @staticmethod
    def _judge_orphans(table: Table, command: Command, ended: Ended) -> None:
        """Nobody outlives a command, except for a task whose `provision` was killed: it takes back what it has open.

        It is left alone, as a person would, and the next command meets it; then it has to come to an end by itself.
        """
        words = " ".join(ended.typed)
        if ended.orphans and ended.code == -signal.SIGKILL:
            table.settling[command.mark] = words
        elif ended.orphans:
            for orphan in end(ended.orphans):
                table.wrong(f"orphan: of `{words}` lives on: {orphan}")

    @staticmethod
    def _await_settled(table: Table, marks: Sequence[str], ended: Ended | None = None) -> None:
        """Let time pass at the devices until these tasks have ended; nothing is green while one is still at work."""
        until = time.monotonic() + SETTLE_S
        for mark in marks:
            typed = table.settling.pop(mark)
            left = living(mark, ORPHAN_S)
            if left and ended is not None and ended.code == 0:
                table.wrong(f"green and not alone: a task of `{typed}` lives on after `{' '.join(ended.typed)}`")
            while left and time.monotonic() < until:
                table.site.skip(STRIDE_S)
                left = living(mark, 1.0)
            for orphan in end(left):
                table.wrong(f"orphan: of `{typed}` lives on: {orphan}")

    # What is true.

    def _judge(self, table: Table, ended: Ended, typed: tuple[str, ...], store: Path) -> None:
        """Hold a command to its words."""
        words = " ".join(typed)
        if ended.silent_s > SILENCE_S and "--json" not in typed and not ended.struck:
            table.wrong(f"silent: `{words}` said nothing for {ended.silent_s:.0f} s")
        changes = advice.name_of(typed) in CHANGING and "--plan" not in typed
        table.site.skip(table.kind.settles_s)
        self._judge_results(table, ended, words)
        if ended.code == 0 and changes:
            self._judge_green(table, ended, words)
            for run in ended.runs:
                journals = [path.read_text(encoding="utf-8") for path in store.glob(f"real/*/runs/{run}/journal.jsonl")]
                if not any('"kind":"run-ended"' in text for text in journals):
                    table.wrong(f"green and not recorded: `{words}` says that it is recorded as {run}")
            if not ended.runs and not ended.closed and not ended.changed_nothing:
                table.wrong(f"green and not recorded: `{words}` names no run")
        elif ended.code == 0 and advice.name_of(typed) in {"run", "report drift"}:
            self._judge_green(table, ended, words)
        elif ended.code == 4 and changes:
            for host, picture in self.read(table).items():
                if (
                    not picture.error
                    and not _is(picture, table.before, table)
                    and not _is(picture, table.target, table)
                ):
                    table.wrong(f"exit 4 and between: {host} after `{words}`: {_gap(picture, table)}")

    def _judge_results(self, table: Table, ended: Ended, words: str) -> None:
        """Hold it to what it says of each device, whatever the others came to; only JSON says it without a doubt."""
        devices = (ended.devices or {}).items()
        said = {host: each["status"] for host, each in devices if each.get("status") in _AS_DECLARED}
        pictures = self.read(table) if said else {}
        for host, status in said.items():
            if not pictures[host].error and not _is_as_promised(pictures[host], table, words):
                gap = _gap(pictures[host], table)
                table.wrong(
                    f"{status} and not as in the inventory: {host} after `{words}` ended with {ended.code}: {gap}"
                )

    def _look(self, table: Table) -> Pictures:
        """Read all devices; one that has just lost its power has the time to boot."""
        pictures = self.read(table)
        if any(picture.error for picture in pictures.values()):
            table.site.skip(BOOT_S)
            pictures = self.read(table)
        return pictures

    def _judge_green(self, table: Table, ended: Ended, words: str) -> None:
        for host, picture in self._look(table).items():
            asked = (
                advice.name_of(words.split()) != "recover resume"
                and not _left_out(host, words)
                and (advice.name_of(words.split()) != advice.name_of(table.typed) or host in table.kind.hosts)
                and not (table.kind.needs_a_run and _is(table.before[host], table.target, table))
            )
            if asked and host not in ended.results:
                table.wrong(f"green and missing: `{words}` has no result of {host}")
            if picture.error:
                table.wrong(f"green and out of reach: {host} after `{words}`: {picture.error}")
            elif not _is_as_promised(picture, table, words):
                table.wrong(f"green and not as in the inventory: {host} after `{words}`: {_gap(picture, table)}")
            for left in set(picture.armed) - set(table.target[host].armed):
                table.wrong(f"green and left behind: {host} after `{words}`: {left}")

    def _judge_the_end(self, table: Table) -> None:
        """Look again when all that devices do by themselves has been done."""
        table.site.skip(AFTER_S)
        changes = table.kind.changes
        for host, picture in self.read(table).items():
            if picture.error:
                table.wrong(f"at the end out of reach: {host}: {picture.error}")
                continue
            before, target = _is(picture, table.before, table), _is(picture, table.final or table.target, table)
            if not changes and not before:
                table.wrong(f"at the end changed by a command that only reads: {host}: {_gap(picture, table)}")
            elif changes and table.green and not target:
                table.wrong(f"at the end not as in the inventory: {host}: {_gap(picture, table)}")
            elif not before and not target:
                table.wrong(f"at the end between: {host}: {_gap(picture, table)}")
            for left in picture.armed:
                table.wrong(f"at the end left behind: {host}: {left}")
            if picture.foreign != table.before[host].foreign:
                table.wrong(f"a row of somebody else's: {host}: {table.before[host].foreign} is {picture.foreign}")


@dataclass(frozen=True)
class _Undisturbed:
    """What prepares a round: commands that nothing strikes."""

    player: Player
    table: Table

    def run(self, *words: str) -> Ended:
        return self.player.run(self.table.site, self.table.store, words)

    def read(self) -> Pictures:
        return self.player.read(self.table)


@dataclass
class Trap:
    """Waits for the moment of a fault, and lets it strike once."""

    fault: Fault | None
    struck: Struck | None
    store: Path
    sprung: bool = False
    error: str = ""
    _records: int = 0
    _written: tuple[int, float] = (0, 0.0)
    """How long the journals are, and since when."""
    _turn: threading.Lock = field(default_factory=threading.Lock)

    def watch(self, command: Command) -> None:
        """Be told of requests and lines."""
        if self.fault is None or self.struck is None:
            return
        moment, relay = self.fault.moment, self.struck.site.relay
        if moment.what == "request":
            begun = relay.ways[moment.where].trips if moment.where else relay.trips

            def request(way: object) -> None:
                ours = relay.ways[moment.where].trips if moment.where else relay.trips
                if ours - begun >= moment.number and way is not None:
                    self.spring()

            relay.on_request = request
        if moment.what == "line":
            command.on_line = lambda count: self.spring() if count >= moment.number else None
        if moment.what == "record":
            self._records = self._count()

    @property
    def quiet_s(self) -> float:
        """Seconds since something was written into a journal."""
        return time.monotonic() - self._written[1]

    def look(self) -> None:
        size = sum(len(text) for text in self._journals())
        if size != self._written[0]:
            self._written = size, time.monotonic()
        if self.sprung or self.fault is None or self.fault.moment.what != "record":
            return
        if self._count() - self._records >= self.fault.moment.number:
            self.spring()

    def _count(self) -> int:
        assert self.fault is not None
        kind = f'"kind":"{self.fault.moment.where}"' if self.fault.moment.where else '"kind":'
        return sum(text.count(kind) for text in self._journals())

    def _journals(self) -> Iterator[str]:
        for path in self.store.glob("real/*/runs/*/journal.jsonl"):
            with contextlib.suppress(OSError):  # somebody has deleted it
                yield path.read_text(encoding="utf-8", errors="replace")

    def spring(self) -> None:
        with self._turn:
            if self.sprung or self.fault is None or self.struck is None:
                return
            self.sprung = True
        try:
            FAULTS[self.fault.name](self.struck)
        except (ControlError, OSError, subprocess.CalledProcessError) as error:
            self.error = str(error)


@contextlib.contextmanager
def laptop(folder: Path) -> Iterator[Path]:
    """A disk of its own for a laptop's state, so that it can be full."""
    folder.mkdir(parents=True)
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={_STATE_SIZE}", "tmpfs", str(folder)], check=True)
    try:
        yield folder / "state"
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


def _judge_advice(table: Table, ended: Ended, typed: tuple[str, ...], found: advice.Advice | None) -> None:
    """It has to be something that can be typed here, or to say where."""
    words = " ".join(typed)
    if ended.code in (ExitCode.OUR_FAULT, ExitCode.USAGE):
        table.wrong(f"exit {ended.code} of `{words}`: {ended.advice_text.strip()[-300:]}")
    if found is not None and found.typed and advice.name_of(found.typed) in advice.TERMINAL and not found.on_terminal:
        table.wrong(f"advice that needs a terminal and does not say so: `{found.text}` after `{words}`")


def _agreement(typed: tuple[str, ...], plan: Round) -> tuple[str, ...]:
    """What a person adds so that nothing is asked, and the form in which they read."""
    name, plans = advice.name_of(typed), "--plan" in typed
    asks = name in CHANGING - {"recover resume"} and not plans and "--yes" not in typed
    pays = name in CHANGING | {"plan", "report drift"} and "--accept-cost" not in typed
    return (
        *(("--yes",) if asks else ()),
        *(("--accept-cost",) if pays else ()),
        *(("--json",) if plan.json and "--json" not in typed and name not in advice.TERMINAL else ()),
    )


def _is_lost(table: Table) -> bool:
    """Whether what was to be put back went with the state of this laptop: then 7 is the truth, and the end."""
    return any(what.startswith("state deleted") for what in table.struck)


def _with_foreign(declared: Pictures, before: Pictures) -> Pictures:
    """Somebody else's rows stand beside what is declared; pictures are compared without them."""
    return {host: Picture(host, declared[host].menus) for host in before}


def _ignored(table: Table, host: str) -> set[str]:
    """Menus in which a colleague has changed something in this round."""
    changed = any(fault.name == "admin changes" and fault.target == host for fault in table.plan.faults)
    return {"system/identity"} if changed else set()


def _left_out(host: str, words: str) -> bool:
    """The person has named others."""
    named = [word.partition("=")[2].split(",") for word in words.split() if word.startswith("device=")]
    return any(host not in hosts for hosts in named)


def _is(picture: Picture, other: Pictures, table: Table) -> bool:
    return not _lines(picture, other[picture.host], table)


def _is_as_promised(picture: Picture, table: Table, words: str) -> bool:
    """What ends by itself may be over once a device was restarted, and other commands say nothing of it."""
    restarted = any(what.startswith(("reboot", "power")) for what in table.struck)
    over = bool(table.final) and (restarted or advice.name_of(words.split()) != advice.name_of(table.kind.words))
    return _is(picture, table.target, table) or (over and _is(picture, table.final, table))


def _lines(picture: Picture, other: Picture, table: Table) -> list[str]:
    left_out = _ignored(table, picture.host)
    return [line for line in picture.differs(other) if not any(f" {menu} " in line for menu in left_out)]


def _gap(picture: Picture, table: Table) -> str:
    """How far it is from the one and from the other, with the first differences."""
    to_target = _lines(picture, table.target[picture.host], table)
    to_before = _lines(picture, table.before[picture.host], table)
    return f"{len(to_target)} lines from the target, {len(to_before)} from before; e.g. {to_target[:2]}"
