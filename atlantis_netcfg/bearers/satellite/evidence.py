"""What a person has seen on the terminal's own pages, and whether it still says anything."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers.status import Finding
from atlantis_netcfg.core.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterator
    from datetime import date

__all__ = ["STALE_AFTER_DAYS", "Backup", "Evidence", "judge_evidence"]

STALE_AFTER_DAYS = 180
"""A campaign's length, by our own judgement: no source says how often a terminal's settings change by themselves."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """One look at the terminal, as the inventory declares it."""

    firmware: str
    allow_list: bool
    """Whether its own filter holds the declared destinations and nothing else."""
    by: str
    seen_on: date
    backup_file: str | None = None
    backup_sha256: str | None = None


@dataclass(frozen=True, slots=True)
class Backup:
    """A backup that the terminal has exported, as it lies on this computer."""

    path: str
    """As a person would type it."""
    sha256: str


def judge_evidence(
    name: str, evidence: Evidence | None, backup: Backup | None, confirmed_firmware: str | None, today: date
) -> tuple[Finding, ...]:
    """Everything that is to be said of a terminal's evidence; empty: it is complete, young and good.

    `backup`: the file that was found, None if there is none; `confirmed_firmware`: what the evidence said when a run
    last recorded it, None before the first one.
    """
    if evidence is None:
        return (
            Finding(
                Verdict.WARN,
                "terminal-not-looked-at",
                f"nobody has looked at the terminal {name}: its firmware and its own allow-list are unknown",
                f"open its pages, then write what they show under `evidence:` in host_vars/{name}.yml",
            ),
        )
    return (
        *_age(name, evidence, today),
        *_filter(name, evidence),
        *_backup(name, evidence, backup),
        *_firmware(name, evidence, confirmed_firmware),
    )


def _age(name: str, evidence: Evidence, today: date) -> Iterator[Finding]:
    days = (today - evidence.seen_on).days
    seen = f"{evidence.by} looked at the terminal {name} on {evidence.seen_on.isoformat()}"
    if days > STALE_AFTER_DAYS:
        hint = f"look again, and write who and when under `evidence:` in host_vars/{name}.yml"
        yield Finding(Verdict.WARN, "terminal-evidence-old", f"{seen}, {days} days ago", hint)
    elif days < 0:
        hint = f"correct `seen_on:` in host_vars/{name}.yml, or this computer's clock"
        yield Finding(Verdict.INCONCLUSIVE, "terminal-evidence-from-the-future", f"{seen}, which is yet to come", hint)


def _filter(name: str, evidence: Evidence) -> Iterator[Finding]:
    if not evidence.allow_list:
        message = (
            f"the terminal {name} has no allow-list of its own, or another one: only the router limits what it sends"
        )
        hint = "enter the declared destinations on the terminal's page; `provision prove site=…` lists and tries them"
        yield Finding(Verdict.WARN, "terminal-without-allow-list", message, hint)


def _backup(name: str, evidence: Evidence, backup: Backup | None) -> Iterator[Finding]:
    declared = evidence.backup_sha256
    if declared is None:
        message = f"no backup of the terminal {name} is declared, so a changed setting would not be noticed"
        hint = "export one on its page and write `backup_file:` and `backup_sha256:` (sha256sum FILE)"
        yield Finding(Verdict.WARN, "terminal-without-backup", message, hint)
    elif backup is None:
        message = f"the backup of the terminal {name} that is declared is not on this computer"
        file = evidence.backup_file or "the file"
        hint = f"put {file} into inventory/evidence/, or name it: `provision prove site=… backup=FILE`"
        yield Finding(Verdict.INCONCLUSIVE, "terminal-backup-not-here", message, hint)
    elif backup.sha256 != declared:
        message = (
            f"the backup {backup.path} of the terminal {name} is not the declared one: SHA-256 {backup.sha256[:16]}…, "
            f"declared {declared[:16]}…"
        )
        hint = "its settings have changed, or the file is another one: look at its pages, then declare what is right"
        yield Finding(Verdict.FAIL, "terminal-backup-differs", message, hint)


def _firmware(name: str, evidence: Evidence, confirmed: str | None) -> Iterator[Finding]:
    if confirmed is not None and confirmed != evidence.firmware:
        message = (
            f"the terminal {name} had firmware {confirmed} when a run last recorded it, and has {evidence.firmware}"
        )
        hint = "a new firmware may have other defaults: look at its allow-list again, and prove it"
        yield Finding(Verdict.WARN, "terminal-firmware-changed", message, hint)
