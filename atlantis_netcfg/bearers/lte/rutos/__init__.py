"""Teltonika RutOS: read over HTTPS with a pinned certificate by a user who may only read; set over SSH with UCI.

No Modbus, although the unit has it: that has no authentication (devices.md, section 4).
"""

from __future__ import annotations

from atlantis_netcfg.bearers.lte.rutos._errors import (
    CertificateChanged,
    CertificateUnknown,
    NotOffered,
    RutosLoginFailed,
    RutosRefused,
    RutosUnreachable,
)
from atlantis_netcfg.bearers.lte.rutos._read import READS, UBUS_READS, RutosLook, read
from atlantis_netcfg.bearers.lte.rutos._record import modem_of, reading_of
from atlantis_netcfg.bearers.lte.rutos._settings import (
    PIN,
    RELOAD,
    SHOW,
    WRITE,
    Change,
    LteSettings,
    SettingRefused,
    batch,
    changes,
    parse_show,
    pin_held,
    removal,
)
from atlantis_netcfg.bearers.lte.rutos._wire import TIMEOUT_S, RutosEndpoint, certificate_of

__all__ = [
    "PIN",
    "READS",
    "RELOAD",
    "SHOW",
    "TIMEOUT_S",
    "UBUS_READS",
    "WRITE",
    "CertificateChanged",
    "CertificateUnknown",
    "Change",
    "LteSettings",
    "NotOffered",
    "RutosEndpoint",
    "RutosLoginFailed",
    "RutosLook",
    "RutosRefused",
    "RutosUnreachable",
    "SettingRefused",
    "batch",
    "certificate_of",
    "changes",
    "modem_of",
    "parse_show",
    "pin_held",
    "read",
    "reading_of",
    "removal",
]
