"""The gateways of the site hold what the roles promise: files, packages, services, and what these really do.

All answers come over one connection a computer. A gateway that does not answer, or shows another host key than the
pinned one, is an error of each of its checks: nothing is known of it then.
"""

from __future__ import annotations

import json
import re
from datetime import UTC, datetime, timedelta
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

from cryptography.x509 import load_pem_x509_certificate

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.modules.env_conflicts import note, settings
from atlantis_netcfg.vpn.client import SERVICE
from checks.gateway_promises import BUILT, ENVIRONMENT, JOURNAL, LOCALE, SSHD

if TYPE_CHECKING:
    from checks.gateway_promises import Promises
    from checks.gateway_reached import Answers

LASTS = timedelta(days=30)
"""So long a new identity may take to reach a vessel."""
CLOCK_S = 2.0
"""Certificates and logs bear that; chrony holds it within milliseconds."""
FREE, FREE_MB = 0.1, 300
"""A new build and a new journal find room."""
NOT_BY_INSTALL = ("static", "generated", "transient", "alias", "indirect", "enabled-runtime", "linked")
"""States of unit files that start without `systemctl enable`."""
SAME = {"challengeresponseauthentication": "kbdinteractiveauthentication", "prohibit-password": "without-password"}
"""Words that `sshd -T` prints otherwise than they are written."""
SIZES = {"K": 2**10, "M": 2**20, "G": 2**30, "T": 2**40}


def plan(promised: Promises) -> str:
    return f"`provision plan site={promised.host.site}` shows what differs"


def test_declaration_is_complete(promised: Promises) -> None:
    assert promised.lacking == {}, "; ".join(promised.lacking.values())


def test_file(promised: Promises, path: str, answers: Answers) -> None:
    found, file_there = answers.values["files"][path], promised.files[path]
    assert found is not None, f"{path} is missing; {plan(promised)}"
    assert found["kind"] == "file", f"{path} is a {found['kind']}"
    assert file_there.sha256 in {None, found["sha256"]}, f"{path} is not as declared; {plan(promised)}"
    for key in ("mode", "owner", "group"):
        declared = getattr(file_there, key)
        assert declared in {None, found[key]}, f"{key} of {path} is {found[key]}, declared is {declared}"


def test_link(promised: Promises, link: str, answers: Answers) -> None:
    found = answers.values["files"][link] or {}
    assert found.get("target") == promised.links[link], f"{link} does not lead to {promised.links[link]}"


def test_what_is_taken_away(absent: str, promised: Promises, answers: Answers) -> None:
    assert answers.values["files"][absent] is None, f"{absent} is still there; {plan(promised)}"


def test_nothing_else_in(folder: str, promised: Promises, answers: Answers) -> None:
    left = [path for path in answers.values["folders"][folder] if path not in promised.files]
    assert left == [], f"an earlier declaration has left {', '.join(left)}; {plan(promised)}"


def test_package(promised: Promises, package: str, answers: Answers) -> None:
    found, expected = answers.values["packages"].get(package), promised.packages[package]
    assert found is not None, f"{package} is not installed, or only half"
    assert expected is None or fnmatchcase(found, expected), f"{package} {found} is installed, declared is {expected}"


def test_unit(promised: Promises, unit: str, answers: Answers) -> None:
    found, unit_there = answers.values["units"][unit], promised.units[unit]
    state, by = found.get("ActiveState", "unknown"), found.get("UnitFileState", "")
    look = f"on the computer: `systemctl status {unit}`"
    assert state != "failed", f"{unit} has failed; {look}"
    if unit_there.enabled is not None and by not in NOT_BY_INSTALL:
        assert (by == "enabled") == unit_there.enabled, (
            f"{unit} is {by or 'not there'}, enabled is {unit_there.enabled}; {look}"
        )
    if unit_there.active is not None:
        assert (state == "active") == unit_there.active, (
            f"{unit} is {state}, declared is active: {unit_there.active}; {look}"
        )


def test_clock_is_right(promised: Promises, answers: Answers) -> None:
    before, after = answers.between
    off = max(before - answers.values["now"], answers.values["now"] - after, 0.0)
    assert off <= CLOCK_S, f"the clocks of {promised.host.name} and of this computer are {off:.0f} s apart"


def test_clock_follows_a_source(answers: Answers) -> None:
    fields = answers.output_of("tracking").strip().split(",")
    assert fields[-1] == "Normal", f"chrony says `{fields[-1]}`; on the computer: `chronyc sources`"
    assert fields[0] != "7F7F0101", (
        "the clock follows itself: no time server answers; on the computer: `chronyc sources`"
    )


def test_locale_is_there(promised: Promises, answers: Answers) -> None:
    expected = promised.settings(LOCALE).get("LANG", "C.UTF-8")
    there = {_plain(name) for name in answers.output_of("locales").splitlines()}
    assert _plain(expected) in there, f"the locale {expected} is not generated; on the computer: `locale-gen`"


def _plain(locale: str) -> str:
    return locale.lower().replace("-", "")


def test_sshd_obeys(promised: Promises, answers: Answers) -> None:
    in_force = dict(line.lower().split(" ", 1) for line in answers.output_of("sshd").splitlines() if " " in line)
    for key, value in promised.settings(SSHD).items():
        name, expected = SAME.get(key.lower(), key.lower()), SAME.get(value.lower(), value.lower())
        found = in_force.get(name)
        assert found == expected, (
            f"sshd has {name} {found}, declared is {expected}: another file in {SSHD} comes before ours"
        )


def test_firewall_is_the_declared_one(promised: Promises, answers: Answers) -> None:
    loaded = answers.output_of("firewall")
    assert "policy drop;" in loaded, f"what comes in is let in: `nft list table {promised.table}`"
    assert loaded == answers.output_of("firewall_meant"), (
        "the loaded rules are not those of the file: `systemctl reload nftables`"
    )


def test_tunnel_has_its_address(promised: Promises, answers: Answers) -> None:
    if promised.tunnel is not None:
        found = re.findall(r"inet ([\d.]+)/", answers.values["said"]["tunnel"] or "")
        assert found == [promised.tunnel], (
            f"the tunnel is {f'at {found[0]}' if found else 'not up'}, declared is {promised.tunnel}; on the computer: "
            f"`journalctl -eu {SERVICE}`"
        )


def test_vpn_identity_lasts(promised: Promises, answers: Answers) -> None:
    if promised.tunnel is not None:
        name = promised.host.name
        found = re.search(r"-----BEGIN CERTIFICATE.*?END CERTIFICATE-----", _certificate(answers), re.DOTALL)
        assert found is not None, f"there is no certificate of the VPN; type `provision vpn onboard device={name}`"
        left = load_pem_x509_certificate(found[0].encode()).not_valid_after_utc - datetime.now(UTC)
        assert left >= LASTS, (
            f"the VPN lets it in for {max(left.days, 0)} days more; type `provision vpn renew host={name}`"
        )


def _certificate(answers: Answers) -> str:
    return answers.values["said"]["vpn_certificate"] or ""


def test_card_has_room(answers: Answers) -> None:
    for place, room in answers.values["room"].items():
        free = f"{place}: {room['free_mb']:.0f} MB free ({room['free']:.0%}), {room['free_inodes']:.0%} of its inodes"
        assert room["free"] >= FREE or room["free_mb"] >= 10 * FREE_MB, f"{free}: `apt-get clean` makes some"
        assert room["free_mb"] >= FREE_MB, f"{free}: `apt-get clean` makes some"
        assert room["free_inodes"] >= FREE, f"{free}: many small files, `du --inodes -x / | sort -n | tail`"


def test_journal_is_bounded(promised: Promises, answers: Answers) -> None:
    expected = promised.settings(JOURNAL)
    text = answers.output_of("journal")
    lines = [line.partition("=") for line in text.splitlines() if not line.startswith(("#", ";"))]
    in_force = {key.strip(): value.strip() for key, _, value in lines}
    for key, value in expected.items():
        assert in_force.get(key) == value, f"journald has {key}={in_force.get(key)}, declared is {value}"
    used = re.search(r"([\d.]+)([KMGT]?)B? in the file system", answers.output_of("journal_usage"))
    assert used is not None, "journald does not tell how much room it takes"
    most = expected["SystemMaxUse"]
    taken = float(used[1]) * SIZES.get(used[2], 1)
    assert taken <= 1.1 * float(most[:-1]) * SIZES[most[-1]], (
        f"the journal takes {used[1]}{used[2]}, declared is {most}"
    )


def test_profile_is_in_force_for_people(promised: Promises, answers: Answers) -> None:
    found = _variables(answers.output_of("login"))
    for name, value in _variables(promised.text(ENVIRONMENT)).items():
        assert found.get(name) == value, f"who logs in has {name}={found.get(name)}, declared is {value}"


def test_profile_is_in_force_for(promised: Promises, reader: str, answers: Answers) -> None:
    found = answers.values["environments"][reader]
    for name, value in _variables(promised.text(ENVIRONMENT)).items():
        if found is not None:
            assert found.get(name) == value, f"{reader} has {name}={found.get(name)}, declared is {value}: restart it"


def _variables(text: str) -> dict[str, str]:
    return dict(line.split("=", 1) for line in text.splitlines() if "=" in line and not line.startswith("#"))


def test_nothing_keeps_ros_at_home(promised: Promises, answers: Answers) -> None:
    for line in answers.output_of("elsewhere").splitlines() if promised.alone else ():
        path, _, rest = line.partition(":")
        for found in settings(path, rest.partition(":")[2], promised.alone) if path not in promised.ours else ():
            assert found.value == promised.alone[found.name], note(
                found, "ROS 2 then sees nothing beyond this computer"
            )


def test_the_declared_library_is_in_use(promised: Promises, answers: Answers) -> None:
    built = json.loads(answers.values["texts"][BUILT] or "{}")
    for name in ("library", "examples"):
        expected = (promised.build or {}).get(name)
        if expected is not None:
            found = (built.get(name) or {}).get("revision")
            assert found == expected["revision"], f"the {name} in use is {found}, declared is {expected['revision']}"
