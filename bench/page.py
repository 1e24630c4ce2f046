"""Writes `docs/engineers/benchmarks.md`: tables, ratios, what missed its mark, and the machine."""

from __future__ import annotations

import os
import platform
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from bench import wire
from bench.job import Scenario
from bench.onboarding import EASY_RSA, OURS
from bench.proxy import Shape

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from bench.figures import Crowd, Figure, Onboarding, Runs

__all__ = ["machine", "page"]

_TITLES = {
    Scenario.FIRST: "The first configuration of the coastal router",
    Scenario.NOTHING: "Nothing to do",
    Scenario.FIREWALL: "A change of twenty firewall rules",
    Scenario.USE: "Another link for half an hour",
}
_INTRO = """\
# Benchmarks

Written by `make bench`; do not edit. The same desired state, rendered from the pilot's inventory, is brought to the
same emulated router by each contender in the way that its own documentation recommends, each as a process of its own,
start included. Between both stands a proxy that shares no code with either: it delays and counts every byte. Round
trips are TCP's handshake and every time that an answer comes to what the client has said; bytes are TCP's payload in
both directions. All that speak the API use TLS and check the router's certificate. Figures are medians of three runs;
what takes longer than ten seconds runs once. Where a link carries so many kbit/s, up and down, bytes are seconds as
well: 352/704 is Iridium Certus. Who is ahead of us stands below each table.

An emulated router responds at once. A real one takes its own time for each command, the same for everybody.
"""


def page(  # noqa: PLR0913, PLR0917 - all that was measured
    figures: Sequence[Figure],
    crowds: Sequence[Crowd],
    kept: Sequence[Runs],
    onboardings: Sequence[Onboarding],
    exact: Sequence[Figure],
    versions: Mapping[str, str],
    notes: Sequence[str],
) -> str:
    """Return the whole page."""
    parts = [_INTRO, *_machine_part(versions, notes)]
    for scenario in Scenario:
        chosen = [figure for figure in figures if figure.scenario is scenario]
        if chosen:
            parts += [f"## {_TITLES[scenario]}\n", "\n".join(_table(chosen)) + "\n"]
            parts += ["\n".join([*_ahead(chosen), *_remarks(chosen)]) + "\n"]
    if crowds:
        parts += ["## Nothing to do, on many routers\n", "\n".join(_crowd(crowds)) + "\n"]
    if kept:
        parts += ["## A computer with many runs\n", _KEPT, "\n".join(_kept(kept)) + "\n"]
    if onboardings:
        parts += ["## Many devices into the VPN\n", _BATCH, "\n".join(_onboarding(onboardings)) + "\n"]
    if exact:
        parts += [wire.part(exact)]
    marks = [*_marks(figures), *_crowd_marks(crowds), *_kept_marks(kept), *_onboarding_marks(onboardings)]
    parts += ["## Marks\n", "\n".join(marks) + "\n"]
    return "\n".join(part.rstrip("\n") + "\n" for part in parts)


def machine() -> str:
    """Processor, cores, memory and system of this machine; not its name."""
    model = "unknown processor"
    for line in _lines("/proc/cpuinfo"):
        if line.startswith("model name"):
            model = line.partition(":")[2].strip()
            break
    memory = next((int(line.split()[1]) for line in _lines("/proc/meminfo") if line.startswith("MemTotal")), 0)
    system = f"{platform.system()} {platform.release().partition('-')[0]}"
    return f"{model}, {os.cpu_count()} cores, {memory / 2**20:.0f} GiB; {system}, Python {platform.python_version()}"


def _lines(path: str) -> list[str]:
    file = Path(path)
    return file.read_text(encoding="utf-8").splitlines() if file.exists() else []


def _measured() -> str:
    return f"Measured on {datetime.now(UTC):%Y-%m-%d}: {machine()}."


def _machine_part(versions: Mapping[str, str], notes: Sequence[str]) -> Iterator[str]:
    yield f"{_measured()} Contenders, proxy and routers share it."
    yield "\n".join([f"* {name}: {version}" for name, version in versions.items()] + [f"* {note}" for note in notes])


def _table(figures: Sequence[Figure]) -> Iterator[str]:
    ours = _ours(figures)
    yield "| Link | Contender | Wall s (min-max) | CPU s | Round trips | kB | Times our wall | Export afterwards |"
    yield "|---|---|---|---|---|---|---|---|"
    for figure in figures:
        if not figure.samples:
            yield f"| {figure.link} | {figure.contender} | not measured: {figure.failure} | | | | | |"
            continue
        low, high = figure.spread
        spread = f" ({low:.1f}-{high:.1f})" if len(figure.samples) > 1 else ""
        base = ours.get(figure.link)
        ratio = f"{figure.wall_s / base.wall_s:.1f}" if base is not None else ""
        same = "as ours" if not figure.differences else f"{len(figure.differences)} lines differ"
        yield (
            f"| {figure.link} | {figure.contender}{' FAILED' if figure.failure else ''} |"
            f" {figure.wall_s:.1f}{spread} | {figure.cpu_s:.1f} | {figure.round_trips} | {figure.bytes / 1000:.0f} |"
            f" {ratio} | {same} |"
        )


def _ours(figures: Sequence[Figure]) -> dict[Shape, Figure]:
    """Ours over each link, where it has succeeded."""
    return {
        figure.link: figure for figure in figures if figure.contender == OURS and figure.samples and not figure.failure
    }


def _ahead(figures: Sequence[Figure]) -> Iterator[str]:
    """Name the peers that are quicker than we are, and over which link; and those that need fewer bytes."""
    ours = _ours(figures)
    peers = [
        entry
        for entry in figures
        if entry.contender != OURS and entry.samples and not entry.failure and entry.link in ours
    ]
    quicker: dict[str, list[str]] = {}
    for peer in peers:
        wall_s = ours[peer.link].wall_s
        if peer.wall_s < wall_s:
            quicker.setdefault(peer.contender, []).append(f"{peer.link} ({peer.wall_s:.1f} s, we {wall_s:.1f} s)")
    for name, rows in quicker.items():
        yield f"* **{name} is quicker than we are** at {'; '.join(rows)}."
    if peers and not quicker:
        yield "* Nobody is quicker than we are."
    last = {peer.contender: peer for peer in peers}
    fewer = [(item, ours[item.link].bytes) for item in last.values() if item.bytes < ours[item.link].bytes]
    if fewer:
        text = "; ".join(
            f"{figure.contender} ({figure.bytes / 1000:.0f} kB, we {size / 1000:.0f} kB)" for figure, size in fewer
        )
        yield f"* Fewer bytes than ours: {text}."


def _remarks(figures: Sequence[Figure]) -> Iterator[str]:
    """Notes of each contender once, and what differs over its slowest link."""
    last = {figure.contender: figure for figure in figures}
    for name, figure in last.items():
        yield from (f"* {name}: {note}." for note in dict.fromkeys(figure.notes))
        if figure.failure:
            yield f"* {name} did not succeed at {figure.link}: {figure.failure}"
        shown = figure.differences[:_SHOWN]
        yield from (f"* {name} differs: `{line}`" for line in shown)
        if len(figure.differences) > len(shown):
            yield f"* {name} differs in {len(figure.differences) - len(shown)} more lines."


_SHOWN = 6


def _crowd(crowds: Sequence[Crowd]) -> Iterator[str]:
    yield (
        "One process of ours, by the playbook; the emulated routers run beside it on the same cores, on a cable without"
        " delay. A silent one takes part in TCP's handshake and in nothing else: it is given up, the others end well."
    )
    yield ""
    yield "| Routers | Silent | Wall s | of it the engine s | Our CPU s | CPU ms each | Peak memory MiB | KiB each |"
    yield "|---|---|---|---|---|---|---|---|"
    for crowd in crowds:
        cost = crowd.cost
        yield (
            f"| {crowd.routers}{' FAILED' if crowd.failure else ''} | {crowd.silent} | {cost.wall_s:.1f} |"
            f" {crowd.engine_s:.1f} | {cost.cpu_s:.1f} | {1000 * cost.cpu_s / crowd.routers:.0f} |"
            f" {cost.memory_kib / 1024:.0f} | {crowd.memory_each_kib:.0f} |"
        )


_KEPT = """\
`provision report runs` and `provision recover resume`, start included, where no unfinished runs. Each earlier run
has changed one router; the latest ten stay in reach, older ones are put aside. A test counts the journals that are
opened.
"""


def _kept(kept: Sequence[Runs]) -> Iterator[str]:
    few = _few(kept)
    yield "| Command | Runs | Wall s | Times that of the fewest |"
    yield "|---|---|---|---|"
    for runs in kept:
        ratio = f"{runs.wall_s / few[runs.command].wall_s:.1f}"
        yield f"| {runs.command}{' FAILED' if runs.failure else ''} | {runs.runs} | {runs.wall_s:.2f} | {ratio} |"


def _few(kept: Sequence[Runs]) -> dict[str, Runs]:
    """Each command where there are the fewest runs."""
    return {runs.command: runs for runs in sorted(kept, key=lambda runs: -runs.runs)}


def _kept_marks(kept: Sequence[Runs]) -> Iterator[str]:
    """Compare with what was promised: a thousand runs within 1.5 times of ten."""
    few = _few(kept)
    for runs in kept:
        if runs.runs >= _THOUSAND and not runs.failure:
            base = few[runs.command]
            times = runs.wall_s / base.wall_s
            yield (
                f"* `{runs.command}` with {runs.runs} runs takes {times:.1f} times as long as with {base.runs}"
                f"{_verdict(reached=times <= _KEPT_TIMES)}."
            )


_KEPT_TIMES = 1.5
_BATCH = """\
Each contender has an authority with one device in it, and then makes keys and certificates (EC P-256, one after the
other) for so many devices more. OpenSSL verifies all of them afterwards. No network takes part.

* easy-rsa: `easyrsa build-client-full NAME nopass` for each device, since it knows no batch. That is the device's key,
  request and certificate, and a line of its index. The key of its CA lies unencrypted.
* ours: one `provision vpn onboard batch=FILE recipient=age1… --no-push`, its start, the reading of the whole inventory
  and the opening of the CA key (age's scrypt, over a second by intent) included. It makes the device's key and
  certificate, and also gives it a fixed address and a tls-crypt-v2 key, records all of it in the ledger and waits until
  that is on disk, and writes the file that the device is handed (profile, instructions, self-test), encrypted for a
  recipient. It makes no request: keys are made where they are signed, as by easy-rsa's command.
"""


def _onboarding(onboardings: Sequence[Onboarding]) -> Iterator[str]:
    ours = {
        onboarding.devices: onboarding
        for onboarding in onboardings
        if onboarding.contender == OURS and onboarding.costs
    }
    yield _measured()
    yield ""
    yield "| Devices | Contender | Wall s (min-max) | CPU s | Wall ms each | Times our wall |"
    yield "|---|---|---|---|---|---|"
    for item in onboardings:
        if not item.costs:
            yield f"| {item.devices} | {item.contender} | not measured: {item.failure} | | | |"
            continue
        low, high = item.spread
        spread = f" ({low:.1f}-{high:.1f})" if len(item.costs) > 1 else ""
        base = ours.get(item.devices)
        ratio = f"{item.wall_s / base.wall_s:.1f}" if base is not None else ""
        yield (
            f"| {item.devices} | {item.contender}{' FAILED' if item.failure else ''} | {item.wall_s:.1f}{spread} |"
            f" {item.cpu_s:.1f} | {1000 * item.wall_s / item.devices:.1f} | {ratio} |"
        )


def _onboarding_marks(onboardings: Sequence[Onboarding]) -> Iterator[str]:
    """Compare with what was promised: a thousand devices in a fifth of easy-rsa's time."""
    at = {
        onboarding.contender: onboarding
        for onboarding in onboardings
        if onboarding.devices >= _THOUSAND and onboarding.costs and not onboarding.failure
    }
    if OURS in at and EASY_RSA in at:
        ratio = at[EASY_RSA].wall_s / at[OURS].wall_s
        yield (
            f"* {at[OURS].devices} devices into the VPN, against easy-rsa: {ratio:.1f} times less wall time"
            f"{_verdict(reached=ratio >= _FIVE)}."
        )


_THOUSAND, _FIVE = 1000, 5


def _marks(figures: Sequence[Figure]) -> Iterator[str]:
    """Compare with what was promised: ten times quicker than community.routeros at 700 ms, and fewer bytes."""
    at = {(figure.contender, figure.scenario): figure for figure in figures if figure.link == _MARK}
    for scenario in Scenario:
        ours, peer = at.get((OURS, scenario)), at.get(("community.routeros", scenario))
        if ours is None or peer is None or not ours.samples or not peer.samples:
            continue
        ratio, size = peer.wall_s / ours.wall_s, peer.bytes / ours.bytes
        promised = scenario is not Scenario.FIREWALL
        quicker = _verdict(reached=ratio >= _TEN) if promised else ""
        smaller = _verdict(reached=size > 1) if promised else ""
        yield (
            f"* {_TITLES[scenario]}, {_MARK}, against community.routeros: {ratio:.1f} times less wall time"
            f"{quicker}, {size:.1f} times fewer bytes{smaller}."
        )


def _crowd_marks(crowds: Sequence[Crowd]) -> Iterator[str]:
    """Compare with what was promised: 500 routers in ten times the time of one; silent ones in a quarter of 121 s."""
    wall_s = {(crowd.routers, crowd.silent): crowd.cost.wall_s for crowd in crowds if not crowd.failure}
    if (1, 0) in wall_s and (500, 0) in wall_s:
        times = wall_s[500, 0] / wall_s[1, 0]
        yield f"* 500 routers take {times:.1f} times as long as one{_verdict(reached=times <= _TEN)}."
    if (50, 2) in wall_s:
        took_s = wall_s[50, 2]
        verdict = _verdict(reached=took_s <= _SILENT_S / 4)
        yield f"* 50 routers, 2 of them silent, take {took_s:.0f} s, a quarter of {_SILENT_S} s at most{verdict}."


_MARK, _TEN = Shape(0.35), 10
_SILENT_S = 121
"""What they took when a cable was waited for as long as a satellite."""


def _verdict(*, reached: bool) -> str:
    return " (mark: reached)" if reached else " (mark: **missed**)"
