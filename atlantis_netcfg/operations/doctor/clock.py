"""This laptop's clock: whether its time is plausible, and whether a time server sets it (read-only).

A clock that is slow is detected from earlier events on this laptop: the checkout's newest commit, the latest set-up of
`.venv`, the latest run, the first day of the VPN authority. A clock that is fast by less than the authority's life is
not detected here; the router's certificate and the checklist's GPS check that.
"""

from __future__ import annotations

import shutil
import subprocess
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.operations.doctor.items import DoctorItem, DoctorSection

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from atlantis_netcfg.runs import Run

_TOLERANCE = timedelta(minutes=10)
"""Typical deviation of other people's clocks, which date commits."""
_SET = "sudo timedatectl set-ntp true"
_PATIENCE_S = 5.0


def _item(name: str, verdict: Verdict, observation: str, hint: str = "", commands: tuple[str, ...] = ()) -> DoctorItem:
    return DoctorItem(DoctorSection.CLOCK, name, verdict, observation, hint, commands)


def judge_time(now: datetime, earlier: Mapping[str, datetime], ends: datetime | None = None) -> DoctorItem:
    """Judge the time against earlier events and their times, and the last day of the VPN's authority (`ends`)."""
    time_text = f"{now:%Y-%m-%d %H:%M} UTC"
    if not earlier:
        return _item("time", Verdict.WARN, msg(f"{arg(time_text)}: nothing to compare it with"))
    what, latest = max(earlier.items(), key=lambda each: each[1])
    if now + _TOLERANCE < latest:
        return _item(
            "time",
            Verdict.FAIL,
            msg(f"{arg(time_text)} is before {arg(what)} ({arg(latest):%Y-%m-%d %H:%M} UTC)"),
            "set it:",
            (_SET,),
        )
    if ends is not None and now > ends:
        return _item(
            "time",
            Verdict.FAIL,
            msg(f"{arg(time_text)} is after the expiry of the VPN authority ({arg(ends):%Y-%m-%d})"),
            "set the clock; if it is right, create a new authority",
        )
    return _item("time", Verdict.PASS, msg(f"{arg(time_text)}, after {arg(what)} ({arg(latest):%Y-%m-%d})"))


def judge_synchronised(output: str | None) -> DoctorItem:
    """Judge the output of `timedatectl show`; None if it is not available."""
    properties = dict(line.partition("=")[::2] for line in (output or "").splitlines())
    state = properties.get("NTPSynchronized")
    if state == "yes":
        return _item("time server", Verdict.PASS, "the clock is set by a time server")
    if state == "no":
        off = properties.get("NTP") == "no"
        return _item(
            "time server",
            Verdict.WARN,
            "no time server sets the clock" if off else "no time server has responded since the start",
            "" if off else "connect to the internet once, or compare with a watch",
            (_SET,) if off else (),
        )
    return _item("time server", Verdict.WARN, "unknown: timedatectl reports nothing here", "compare with a watch")


def clock_items(checkout: Path, runs: Sequence[Run], authority: Path | None) -> Iterator[DoctorItem]:
    """Check this computer's clock."""
    begins, ends = _authority_dates(authority)
    times = (
        ("the newest commit of this checkout", _commit(checkout)),
        ("the last set-up of .venv", _modification_time(checkout / ".venv" / "run.stamp")),
        ("the latest run", _latest_run(runs)),
        ("the VPN's authority was made", begins),
    )
    yield judge_time(datetime.now(UTC), {what: when for what, when in times if when is not None}, ends)
    yield judge_synchronised(_read_output(["timedatectl", "show"]))


def _read_output(words: list[str]) -> str | None:
    if shutil.which(words[0]) is None:
        return None
    try:
        process = subprocess.run(  # noqa: S603 - our own words
            words, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=_PATIENCE_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return process.stdout if process.returncode == 0 else None


def _commit(checkout: Path) -> datetime | None:
    """Return the newest commit's time; None without a checkout, or if git refuses to read it for this user."""
    if not (checkout / ".git").exists():
        return None
    timestamp = (_read_output(["git", "-C", str(checkout), "log", "-1", "--format=%ct"]) or "").strip()
    return datetime.fromtimestamp(int(timestamp), UTC) if timestamp.isdecimal() else None


def _modification_time(file: Path) -> datetime | None:
    try:
        return datetime.fromtimestamp(file.stat().st_mtime, UTC)
    except OSError:
        return None


def _latest_run(runs: Sequence[Run]) -> datetime | None:
    """Return when the latest run of this computer started, from its name."""
    starts = []
    for run in runs:
        with suppress(ValueError):
            starts.append(datetime.strptime(run.id.partition("-")[0], "%Y%m%dT%H%M%SZ").replace(tzinfo=UTC))
    return max(starts, default=None)


def _authority_dates(authority: Path | None) -> tuple[datetime | None, datetime | None]:
    """Return the first and the last day of the authority's certificate."""
    from cryptography import x509  # noqa: PLC0415 - few laptops have an authority

    if authority is None or not (file := authority / "ca.crt").is_file():
        return None, None
    try:
        read = x509.load_pem_x509_certificate(file.read_bytes())
    except (OSError, ValueError):  # the item about the authority tells it
        return None, None
    return read.not_valid_before_utc, read.not_valid_after_utc
