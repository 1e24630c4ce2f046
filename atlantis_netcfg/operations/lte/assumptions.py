"""Assumptions of the RutOS driver that no document or record confirms: one row each.

Code that relies on a row names it on a line of its comment or docstring. `provision device verify` shows which hold.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.links.lte import Registration, rutos_read
from atlantis_netcfg.routeros import assumptions, verify

if TYPE_CHECKING:
    from collections.abc import Mapping


ASSUMPTIONS: Final = (
    assumptions.Assumption(
        "rutos-state-words",
        "Registration and data connection stand under a known name, in the words of the recorded unit.",
        "State of the 4G link; a word that nobody knows is told as unknown, never as a failure.",
        assumptions.READS,
    ),
    assumptions.Assumption(
        "rutos-levels",
        "RSRP, RSRQ and SINR stand under a known name, in dBm and dB, with or without their unit.",
        "Levels of the 4G link; where they stand elsewhere none are told.",
        assumptions.READS,
    ),
    assumptions.Assumption(
        "rutos-cell",
        "Technology and band read like `4G (LTE)` and `LTE B3`, the cell is `cellid`, its operator `mcc` and `mnc`.",
        "Declared bands are compared with the band in use; one that is not told is not compared.",
        assumptions.READS,
    ),
    assumptions.Assumption(
        "rutos-address",
        "The interface of the modem is of type `mobile` or named like `mob1s1a1`, and lists addresses as `ipaddrs`.",
        "The address of the 4G link; elsewhere it is not told.",
        assumptions.READS,
    ),
    assumptions.Assumption(
        "rutos-serial",
        "`mnfinfo.serial` of the device's status is the serial number of the unit.",
        "Another unit at the address is noticed by it; without it by the certificate alone.",
        assumptions.READS,
    ),
    assumptions.Assumption(
        "rutos-refusals",
        "A wrong password or a missing right is HTTP 401 or 403, a page that a firmware lacks 404, 405 or 501.",
        "What is said of a refused login; any other answer is told as not one of RutOS.",
        assumptions.person(
            "on the unit's own page, log in with a wrong password once, and read the status in the browser's tools"
        ),
    ),
    assumptions.Assumption(
        "rutos-settings",
        "`auto_apn` 0 makes the unit take `apn`, `auth` is `pap` for a user, `deny_roaming` leaves it registered"
        " without a data connection abroad, and `reload_config` puts all into effect.",
        "Setting a SIM as declared; the unit is read back, and a link without data is told.",
        assumptions.person(
            "set each on the unit's own page, and type `uci show network` and `uci show simcard` before and after"
        ),
    ),
    assumptions.Assumption(
        "rutos-pin",
        "`pincode` of a slot is the PIN that the unit tries, once at every reload while the card asks for it.",
        "A wrong PIN costs one try; no run tries it again, and the last try is left to a person.",
        assumptions.person("store a wrong PIN for a spare SIM, type `reload_config`, and read the tries that are left"),
    ),
)
"""In the order of the page docs/engineers/assumptions.md."""


def judge(look: rutos_read.RutosLook) -> verify.SeenAnswers:
    """Return one finding per assumption from a unit's reading, without values: the report is sent to others."""
    values = _values(look)
    findings = (
        verify.AssumptionFinding.of(each.id, _judgement(values.get(each.id, each.proof))) for each in ASSUMPTIONS
    )
    return verify.SeenAnswers("", "Teltonika unit", "", tuple(findings), system="RutOS")


def _values(look: rutos_read.RutosLook) -> Mapping[str, Mapping[str, object] | str]:
    """Return the values for each assumption, None if missing; a text tells why the unit cannot show them now."""
    reading, unread = look.reading, {page: f"the unit does not give {page}" for page in look.unread}
    away = "" if reading.state in rutos_read.REGISTERED_STATES else "the unit is in no network"
    technology = reading.access_tech if reading.access_tech in rutos_read.TECHNOLOGIES.values() else None
    cell = {"technology": technology, "band": reading.band}
    if look.unread != rutos_read.READS[1:]:  # older firmware, which is asked by ubus, tells no more
        cell |= {"cell": reading.cell, "operator code": reading.plmn}
    state = None if reading.state is Registration.UNKNOWN else reading.state
    return {
        "rutos-state-words": {"registration": state, "data connection": reading.is_connected},
        "rutos-levels": away or {"RSRP": reading.rsrp_dbm, "RSRQ": reading.rsrq_db, "SINR": reading.sinr_db},
        "rutos-cell": away or cell,
        "rutos-address": unread.get(rutos_read.INTERFACES)
        or ({"address": reading.address} if reading.is_connected else "the unit has no data connection"),
        "rutos-serial": unread.get(rutos_read.DEVICE) or {"serial number": look.serial},
    }


def _judgement(values: Mapping[str, object] | str) -> verify.Judgement:
    if isinstance(values, str):
        return Verdict.SKIP, values
    missing = [name for name, value in values.items() if value is None]
    verdict, word = (Verdict.FAIL, "not told") if missing else (Verdict.PASS, "told")
    return verdict, f"{word}: {', '.join(missing or values)}"
