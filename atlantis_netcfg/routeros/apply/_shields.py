"""Which shield holds safe mode for a choice."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.routeros.apply._protection import Protection
from atlantis_netcfg.routeros.apply._shield import ApiShield, NoShield

if TYPE_CHECKING:
    from atlantis_netcfg.routeros.apply._job import DeviceJob
    from atlantis_netcfg.routeros.apply._protection import Choice
    from atlantis_netcfg.routeros.apply._shield import Shield

__all__ = ["console_of", "shield_of"]


def shield_of(choice: Choice, job: DeviceJob) -> Shield:
    """Return a shield that holds nothing yet."""
    if choice.protection is Protection.SAFE_MODE:
        return ApiShield()
    return console_of(job) if choice.protection is Protection.CONSOLE else NoShield()


def console_of(job: DeviceJob) -> Shield:
    """Return the one of a console, if the device has one that we may use."""
    if job.ssh is None or job.ssh.pin is None:
        return NoShield()
    from atlantis_netcfg.routeros.apply._console import ConsoleShield  # noqa: PLC0415 - the SSH client is heavy

    return ConsoleShield(job.console, job.ssh, job.patience.verify_s)
