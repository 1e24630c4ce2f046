"""A router of ours becomes a member of the VPN: on versions that can, again, after a cut, and with a new identity."""

import asyncio
from datetime import UTC, datetime
from pathlib import Path

import pytest
from router_stand import HOST, SHIPPED, Stand, router

from atlantis_netcfg.core.errors import ExitCode, UsageError
from atlantis_netcfg.core.events import ignore
from atlantis_netcfg.emulator.routeros import FaultKind
from atlantis_netcfg.operations.common.jobs import device_job
from atlantis_netcfg.operations.common.request import Request
from atlantis_netcfg.operations.vpn.router import identity_for, install
from atlantis_netcfg.routeros.apply import DeviceResult, JobMode, Status, converge
from atlantis_netcfg.runs import NoJournal
from atlantis_netcfg.vpn import routeros
from atlantis_netcfg.vpn.rehearsal import identities, rehearsed_identity
from atlantis_netcfg.vpn.router_import import PEM, PROFILE, RouterImport

pytestmark = pytest.mark.slow

NAME, CERTIFICATE = "ovpn-scc", "atlantis-vpn"
STEPS = (
    "/file/add",
    "/file/remove",
    "/certificate/import",
    "/certificate/set",
    "/certificate/remove",
    "/interface/ovpn-client/import-ovpn-configuration",
    "/interface/ovpn-client/set",
)
"""At which the link is cut: before the router has done it, and after."""
SAMPLE = {("/file/remove", "before"), ("/interface/ovpn-client/import-ovpn-configuration", "after")}
"""A key in a file, and an interface without its name: what the next run has to find. The rest is a campaign."""


def converged(stand: Stand, mode: JobMode = JobMode.APPLY) -> DeviceResult:
    """What `provision site=coastal` makes of the router."""
    return asyncio.run(converge(device_job(SHIPPED, HOST, stand.request, NoJournal(), ignore), mode=mode))


def no_key_in_a_file(stand: Stand) -> None:
    assert not {row["name"] for row in stand.rows("/file")} & {PEM, PROFILE}


@pytest.mark.smoke("7.21.5")
@pytest.mark.parametrize("version", ["7.17", "7.21.5"])
def test_router_joins_once_and_site_run_changes_nothing(tmp_path: Path, version: str) -> None:
    with router(tmp_path, version) as stand:
        before = stand.export()
        planned = stand.install(plan=True)
        assert (planned.status, planned.exit) == (Status.PLANNED, ExitCode.CHANGES)
        assert stand.export() == before
        done = stand.install()
        assert (done.status, done.exit) == (Status.CHANGED, ExitCode.DONE), done.message
        assert done.changes == planned.changes
        row = stand.interface()
        assert (row["name"], row["certificate"], row["auth"], row["cipher"]) == (
            NAME,
            CERTIFICATE,
            "sha256",
            "aes256-gcm",
        )
        assert (row["connect-to"], row["protocol"], row["disabled"]) == ("vpn.example.org", "udp", "false")
        assert (row["verify-server-certificate"], row["tls-version"]) == ("true", "only-1.2")
        assert row["mac-address"] == routeros.mark(stand.identity)
        assert stand.twins.do(HOST.name, "wrapped", interface=NAME)
        no_key_in_a_file(stand)
        found = {one["name"]: one for one in stand.rows("/certificate")}
        assert found[CERTIFICATE]["fingerprint"] == stand.identity.certificate.sha256
        assert found[CERTIFICATE]["private-key"] == "true"
        again = stand.install()
        assert (again.status, again.changes) == (Status.UNCHANGED, ())
        # The template declares the same row: the site's run leaves it, and its key, as they are.
        diff = converged(stand, JobMode.PLAN).diff
        assert "ovpn-client" not in diff, diff


def test_installation_survives_later_site_run_and_renewal(tmp_path: Path) -> None:
    with router(tmp_path, "7.21.5") as stand:
        stand.install()
        made = converged(stand)
        assert made.exit is ExitCode.DONE, made.message
        assert converged(stand, JobMode.PLAN).planned_count == 0
        assert stand.install().status is Status.UNCHANGED
        assert stand.twins.do(HOST.name, "wrapped", interface=NAME)
        # A later identity takes the place of the first one, and the site's run gives back what named the interface.
        later = rehearsed_identity(SHIPPED, HOST)
        renewed = stand.install(later)
        assert (renewed.status, renewed.exit) == (Status.CHANGED, ExitCode.DONE), renewed.message
        assert any("`provision site=coastal`" in note for note in renewed.notes)
        certificates = {one["name"]: one["fingerprint"] for one in stand.rows("/certificate")}
        assert certificates[CERTIFICATE] == later.certificate.sha256
        assert stand.identity.certificate.sha256 not in certificates.values()
        assert converged(stand).exit is ExitCode.DONE
        assert converged(stand, JobMode.PLAN).planned_count == 0
        assert stand.install(later).status is Status.UNCHANGED


def test_an_interface_without_a_key_is_replaced(tmp_path: Path) -> None:
    """As somebody, or an earlier run of the site, has made it: it looks the same, and never reaches the server."""
    with router(tmp_path, "7.21.5", certificates=("atlantis-api", CERTIFICATE)) as stand:
        assert converged(stand).exit is ExitCode.DONE
        assert not stand.twins.do(HOST.name, "wrapped", interface=NAME)
        done = stand.install()
        assert done.exit is ExitCode.DONE, done.message
        assert f"interface {NAME} imported, replacing the existing one" in done.changes
        assert stand.twins.do(HOST.name, "wrapped", interface=NAME)
        assert converged(stand).exit is ExitCode.DONE
        assert stand.install().status is Status.UNCHANGED


@pytest.mark.smoke("7.16-knows no tls-crypt")
@pytest.mark.parametrize(
    ("version", "words"),
    [
        ("7.16", "knows no tls-crypt"),
        ("7.17beta5", "knows no tls-crypt"),
        ("7.8", "cannot import"),
        ("6.49.18", "over TCP alone"),
    ],
)
def test_older_version_is_refused_with_reason_and_left_unchanged(tmp_path: Path, version: str, words: str) -> None:
    with router(tmp_path, version) as stand:
        before = stand.export()
        done = stand.install()
        assert (done.status, done.exit) == (Status.LEFT_AS_FOUND, ExitCode.FAILED)
        assert words in done.message
        assert version in done.message
        assert "`provision device upgrade site=coastal device=coastal-router" in (done.hint or "")
        assert stand.export() == before
        assert stand.rows("/file") == []
        assert not stand.request.state.exists()


@pytest.mark.smoke("/file/remove-before")
@pytest.mark.parametrize(
    ("path", "when"),
    [
        pytest.param(path, when, marks=() if (path, when) in SAMPLE else pytest.mark.campaign)
        for path in STEPS
        for when in ("before", "after")
    ],
)
def test_run_interrupted_anywhere_is_completed_by_the_next(tmp_path: Path, path: str, when: str) -> None:
    with router(tmp_path, "7.21.5", certificates=("atlantis-api", CERTIFICATE)) as stand:
        fault = {"do": FaultKind.DROP.value, "match": path, "when": when}
        stand.twins.do(HOST.name, "arm", fault=fault)
        cut = stand.install()
        assert (cut.status, cut.exit) == (Status.UNKNOWN, ExitCode.UNKNOWN), cut.message
        no_key_in_a_file(stand)
        stand.twins.do(HOST.name, "disarm")
        done = stand.install()
        assert done.exit is ExitCode.DONE, done.message
        assert stand.interface()["name"] == NAME
        assert stand.twins.do(HOST.name, "wrapped", interface=NAME)
        no_key_in_a_file(stand)
        assert stand.install().status is Status.UNCHANGED


def test_wrong_clock_is_reported(tmp_path: Path) -> None:
    with router(tmp_path, "7.21.5", clock=datetime(1970, 1, 2, tzinfo=UTC)) as stand:
        tunnel = routeros.find_tunnel(SHIPPED, HOST)
        assert tunnel is not None
        endpoint = device_job(SHIPPED, HOST, stand.request, NoJournal(), ignore).endpoint
        profile = routeros.profile(SHIPPED, stand.identity)
        asked = RouterImport(
            HOST.name, HOST.site, endpoint, tunnel, stand.identity, profile, is_rehearsal=False, notify=ignore
        )
        (note,) = asyncio.run(asked.look()).notes
        assert note.startswith("its clock says 1970-01-02: the tunnel cannot come up until the clock is right")


def test_unsuitable_host_is_refused_before_anything_is_contacted(tmp_path: Path) -> None:
    request = Request(state=tmp_path, rehearsed=True)
    identity = rehearsed_identity(SHIPPED, HOST)
    with pytest.raises(LookupError, match="coastal-gateway is a gateway"):
        install(SHIPPED, SHIPPED.hosts["coastal-gateway"], identity, request)
    with pytest.raises(UsageError, match="scc-router is not the VPN endpoint of its site"):
        install(SHIPPED, SHIPPED.hosts["scc-router"], identity, request)
    with pytest.raises(UsageError, match="example"):
        install(SHIPPED, HOST, identity, Request(state=tmp_path))


def test_identity_must_match_its_file(tmp_path: Path) -> None:
    request = Request(state=tmp_path)
    with pytest.raises(UsageError, match="no identity of coastal-router") as refused:
        identity_for(SHIPPED, HOST, request)
    assert "`provision vpn onboard device=coastal-router`" in (refused.value.hint or "")
    identities(SHIPPED, [HOST, SHIPPED.hosts["te4sea-router"]], tmp_path / "vpn")
    assert identity_for(SHIPPED, HOST, request).member.name == HOST.name
    hosts = tmp_path / "vpn" / "hosts"
    (hosts / "te4sea-router.identity").replace(hosts / "coastal-router.identity")
    with pytest.raises(UsageError, match="is the identity of te4sea-router, not of coastal-router"):
        identity_for(SHIPPED, HOST, request)
