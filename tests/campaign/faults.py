"""What happens to a run, and when: drawn from a seed, so that a round can be played again."""

import os
import random
import shutil
import signal
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from campaign.command import Command
from campaign.commands import COMMANDS
from campaign.relay import Way
from campaign.site import ADMIN, FAR, NEAR, STATES, VERSIONS, Site

SIGNALS = ("KILL", "TERM", "HUP", "INT")
RECORDS = ("planned", "protected", "layer-sent", "actions-acknowledged", "verified", "releasing", "released", "outcome")
"""Kinds of journal records at which a run may be struck: a piece ends with `released`, the next has `protected`."""


@dataclass(frozen=True)
class Moment:
    """When: at the n-th request of the relay (of one device, or of all), journal record, or line of output."""

    what: str
    number: int
    where: str = ""
    """The device, or the kind of the record."""

    def __str__(self) -> str:
        return f"{self.what} {self.number}{' of ' + self.where if self.where else ''}"


@dataclass(frozen=True)
class Fault:
    name: str
    moment: Moment
    target: str = ""
    seconds: float = 0.0

    def __str__(self) -> str:
        lasts = f" for {self.seconds:.0f} s" if self.seconds else ""
        return f"{self.name}{' ' + self.target if self.target else ''}{lasts} at {self.moment}"


@dataclass(frozen=True)
class Round:
    seed: int
    state: str
    version: str
    command: str
    """One of COMMANDS."""
    json: bool
    faults: tuple[Fault, ...]
    """The first strikes the command, the second what its advice names."""
    pause_s: float
    """What passes at the devices before a person does as advised."""
    quiet_s: float
    """How long a run has to be silent before time is put forward for the devices."""

    def as_dict(self) -> dict[str, Any]:
        return {
            "seed": self.seed,
            "state": self.state,
            "version": self.version,
            "command": self.command,
            "json": self.json,
            "faults": [str(fault) for fault in self.faults],
        }


_STATES = dict(zip(STATES, (3, 1, 4, 2), strict=True))
"""How often devices stand so at the beginning."""


def draw(seed: int) -> Round:
    """The round of a seed; the same on every machine."""
    chance = random.Random(f"campaign {seed}")  # noqa: S311 - a test's seed
    command = chance.choices(tuple(COMMANDS), [kind.weight for kind in COMMANDS.values()])[0]
    states = COMMANDS[command].states
    state = chance.choices(states, [_STATES[state] for state in states])[0]
    count = 2 if chance.random() < 0.25 else 1
    as_json = chance.random() < 0.4
    return Round(
        seed,
        state,
        chance.choice(VERSIONS),
        command,
        as_json,
        tuple(_fault(chance, state, COMMANDS[command].hosts, as_json=as_json) for _ in range(count)),
        chance.choice((0.0, 0.0, 120.0, 3600.0)),
        31.0 if chance.random() < 0.3 else 12.0,
    )


def _fault(chance: random.Random, state: str, hosts: tuple[str, ...], *, as_json: bool) -> Fault:
    name = chance.choices(tuple(FAULTS), [_OFTEN.get(name, 1) for name in FAULTS])[0]
    seconds = chance.choice((0.0, 2.0, 6.0, 15.0))
    target = ""
    if name == "signal":
        target = f"{chance.choice(('main', 'main', 'child', 'others', 'all', 'group'))} {chance.choice(SIGNALS)}"
    elif name == "stop":
        target = f"{chance.choice(('main', 'child', 'all'))} {chance.choice(('CONT', 'KILL'))}"
        seconds = chance.choice((1.0, 5.0))
    elif name in LASTING:
        seconds = chance.choice((2.0, 6.0, 15.0))
    if name in DEVICE_FAULTS:
        target = chance.choice(hosts if name != "air" else (NEAR, FAR))
    return Fault(name, _moment(chance, state, hosts, as_json=as_json), target, seconds)


def _moment(chance: random.Random, state: str, hosts: tuple[str, ...], *, as_json: bool) -> Moment:
    most = {"adopted": 60, "drifted": 40, "foreign": 30, "configured": 14}[state]
    what = chance.choices(("request", "device", "record", "kind", "line"), (3, 4, 2, 4, 0 if as_json else 2))[0]
    if what == "device":
        return Moment("request", chance.randint(1, most // 2), chance.choice(hosts))
    if what == "kind":
        return Moment("record", chance.randint(1, 3), chance.choice(RECORDS))
    return Moment(what, chance.randint(1, {"request": most, "record": 45, "line": 25}[what]))


# What strikes.


@dataclass
class Struck:
    """What a fault may lay its hands on."""

    site: Site
    command: Command
    store: Path
    fault: Fault
    second: Callable[[], None]
    """Start the same command on another laptop."""

    @property
    def ways(self) -> list[Way]:
        ways = self.site.relay.ways
        return [ways[self.fault.target]] if self.fault.target in ways else list(ways.values())

    @property
    def hosts(self) -> list[str]:
        return [way.host for way in self.ways]

    def pids(self) -> list[int]:
        everybody = self.command.processes()
        who = self.fault.target.partition(" ")[0]
        others = everybody[1:] or everybody
        return {"main": everybody[:1], "child": others[-1:], "others": others}.get(who, everybody)

    def heal_later(self, act: Callable[[], object]) -> None:
        if self.fault.seconds:
            self.site.relay.later(self.fault.seconds, act)
        else:
            self.site.relay.soon(act)


def _signal(struck: Struck) -> None:
    who, _, name = struck.fault.target.partition(" ")
    number = signal.Signals[f"SIG{name}"]
    if who == "group":
        _group(struck, number)
    else:
        struck.command.signal(number, struck.pids())


def _interrupt_twice(struck: Struck) -> None:
    _group(struck, signal.SIGINT)
    struck.site.relay.later(0.3, lambda: _group(struck, signal.SIGINT))


def _group(struck: Struck, number: signal.Signals) -> None:
    """What a terminal sends: everybody in the process group."""
    leader = struck.command.process.pid
    pids = [pid for pid in struck.command.processes() if os.getpgid(pid) == leader]
    if struck.command.alive:
        struck.command.signal(number, pids)


def _stop(struck: Struck) -> None:
    pids = struck.pids()
    after = struck.fault.target.partition(" ")[2]
    struck.command.signal(signal.SIGSTOP, pids)

    def go_on() -> None:
        if after == "KILL":
            struck.command.signal(signal.SIGKILL, pids)
            struck.command.stopped = False
        else:
            struck.command.signal(signal.SIGCONT, pids)

    struck.heal_later(go_on)


def _head(struck: Struck) -> None:
    """Nobody reads on: the terminal's pager has been closed."""
    struck.command.closes = True


def _each(command: str) -> Callable[[Struck], None]:
    def strike(struck: Struck) -> None:
        for host in struck.hosts:
            struck.site.do(host, command)

    return strike


def _vanish(struck: Struck) -> None:
    """The cable is pulled, for a while: what was open is dead, and nothing new comes through."""
    for way in struck.ways:
        struck.site.do(way.host, "vanish")
        way.holds.clear()
        struck.heal_later(way.holds.set)


def _gap(struck: Struck) -> None:
    for way in struck.ways:
        way.holds.clear()
        struck.heal_later(way.holds.set)


def _refuse(struck: Struck) -> None:
    for way in struck.ways:
        way.refuses = True
        struck.site.relay.reset(way)
        struck.heal_later(lambda way=way: setattr(way, "refuses", False))  # type: ignore[misc]


def _slow(struck: Struck) -> None:
    for way in struck.ways:
        way.pause_s = 0.3


def _half_closed(struck: Struck) -> None:
    for way in struck.ways:
        struck.site.relay.half_close(way)
        struck.heal_later(lambda way=way: setattr(way, "mute", False))  # type: ignore[misc]


def _mute(struck: Struck) -> None:
    """What devices answer is lost, while they still hear us."""
    for way in struck.ways:
        way.mute = True
        struck.heal_later(lambda way=way: _end_mute(struck, way))  # type: ignore[misc]


def _end_mute(struck: Struck, way: Way) -> None:
    way.mute = False
    struck.site.relay.reset(way)  # a stream with a hole in it is no TCP connection any more


def _reboot(struck: Struck) -> None:
    struck.site.do(struck.fault.target, "reboot", clean=True)


def _power(struck: Struck) -> None:
    struck.site.do(struck.fault.target, "reboot", clean=False)


def _air(struck: Struck) -> None:
    """Something stands between the ends of the bridge."""
    struck.site.do(NEAR, "air", loss_db=200.0)
    struck.heal_later(lambda: struck.site.do(NEAR, "air", loss_db=0.0))


def _admin_takes(struck: Struck) -> None:
    """A colleague takes safe mode, if it is free, and leaves after a while."""
    host = struck.fault.target
    _type(struck, "/safe-mode/take")
    struck.heal_later(lambda: struck.site.console(host, "/safe-mode/release", user=ADMIN.name) if _held(struck) else 0)


def _held(struck: Struck) -> bool:
    words = struck.site.console(struck.fault.target, "/safe-mode/print", user=ADMIN.name)
    return any("=current=true" in answer for answer in words)


def _admin_robs(struck: Struck) -> None:
    """A colleague releases the safe mode that we hold."""
    _type(struck, "/safe-mode/release")


def _admin_unrolls(struck: Struck) -> None:
    """A colleague takes back what we have done in safe mode."""
    _type(struck, "/safe-mode/unroll")


def _admin_changes(struck: Struck) -> None:
    _type(struck, "/system/identity/set", "=name=changed-by-a-colleague")


def _type(struck: Struck, *words: str) -> None:
    struck.site.console(struck.fault.target, *words, user=ADMIN.name)


def _state_full(struck: Struck) -> None:
    ballast = struck.store.parent / "ballast"
    with ballast.open("wb") as file:
        while True:
            try:
                file.write(b"\0" * 4096)
                file.flush()
            except OSError:
                break


def _state_read_only(struck: Struck) -> None:
    folder = str(struck.store)
    if struck.store.exists():
        subprocess.run(["mount", "--bind", folder, folder], check=True)
        subprocess.run(["mount", "-o", "remount,bind,ro", folder], check=True)


def _state_deleted(struck: Struck) -> None:
    shutil.rmtree(struck.store, ignore_errors=True)


def _second_laptop(struck: Struck) -> None:
    struck.second()


FAULTS: dict[str, Callable[[Struck], None]] = {
    "signal": _signal,
    "interrupted twice": _interrupt_twice,
    "stop": _stop,
    "head": _head,
    "drop": _each("drop"),
    "vanish": _vanish,
    "gap": _gap,
    "refuse": _refuse,
    "slow": _slow,
    "half-closed": _half_closed,
    "mute": _mute,
    "reboot": _reboot,
    "power": _power,
    "air": _air,
    "admin takes safe mode": _admin_takes,
    "admin releases": _admin_robs,
    "admin unrolls": _admin_unrolls,
    "admin changes": _admin_changes,
    "state full": _state_full,
    "state read-only": _state_read_only,
    "state deleted": _state_deleted,
    "second laptop": _second_laptop,
}
_OFTEN = {"signal": 8, "stop": 2, "head": 2, "air": 2, "vanish": 2, "second laptop": 2}
"""What comes oftener than the others: `signal` stands for four signals and five ways to choose processes."""
LASTING = ("gap", "refuse", "mute", "air")
"""What would not be noticed if it were over at once."""
DEVICE_FAULTS = (
    "drop", "vanish", "gap", "refuse", "half-closed", "mute", "reboot", "power", "air", "admin takes safe mode",
    "admin releases", "admin unrolls", "admin changes",
)  # fmt: skip
