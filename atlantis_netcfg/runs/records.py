"""The records of a journal: events, in the order in which they became certain.

A record that announces a step (`LayerSent`, `Releasing`) is on disk before it, one that reports a step before the next
step.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Literal

from pydantic import Field


@dataclass(frozen=True, slots=True, kw_only=True)
class CostRecord:
    """Bytes that the run on a device has sent over a metered link."""

    kind: Literal["cost-counted"] = "cost-counted"
    device: str
    bearer: str
    """The link that carried the traffic, if known; `declared` is the intended one."""
    declared: str
    accepted: bool
    """Whether the user had consented to the cost."""
    expected_bytes: int | None
    sent_bytes: int
    """Counted by us, in both directions, including TLS and TCP overhead."""
    router_bytes: int | None
    """Increase of the router's counter during the run, including other traffic; None: not read."""
    billed_bytes: int
    price: str | None
    """Price in `currency`; None: no tariff is declared."""
    currency: str | None


SETTLED_STATUSES = frozenset(
    {"unchanged", "changed", "planned", "drifted", "refused", "rolled-back", "left-as-found", "half-adopted"}
)
"""Outcomes after which nothing of the run is open on the device; the only other one is `unknown`."""


class Purpose(StrEnum):
    """Purpose of a run: only a run of the same purpose completes one that was killed."""

    CONFIGURE = "configure"
    """Apply the declared state, or a saved one."""
    BACKUP = "backup"
    """Nothing is changed, so nothing is ever left open."""
    ADOPT = "adopt"
    UPGRADE = "upgrade"
    INSTALL = "install"
    """Install a VPN identity on a router."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunStart:
    """First record of every journal."""

    kind: Literal["run-started"] = "run-started"
    site: str
    revision: str
    """SHA-256 over the files of the inventory."""
    tool: str
    """Version of this package."""
    hosts: tuple[str, ...]
    rehearsed: bool
    command: str
    back_to: str | None = None
    """Rollback: the run whose initial state is restored."""
    restore: str | None = None
    """Restore: the run whose confirmed state is written to the device."""
    purpose: Purpose = Purpose.CONFIGURE
    prepares: bool = False
    """It only prepared fresh emulated devices for another command; `latest` skips it: its old state is not needed."""
    by: str = ""
    """Adoption: user and computer name of the operator, as set there; empty: not recorded."""
    invocation: str = ""
    """Id of the command line that started it; empty: not recorded, as in journals of earlier versions."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunResume:
    """The run is resumed after an interruption."""

    kind: Literal["run-resumed"] = "run-resumed"
    revision: str
    tool: str
    command: str
    invocation: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceObservation:
    """The device was read; `state` is the digest of the result, without values that change on their own."""

    kind: Literal["device-observed"] = "device-observed"
    device: str
    version: str
    identity: str
    state: str


@dataclass(frozen=True, slots=True, kw_only=True)
class StateBackup:
    """The device's export before the first change is on disk; `file` is relative to the run's directory."""

    kind: Literal["state-saved"] = "state-saved"
    device: str
    file: str
    sha256: str


@dataclass(frozen=True, slots=True, kw_only=True)
class StateConfirmation:
    """The state read back at the end was saved; `file` is relative to the site's directory, as runs share it."""

    kind: Literal["state-confirmed"] = "state-confirmed"
    device: str
    file: str
    sha256: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedAction:
    """One action of a plan, secrets masked."""

    number: int
    layer: str
    menu: str
    verb: str
    subject: str
    ids: tuple[str, ...] = ()
    values: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanRecord:
    """The plan before it is applied."""

    kind: Literal["planned"] = "planned"
    device: str
    plan: str
    """Hash of the plan."""
    actions: tuple[PlannedAction, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ProtectionRecord:
    """From now on the device undoes what is not released: `how` is `safe-mode`, or `none`."""

    kind: Literal["protected"] = "protected"
    device: str
    how: str


@dataclass(frozen=True, slots=True, kw_only=True)
class SignRecord:
    """The run marker is about to be placed on the device, so that it can be attributed to this run later."""

    kind: Literal["signed"] = "signed"
    device: str
    sign: str


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerSent:
    """These actions are about to be sent; without a later acknowledgement, it is unknown if they were executed."""

    kind: Literal["layer-sent"] = "layer-sent"
    device: str
    layer: str
    actions: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ActionAcknowledgement:
    """The device has acknowledged these actions; they are confirmed only after they were read back."""

    kind: Literal["actions-acknowledged"] = "actions-acknowledged"
    device: str
    actions: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class VerificationRecord:
    """A new session has read the desired state; `state` is its digest."""

    kind: Literal["verified"] = "verified"
    device: str
    state: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Releasing:
    """Safe mode is about to be released: from now on the state may be permanent."""

    kind: Literal["releasing"] = "releasing"
    device: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ReleaseRecord:
    """Safe mode was released, and the device reports that nobody holds it."""

    kind: Literal["released"] = "released"
    device: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ActionConfirmation:
    """These actions were read back and are permanent."""

    kind: Literal["actions-confirmed"] = "actions-confirmed"
    device: str
    actions: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class RollbackRecord:
    """The changes of the run were rolled back."""

    kind: Literal["unrolled"] = "unrolled"
    device: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactStep:
    """This step of first contact is about to be typed on the device's console; it may be repeated."""

    kind: Literal["contact-step"] = "contact-step"
    device: str
    step: str
    commands: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactStepDone:
    """The device has acknowledged every command of the step."""

    kind: Literal["contact-step-done"] = "contact-step-done"
    device: str
    step: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PinRecord:
    """Certificate and host key that were pinned for the device; None if not seen (no SSH on a serial line)."""

    kind: Literal["pinned"] = "pinned"
    device: str
    certificate: str | None
    host_key: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class PackageSent:
    """The whole package file is on the device, which installs it at its next reboot."""

    kind: Literal["package-sent"] = "package-sent"
    device: str
    file: str
    sha256: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Rebooting:
    """A reboot of the device into this version is about to be requested."""

    kind: Literal["rebooting"] = "rebooting"
    device: str
    version: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PackageConfirmation:
    """After the reboot the device was read: these packages, all of this version."""

    kind: Literal["packages-confirmed"] = "packages-confirmed"
    device: str
    version: str
    packages: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """Result of the run on one device."""

    kind: Literal["outcome"] = "outcome"
    device: str
    status: str
    exit: int
    message: str
    open: bool = False
    """The device may still hold safe mode or a job of this run, even if nothing was changed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunEnd:
    """Last record of a run that was not killed."""

    kind: Literal["run-ended"] = "run-ended"
    exit: int


Record = Annotated[
    RunStart
    | RunResume
    | DeviceObservation
    | StateBackup
    | StateConfirmation
    | PlanRecord
    | ProtectionRecord
    | SignRecord
    | LayerSent
    | ActionAcknowledgement
    | VerificationRecord
    | Releasing
    | ReleaseRecord
    | ActionConfirmation
    | RollbackRecord
    | ContactStep
    | ContactStepDone
    | PinRecord
    | PackageSent
    | Rebooting
    | PackageConfirmation
    | CostRecord
    | Outcome
    | RunEnd,
    Field(discriminator="kind"),
]
