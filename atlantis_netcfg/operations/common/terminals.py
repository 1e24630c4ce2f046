"""Satellite terminals and SIM cards in a run: a terminal is compared with its evidence; nothing is sent to it."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime
from typing import TYPE_CHECKING, Any

from atlantis_netcfg import runs
from atlantis_netcfg.core import errors
from atlantis_netcfg.core.events import Verdict, worst
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory.model import Router, SatelliteTerminal
from atlantis_netcfg.links import satellite
from atlantis_netcfg.operations.common.request import Mode, open_inventory, open_request

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from pathlib import Path

    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.links import LinkFinding


EVIDENCE_FOLDER = "evidence"
"""Inventory folder with backups exported by terminals; excluded from Ansible in ansible.cfg."""


@dataclass(frozen=True, slots=True)
class TerminalResult:
    """The result of one terminal.

    It has the fields of a device's result, so that every report can include it; it plans and changes nothing.
    """

    name: str
    model: str | None
    evidence: satellite.SatelliteEvidence | None
    findings: tuple[LinkFinding, ...]

    @property
    def verdict(self) -> Verdict:
        """The worst verdict of the findings; without any, PASS: a person has inspected the terminal recently."""
        return worst(finding.verdict for finding in self.findings) if self.findings else Verdict.PASS

    @property
    def exit(self) -> errors.ExitCode:
        """The exit code: a backup that differs is a failed check; a missing inspection is reported but is none."""
        return errors.ExitCode.CHECKS_FAILED if self.verdict in (Verdict.FAIL, Verdict.ERROR) else errors.ExitCode.DONE

    @property
    def message(self) -> str:
        """The terminal's message in the report."""
        if self.evidence is None:
            return msg(f"{arg(self.verdict)}: in the inventory without evidence, no interface of its own")
        by, on = self.evidence.by, self.evidence.seen_on.isoformat()
        return msg(
            f"{arg(self.verdict)}: in the inventory, firmware {arg(self.evidence.firmware)}, inspected by {arg(by)} on "
            f"{arg(on)}"
        )

    def as_dict(self) -> Mapping[str, Any]:
        """Return JSON-able data with every key of a device's result."""
        return {
            "status": "declared",
            "exit": int(self.exit),
            "message": self.message,
            "hint": None,
            "planned": 0,
            "confirmed": 0,
            "diff": "",
            "drift": [],
            "comparison": None,
            "notes": [_finding_text(finding) for finding in self.findings],
            "estimate": None,
            "plan_hash": "",
            "protection": None,
            "protection_words": "nothing is sent to it",
            "round_trips": 0,
            "bytes": {"sent": 0, "received": 0},
            "seconds": 0.0,
            "version": None,
            "board": self.model,
            "findings": [finding.as_dict() for finding in self.findings],
        }


def is_terminal(host: Host) -> bool:
    """Return whether a host is a satellite terminal."""
    return isinstance(host.device, SatelliteTerminal)


def judge_terminal(
    inventory: Inventory, host: Host, store: runs.Store, *, today: date, backup: Path | None = None
) -> TerminalResult:
    """Judge a terminal's entry in the inventory without writing; `backup` names the file instead of searching it.

    Raises UsageError if a named file cannot be read.
    """
    device = host.device
    assert isinstance(device, SatelliteTerminal)  # noqa: S101 - callers ask `is_terminal`
    evidence = _evidence(device)
    backup_file = _backup(inventory.root, evidence, backup)
    saved_firmware = _load_firmware(store).get(host.name)
    judgements = satellite.judge_evidence(host.name, evidence, backup_file, saved_firmware, today)
    findings = [replace(item, hint=item.hint and errors.fill_hint(item.hint, site=host.site)) for item in judgements]
    return TerminalResult(host.name, device.model, evidence, (*findings, *_judge_carrier_nat(inventory, host, device)))


def perform(
    inventory: Path, hosts: Sequence[str], request: Mapping[str, Any] | None, *, plan_only: bool
) -> dict[str, Any]:
    """Judge the terminals of a play and return `per_host`: each result for Ansible. Raise NetcfgError."""
    with open_request(request, plan_only=plan_only) as (run_request, channel):
        pilot_inventory = open_inventory(inventory)
        store = runs.Store(run_request.state, is_rehearsal=run_request.rehearsed)
        today = datetime.now(UTC).astimezone().date()
        results = {
            name: judge_terminal(pilot_inventory, pilot_inventory.hosts[name], store, today=today) for name in hosts
        }
        if run_request.mode is Mode.APPLY:
            _record_firmware(store, results.values())
        channel.outcome({name: result.as_dict() for name, result in results.items()}, {})
    # Ansible prints warnings, and of a task that went well nothing else.
    warnings = [
        msg(f"{arg(name)}: {arg(_finding_text(finding))}")
        for name, result in results.items()
        for finding in result.findings
    ]
    return {"per_host": {name: _host_result(result) for name, result in results.items()}, "warnings": warnings}


def _host_result(result: TerminalResult) -> dict[str, Any]:
    lines = join("\n", [result.message, *map(_finding_text, result.findings)])
    return {
        **result.as_dict(),
        "ok": result.exit is errors.ExitCode.DONE,
        "changed": False,
        "message": lines,
        "shown": "",
    }


def _finding_text(finding: LinkFinding) -> str:
    hint = msg(f" ({arg(finding.hint)})" if finding.hint else "")
    return msg(f"{arg(finding.verdict)}: {arg(finding.message)}{arg(hint)}")


def _evidence(device: SatelliteTerminal) -> satellite.SatelliteEvidence | None:
    evidence = device.evidence
    if evidence is None:
        return None
    return satellite.SatelliteEvidence(
        firmware=evidence.firmware,
        allow_list=evidence.allow_list,
        by=evidence.by,
        seen_on=date.fromisoformat(evidence.seen_on),
        backup_file=evidence.backup_file,
        backup_sha256=evidence.backup_sha256,
    )


def _judge_carrier_nat(inventory: Inventory, host: Host, device: SatelliteTerminal) -> tuple[LinkFinding, ...]:
    address = device.evidence.sim_address if device.evidence is not None else None
    site = inventory.sites[host.site]
    link = next((link.name for link in site.bearers if link.device == host.name), host.name)
    routers = [other.device for other in inventory.site_hosts(host.site) if isinstance(other.device, Router)]
    return satellite.judge_carrier_nat(
        link, None if address is None else str(address), forwards=any(router.forwards for router in routers)
    )


def _backup(root: Path, evidence: satellite.SatelliteEvidence | None, file: Path | None) -> satellite.Backup | None:
    """Return the backup file that a person named, or the inventory's, from its evidence folder."""
    if file is not None:
        return satellite.Backup(str(file), _sha256(file))
    if evidence is None or evidence.backup_file is None:
        return None
    path = root / EVIDENCE_FOLDER / evidence.backup_file
    return satellite.Backup(f"{EVIDENCE_FOLDER}/{evidence.backup_file}", _sha256(path)) if path.is_file() else None


def _sha256(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        reason = error.strerror or str(error)
        hint = "give the backup exported from the terminal"
        raise errors.UsageError(f"cannot read the backup {arg(path)}: {arg(reason)}", hint=hint) from error


def _load_firmware(store: runs.Store) -> dict[str, str]:
    """Return the firmware of each terminal as recorded by the last run; raise DamagedStateError.

    A run that may change devices records the firmware in the inventory: the next run reports a change.
    """
    path = store.root / "terminals.json"
    try:
        return {str(name): str(firmware) for name, firmware in json.loads(path.read_bytes()).items()}
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, AttributeError) as error:
        hint = "remove it: the next run records the inventory again"
        raise runs.DamagedStateError(f"cannot read the record of the terminals: {arg(path)}", hint=hint) from error


def _record_firmware(store: runs.Store, results: Iterable[TerminalResult]) -> None:
    before = _load_firmware(store)
    after = {**before, **{result.name: result.evidence.firmware for result in results if result.evidence is not None}}
    if after != before:
        store.root.mkdir(mode=0o700, parents=True, exist_ok=True)
        text = json.dumps(after, indent=1, sort_keys=True)
        runs.write_atomically(store.root / "terminals.json", f"{text}\n".encode())


_MENU, _FIELD = "/interface/lte", "pin"


class TriedPin:
    """The record of PIN attempts for one SIM; `root` is that of the `Store`.

    The device cannot report them: a PIN that was removed leaves no trace on it but the SIM's own counter, which
    RouterOS does not show. So a file exists in the state directory from before the PIN is sent until the PIN is known
    to be correct. It contains no PIN, nor anything that reveals one; a person who has corrected the inventory deletes
    it.

        <state>/<real|rehearsal>/<site>/sim/<device>.tried
    """

    def __init__(self, root: Path, site: str, device: str) -> None:
        self.path = root / site / "sim" / f"{device}.tried"

    @property
    def why_not(self) -> str:
        """Why the PIN must not be sent; empty if there is no reason."""
        try:
            when = self.path.read_text(encoding="ascii").strip()
        except FileNotFoundError:
            return ""
        except (OSError, ValueError):
            when = "an earlier time"
        return msg(
            f"the PIN was sent at {arg(when)}, but the SIM did not confirm it; it is not retried. Compare `sim.pin` "
            f"with the SIM's letter, then delete {arg(self.path)}"
        )

    def remember(self) -> None:
        """Record on disk that a PIN is about to be sent; raise JournalError: then it must not be sent."""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            runs.write_atomically(self.path, f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC\n".encode())
        except OSError as error:
            raise runs.JournalError(
                f"cannot record the PIN attempt: {arg(error.strerror or error)} ({arg(self.path)})",
                hint="free disk space or correct the permissions, then run the same command again",
            ) from error

    def forget(self) -> None:
        """Delete the record: the SIM has accepted the PIN."""
        self.path.unlink(missing_ok=True)


class PinRecorder:
    """A recorder that notes a PIN attempt before the PIN is sent, and deletes the note once the SIM accepted it."""

    def __init__(self, inner: runs.Recorder, pin_attempt: TriedPin) -> None:
        self._inner = inner
        self._pin_attempt = pin_attempt
        self._numbers: frozenset[int] = frozenset()
        self._sent = False

    def write(self, record: runs.Record) -> None:
        """Write a record to disk; raise JournalError."""
        if isinstance(record, runs.PlanRecord):
            self._numbers = frozenset(
                action.number for action in record.actions if action.menu == _MENU and _FIELD in dict(action.values)
            )
        elif isinstance(record, runs.LayerSent) and self._numbers & set(record.actions):
            self._pin_attempt.remember()
            self._sent = True
        self._inner.write(record)
        if isinstance(record, runs.ActionConfirmation) and self._sent:
            self._pin_attempt.forget()

    def save(self, device: str, text: str) -> None:
        """See `Journal`."""
        self._inner.save(device, text)

    def confirm(self, device: str, text: Callable[[], str]) -> None:
        """See `Journal`."""
        self._inner.confirm(device, text)
