"""Both ends of the Wi-Fi bridge as one: every family of radios, both sites' journals, and what refuses to begin."""

import json
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import preforked
import pytest

from atlantis_netcfg.emulator.routeros import SpawnedSite
from atlantis_netcfg.inventory import load
from atlantis_netcfg.operations.apply import perform
from atlantis_netcfg.operations.common.rehearsal import Rehearsal, rehearsal, site_spec
from atlantis_netcfg.operations.common.request import Target
from atlantis_netcfg.routeros.rsc import parse
from atlantis_netcfg.runs import RunResume, SiteLock, Store

CHECKOUT = Path(__file__).resolve().parents[4]
ENDS = ("coastal-cpe", "scc-cpe")
PLAIN = {"protocol: nv2": 'protocol: "802.11"'}
FAMILIES: dict[str, dict[str, str]] = {
    "nv2": {},
    "nv2-declared": {"protocol: nv2": "protocol: nv2\n    menus: wireless"},
    "wireless-80211": {**PLAIN, "width_mhz: 20": "width_mhz: 40\n    menus: wireless"},
    "wireless-n": {**PLAIN, "802.11ac": "802.11n"},
    "wifi-wpa2": {**PLAIN, "width_mhz: 20": "width_mhz: 80\n    menus: wifi"},
    "wifi-wpa3": {**PLAIN, "802.11ac": "802.11ax\n    wpa: wpa3"},
}


@pytest.fixture(autouse=True)
def prepared_twins(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fork the emulated routers of a rehearsal from the process that has imported what they need."""
    monkeypatch.setattr("atlantis_netcfg.emulator.routeros.spawn", preforked.spawn)


def inventory(folder: Path, edits: Mapping[str, str]) -> Path:
    """A copy of the shipped inventory with the same edits at both ends."""
    root = folder / "inventory"
    if not root.exists():
        shutil.copytree(CHECKOUT / "inventory", root)
    for name in ENDS:
        path = root / "host_vars" / f"{name}.yml"
        text = path.read_text(encoding="utf-8")
        for old, new in edits.items():
            assert text.count(old) == 1, old
            text = text.replace(old, new)
        path.write_text(text, encoding="utf-8")
    return root


def ask(
    root: Path,
    state: Path,
    twins: Rehearsal,
    *hosts: str,
    mode: str = "apply",
    **more: Any,  # noqa: ANN401
) -> dict[str, Any]:
    """Ask as the command line does; give each device's result."""
    targets = {name: target.model_dump() for name, target in twins.targets.items()}
    request = {"state": str(state), "mode": mode, "rehearsed": True, "targets": targets, **more}
    found: dict[str, Any] = perform(root, hosts, request, plan_only=False, decrypt=str)["per_host"]
    return found


@contextmanager
def both(root: Path, site: str, *names: str) -> Iterator[Rehearsal]:
    """Twins of these hosts and of the other ends of their bridges."""
    declaration = load(root)
    asked = [host for host in declaration.site_hosts(site) if host.name in names]
    with rehearsal(declaration, asked) as twins:
        yield twins


def statuses(results: Mapping[str, Any]) -> dict[str, str]:
    return {name: result["status"] for name, result in results.items()}


def said(results: Mapping[str, Any]) -> list[str]:
    return [f"{name}: {result['message']}" for name, result in results.items()]


SAMPLE = ("wifi-wpa3", "nv2", "wireless-80211")
"""One of each kind of radio in CI; what differs beyond is text, which unit tests hold."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "family", [name if name in SAMPLE else pytest.param(name, marks=pytest.mark.campaign) for name in FAMILIES]
)
def test_both_ends_are_configured_together_and_second_run_changes_nothing(tmp_path: Path, family: str) -> None:
    root = inventory(tmp_path, FAMILIES[family])
    with both(root, "coastal", "coastal-cpe") as twins:
        first = ask(root, tmp_path / "state", twins, "coastal-cpe")
        second = ask(root, tmp_path / "state", twins, "coastal-cpe")
        exports = {name: twins.export(name) for name in ENDS}
    assert statuses(first) == dict.fromkeys(ENDS, "changed"), said(first)
    assert all(result["confirmed"] == result["planned"] > 30 for result in first.values())
    assert statuses(second) == dict.fromkeys(ENDS, "unchanged"), said(second)
    assert all(result["planned"] == 0 for result in second.values())
    radio = "/interface/wifi" if family.startswith("wifi") else "/interface/wireless"
    for name, export in exports.items():
        menus = {statement.menu for statement in parse(export, source=name).statements}
        assert radio in menus
        assert "EXAMPLE" not in export.replace("EXAMPLE-ATLANTIS-PTP", ""), "a key in an export"


@pytest.mark.smoke
@pytest.mark.slow
def test_the_run_is_recorded_at_both_sites_under_one_name(tmp_path: Path) -> None:
    root = inventory(tmp_path, {})
    store = Store(tmp_path / "state", is_rehearsal=True)
    with both(root, "scc", "scc-cpe") as twins:
        planned = ask(root, tmp_path / "state", twins, "scc-cpe", mode="plan")
        assert statuses(planned) == dict.fromkeys(ENDS, "planned"), said(planned)
        assert any(
            "change together, far end first; if the link is not back within" in note
            for note in planned["scc-cpe"]["notes"]
        )
        assert store.sites() == ()
        first = ask(root, tmp_path / "state", twins, "scc-cpe")
        assert statuses(first) == dict.fromkeys(ENDS, "changed"), said(first)
        (here,), (there,) = store.runs("scc"), store.runs("coastal")
        assert here.id == there.id
        assert (here.start_record, there.start_record) != (None, None)
        assert here.before("scc-cpe") is not None
        assert there.before("coastal-cpe") is not None
        drift = ask(root, tmp_path / "state", twins, "scc-cpe", mode="drift")
        assert statuses(drift) == dict.fromkeys(ENDS, "unchanged"), said(drift)
        assert first["scc-cpe"]["other_end"] == "coastal-cpe"
        assert f"coastal-cpe: {first['coastal-cpe']['message']}" in first["scc-cpe"]["message"]
        again = ask(root, tmp_path / "state", twins, "scc-cpe", mode="resume", run=here.id)
        assert statuses(again) == dict.fromkeys(ENDS, "unchanged"), said(again)
        resumed = [store.run(site, here.id).log.records for site in ("scc", "coastal")]
        assert all(any(isinstance(one, RunResume) for one in records) for records in resumed)
        saved = ask(root, tmp_path / "state", twins, "scc-cpe", mode="backup")
        assert {result["exit"] for result in saved.values()} == {0}, said(saved)


@pytest.mark.slow
def test_run_is_rolled_back_at_both_ends(tmp_path: Path) -> None:
    root, state = inventory(tmp_path, {}), tmp_path / "state"
    with both(root, "coastal", "coastal-cpe") as twins:
        assert statuses(ask(root, state, twins, "coastal-cpe")) == dict.fromkeys(ENDS, "changed")
        before = {name: twins.export(name) for name in ENDS}
        inventory(tmp_path, {"frequency_mhz: 5500": "frequency_mhz: 5520"})
        changed = ask(root, state, twins, "coastal-cpe")
        assert statuses(changed) == dict.fromkeys(ENDS, "changed"), said(changed)
        assert all("5520" in twins.export(name) for name in ENDS)
        run = Store(state, is_rehearsal=True).runs("coastal")[-1].id
        back = ask(root, state, twins, "coastal-cpe", back_to=run)
        assert statuses(back) == dict.fromkeys(ENDS, "changed"), said(back)
        assert [_rows(twins.export(name)) for name in ENDS] == [_rows(before[name]) for name in ENDS]


def _rows(export: str) -> list[str]:
    return [line for line in export.splitlines() if not line.startswith("#")]


@pytest.mark.slow
def test_lock_at_the_other_site_stops_only_the_bridge(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rehearsals are locked here as real runs are."""
    monkeypatch.setattr(Store, "lock", lambda self, site, command: SiteLock(self.root / site / "lock", site, command))
    root, state = inventory(tmp_path, {}), tmp_path / "state"
    with (
        both(root, "coastal", "coastal-router", "coastal-cpe") as twins,
        Store(state, is_rehearsal=True).lock("scc", "a colleague"),
    ):
        results = ask(root, state, twins, "coastal-router", "coastal-cpe")
    assert statuses(results) == {
        "coastal-router": "changed",
        "coastal-cpe": "left-as-found",
        "scc-cpe": "left-as-found",
    }, said(results)
    assert "a colleague" in results["coastal-cpe"]["message"]


@contextmanager
def boxes(root: Path, folder: Path, **changed: Any) -> Iterator[SpawnedSite]:  # noqa: ANN401 - fields of RouterSpec
    """Both ends as other boxes than declared."""
    declaration = load(root)
    spec = site_spec(declaration, [declaration.hosts[name] for name in ENDS])
    twins = tuple(twin.model_copy(update={"router": twin.router.model_copy(update=changed)}) for twin in spec.emulators)
    with preforked.spawn(spec.model_copy(update={"emulators": twins, "pairs": ()}), folder) as spawned:
        yield spawned


NEITHER = {"packages": ("routeros",)}
WIFI = {"packages": ("routeros", "wifi-qcom")}
WIRELESS = {"packages": ("routeros", "wireless")}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("edits", "box", "message", "hint"),
    [
        (
            {},
            NEITHER,
            "since RouterOS 7.13 `wireless` is a separate package",
            (
                "install the package `wireless` "
                "(802.11ax and some newer 802.11ac devices: `wifi-qcom`, `wifi-qcom-ac`) of the same version as "
                "RouterOS, reboot, and run this command again"
            ),
        ),
        (
            {},
            WIFI,
            "has protocol nv2 in the inventory, but its radio has the `wifi` menus",
            'write `protocol: "802.11"`',
        ),
        (
            {**PLAIN, "802.11ac": "802.11ac\n    menus: wifi"},
            WIRELESS,
            "has the `wifi` menus in the inventory, but its radio has the `wireless` menus",
            "write `menus: wireless` or `menus: auto`",
        ),
        (
            {**PLAIN, "802.11ac": "802.11ac\n    wpa: wpa3"},
            WIRELESS,
            "has wpa3 in the inventory, but its radio has the `wireless` menus",
            "choose `wpa: wpa2`",
        ),
        ({**PLAIN, "802.11ac": "802.11ax"}, WIRELESS, "has 802.11ax in the inventory", "choose an older standard"),
    ],
    ids=["no driver", "nv2 on wifi", "menus", "wpa3", "ax"],
)
def test_device_that_cannot_meet_the_inventory_is_refused_with_a_hint(
    tmp_path: Path, edits: dict[str, str], box: dict[str, Any], message: str, hint: str
) -> None:
    root = inventory(tmp_path, edits)
    with boxes(root, tmp_path / "twins", **box) as spawned:
        before = {name: str(spawned.do(name, "export")) for name in ENDS}
        twins = _targets(spawned)
        results = ask(root, tmp_path / "state", twins, *ENDS)
        assert [_rows(str(spawned.do(name, "export"))) for name in ENDS] == [_rows(before[name]) for name in ENDS]
    assert statuses(results) == dict.fromkeys(ENDS, "refused"), said(results)
    for result in results.values():
        assert message in result["message"]
        assert hint in result["hint"]


def _targets(spawned: SpawnedSite) -> Rehearsal:
    targets = {
        name: Target(host=ready["host"], port=ready["api_ssl"], pin=ready["pin"])
        for name, ready in spawned.ready.items()
    }
    return Rehearsal(targets, (), spawned)


@pytest.mark.slow
@pytest.mark.parametrize("family", ["nv2", "wifi-wpa2"])
def test_new_bridge_is_set_up_one_end_after_the_other(tmp_path: Path, family: str) -> None:
    root, state = inventory(tmp_path, FAMILIES[family]), tmp_path / "state"
    with boxes(root, tmp_path / "twins") as spawned:
        twins = _targets(spawned)
        for near, far in (ENDS, ENDS[::-1]):
            here = Rehearsal(_unseen(twins, far), (), spawned)
            planned = ask(root, state, here, near, mode="plan")
            assert statuses(planned) == {near: "planned", far: "left-as-found"}, said(planned)
            alone = ask(root, state, here, near)
            assert statuses(alone) == {near: "changed", far: "left-as-found"}, said(alone)
            assert f"only {near} is changed. After" in alone[near]["notes"][-1]
            assert alone[far]["exit"] == 4
        again = ask(root, state, twins, ENDS[0])
        assert statuses(again) == dict.fromkeys(ENDS, "unchanged"), said(again)
        gone = ask(root, state, Rehearsal(_unseen(twins, ENDS[1]), (), spawned), ENDS[0])
        assert statuses(gone) == {ENDS[0]: "unchanged", ENDS[1]: "left-as-found"}, said(gone)
        inventory(tmp_path, {"ssid: EXAMPLE-ATLANTIS-PTP": "ssid: EXAMPLE-ANOTHER"})
        kept = ask(root, state, Rehearsal(_unseen(twins, ENDS[1]), (), spawned), ENDS[0])
        assert statuses(kept) == dict.fromkeys(ENDS, "left-as-found"), said(kept)


def _unseen(twins: Rehearsal, name: str) -> dict[str, Target]:
    """The same twins, of which one is at a port where nobody listens."""
    return {**twins.targets, name: twins.targets[name].model_copy(update={"port": 1})}


@pytest.mark.slow
def test_plain_ansible_includes_the_peer_of_a_limited_host(tmp_path: Path) -> None:
    root, state = inventory(tmp_path, {}), tmp_path / "state"
    with both(root, "coastal", "coastal-cpe") as twins:
        targets = {name: target.model_dump() for name, target in twins.targets.items()}
        request = {"atlantis_request": {"state": str(state), "rehearsed": True, "targets": targets}}
        variables = tmp_path / "request.json"
        variables.write_text(json.dumps(request), encoding="utf-8")
        counts = [_play(root, variables) for _ in range(2)]
    assert "coastal-cpe : ok=2 changed=1" in counts[0], counts[0]
    assert "; scc-cpe: " in counts[0], "the other end is told of, too"
    assert "coastal-cpe : ok=2 changed=0" in counts[1], counts[1]
    store = Store(state, is_rehearsal=True)
    assert [len(store.runs(site)) for site in ("coastal", "scc")] == [2, 2]


def _play(root: Path, variables: Path) -> str:
    done = subprocess.run(
        [
            *(sys.executable, "-m", "ansible", "playbook", "-v", "-i", str(root), "--limit", "coastal-cpe"),
            *("-e", f"@{variables}", str(CHECKOUT / "playbooks/site.yml")),
        ],
        cwd=CHECKOUT,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return " ".join(done.stdout.split())
