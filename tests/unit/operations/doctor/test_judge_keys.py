"""What is said of a laptop's keys and passwords, its disk and its folders, in each state that can be told apart."""

import os
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from laptop_network import lines

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.paths import checkout
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.operations.doctor import folders, keys
from atlantis_netcfg.runs import Outcome, RunEnd, RunStart, Store

# --- keys ---------------------------------------------------------------------------------------------------------

FIRST = "ssh-ed25519 AAAAC3NzaC1lZDI1NTE5AAAAIOzMkrV3HHY+skvjB+3Dgsy6+gi2Qp9FkJyNvsHCouP1"
OTHER = "ssh-ed25519 AAAAC3NzaC1lZDI1NTE5AAAAIBvvvvV3HHY+skvjB+3Dgsy6+gi2Qp9FkJyNvsHCouP1"


@pytest.fixture
def home(tmp_path: Path) -> Path:
    (tmp_path / ".ssh").mkdir()
    return tmp_path


def put(file: Path, public: str, mode: int = 0o600) -> Path:
    file.write_text("private")
    file.chmod(mode)
    file.with_name(f"{file.name}.pub").write_text(f"{public} me\n")
    return file


def test_declared_key_is_detected_in_the_ssh_folder(home: Path) -> None:
    put(home / ".ssh" / "id_rsa", OTHER)
    file = put(home / ".ssh" / "id_ed25519", FIRST)
    found = keys.laptop_keys(home)
    assert lines(keys.keys_item("gw", [f"{FIRST} technician"], found)) == [f"PASS SSH key for gw: {file}"]
    file.chmod(0o640)
    assert lines(keys.keys_item("gw", [FIRST], found)) == [
        f"FAIL SSH key for gw: other users can read {file}: OpenSSH refuses such a key",
        f"  chmod 600 {file}",
    ]


def test_declared_key_is_detected_where_ssh_config_points(home: Path) -> None:
    (home / "keys").mkdir()
    file = put(home / "keys" / "work", FIRST)
    (home / ".ssh" / "config").write_text("Host *\n  IdentityFile ~/keys/work\n  identityfile=/no/where\n")
    assert keys.keys_item("gw", [FIRST], keys.laptop_keys(home)).observation == str(file)


def test_declared_key_is_detected_in_the_agent(home: Path) -> None:
    found = keys.laptop_keys(home, f"The agent has no identities.\n{FIRST} card\n")
    assert lines(keys.keys_item("gw", [FIRST], found)) == [
        "PASS SSH key for gw: the agent has a key from the inventory"
    ]


def test_public_key_alone_fails(home: Path) -> None:
    (home / ".ssh" / "id_ed25519.pub").write_text(FIRST)
    put(home / ".ssh" / "id_rsa", OTHER)
    assert lines(keys.keys_item("gw", [FIRST], keys.laptop_keys(home))) == [
        "FAIL SSH key for gw: none of its 1 keys in the inventory is in ~/.ssh or in the agent",
        "  use a laptop that has one, or add your key to `ssh_keys` in host_vars/gw.yml",
    ]


def test_hashed_known_hosts_entries_are_matched(home: Path) -> None:
    assert not keys.in_known_hosts("coastal-gateway", home)
    file = home / ".ssh" / "known_hosts"
    file.write_text(f"coastal-gateway {FIRST}\n")
    subprocess.run(["ssh-keygen", "-q", "-H", "-f", str(file)], check=True, capture_output=True)
    assert "coastal" not in file.read_text()
    assert keys.in_known_hosts("coastal-gateway", home)
    assert not keys.in_known_hosts("te4sea-gateway", home)


def test_password_files_of_ansible_are_read_and_checked(home: Path) -> None:
    named = {
        "ANSIBLE_VAULT_IDENTITY_LIST": "a@/one, prompt, b@prompt_ask_vault_pass",
        "ANSIBLE_VAULT_PASSWORD_FILE": "~/x",
    }
    assert [str(file) for file in keys.password_files(named)] == ["/one", str(Path("~/x").expanduser())]
    assert keys.password_files({}) == ()
    file = home / "password"
    assert keys.password_file_item(file, home / "inventory").verdict == "FAIL"
    file.write_text("secret")
    file.chmod(0o644)
    assert lines(keys.password_file_item(file, home / "inventory")) == [
        f"FAIL password file: other users can read {file}",
        f"  chmod 600 {file}",
    ]
    file.chmod(0o600)
    assert keys.password_file_item(file, home / "inventory").verdict == "PASS"
    assert keys.password_file_item(file, home).verdict == "WARN"
    file.chmod(0o755)
    assert keys.password_file_item(file, home / "inventory").verdict == "PASS", "a program prints it"


@pytest.fixture(scope="module")
def shipped() -> Inventory:
    return load(checkout() / "inventory")


@pytest.fixture(scope="module")
def real(shipped: Inventory) -> Inventory:
    return replace(shipped, pilot=shipped.pilot.model_copy(update={"example_values": False}))


def test_example_values_are_a_warning(shipped: Inventory, real: Inventory) -> None:
    assert keys.examples_item(shipped).verdict == "WARN"
    assert keys.examples_item(real).verdict == "PASS"


DEVICES = "coastal-router, coastal-cpe, coastal-4g, coastal-gateway"


def test_known_devices_verdicts(shipped: Inventory, real: Inventory, tmp_path: Path) -> None:
    pins, hosts = Store(tmp_path).pins, real.site_hosts("coastal")
    assert keys.known_devices_item(shipped, hosts, pins, lambda _: True).verdict == "SKIP"
    assert lines(keys.known_devices_item(real, hosts, pins, lambda _: False)) == [
        f"WARN known devices: 4 of 4 not known here and therefore refused: {DEVICES}",
        "  at the site, on a terminal (for a new router use `device adopt` instead):",
        "  provision device trust site=coastal",
    ]
    for name in ("coastal-router", "coastal-cpe", "coastal-4g"):
        pins.change(name, "ab" * 32)
    assert lines(keys.known_devices_item(real, hosts, pins, lambda name: name == "coastal-gateway")) == [
        "PASS known devices: all 4: certificate or host key is in the inventory, or stored here"
    ]
    (tmp_path / "real" / "pins.json").write_text("damaged")
    assert keys.known_devices_item(real, hosts, pins, lambda _: True).verdict == "FAIL"


def no_password(_text: str) -> str:
    raise UsageError("there is no password", hint="name a file\nor type it")


def test_inventory_without_encrypted_values_needs_no_password() -> None:
    assert lines(keys.secrets_item(checkout() / "inventory", no_password)) == [
        "PASS vault: no value of the inventory is encrypted, so no password is needed"
    ]


def _wrong(_text: str) -> str:
    raise ValueError("wrong password")


@pytest.mark.parametrize(
    ("decrypt", "expected"),
    [
        (lambda _: "a-real-secret-of-the-quay", ["PASS vault: the password decrypts all 2 encrypted values"]),
        (no_password, ["INCONCLUSIVE vault: there is no password", "  name a file"]),
    ],
)
def test_encrypted_values_verdicts(tmp_path: Path, decrypt: Callable[[str], str], expected: list[str]) -> None:
    assert lines(keys.secrets_item(vaulted(tmp_path), decrypt)) == expected


def test_wrong_password_is_reported_with_location_of_the_first_value(tmp_path: Path) -> None:
    item = keys.secrets_item(vaulted(tmp_path), _wrong)
    assert item.verdict == "FAIL"
    assert "host_vars/coastal-router.yml:8: this secret cannot be decrypted, nor 1 more" in item.observation
    assert item.hint == "check the vault password: it does not fit this value"


def vaulted(folder: Path) -> Path:
    """The shipped inventory with two encrypted values."""
    import shutil  # noqa: PLC0415 - two tests need it

    root = shutil.copytree(checkout() / "inventory", folder / "inventory")
    file = root / "host_vars" / "coastal-router.yml"
    text = file.read_text(encoding="utf-8")
    for name in ("EXAMPLE-provision-coastal", "EXAMPLE-vpn-coastal"):
        assert name in text
        text = text.replace(name, '!vault "$ANSIBLE_VAULT;1.1;AES256\\n3336\\n"')
    file.write_text(text, encoding="utf-8")
    return root


def test_missing_authority_is_skipped_and_damaged_one_warns(tmp_path: Path) -> None:
    assert keys.authority_item(tmp_path / "vpn").verdict == "SKIP"
    (tmp_path / "vpn").mkdir()
    (tmp_path / "vpn" / "ledger.jsonl").write_text("damaged")
    assert keys.authority_item(tmp_path / "vpn").verdict == "WARN"


# --- folders ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("free", "expected"),
    [
        (9_000_000_000, ["PASS room: 9.0 GB free at /x"]),
        (400_000_000, ["WARN room: 400 MB free at /x; 0.5 GB are recommended for records", "  free disk space"]),
        (49_000_000, ["FAIL room: 49 MB free at /x, for records", "  delete what you no longer need"]),
    ],
)
def test_free_space_verdicts(free: int, expected: list[str], tmp_path: Path) -> None:
    need = folders.SpaceRequirement("room", tmp_path, 50_000_000, 500_000_000, "records")
    assert [line.replace(str(tmp_path), "/x") for line in lines(folders.judge_room(need, free))] == expected


def test_record_folder_is_checked_without_changing_it(tmp_path: Path) -> None:
    place = tmp_path / "state"
    assert folders.state_item(place).verdict == "SKIP"
    assert not place.exists(), "looking makes nothing"
    place.mkdir(mode=0o700)
    assert folders.state_item(place).verdict == "PASS"
    place.chmod(0o755)
    item = folders.state_item(place)
    assert (item.verdict, item.commands) == ("WARN", (f"chmod 700 {place}",))
    assert place.stat().st_mode & 0o777 == 0o755, "looking changes nothing"


@pytest.mark.skipif(os.geteuid() != 0, reason="giving a folder to somebody else needs root")
def test_record_folder_of_another_user_fails(tmp_path: Path) -> None:
    os.chown(tmp_path, 65534, 65534)
    assert folders.state_item(tmp_path).verdict == "FAIL"


def test_checkout_writable_by_others_is_a_warning(tmp_path: Path) -> None:
    (tmp_path / ".venv").mkdir(mode=0o755)
    tmp_path.chmod(0o755)
    assert folders.checkout_item(tmp_path).verdict == "PASS"
    (tmp_path / ".venv").chmod(0o777)
    item = folders.checkout_item(tmp_path)
    assert (item.verdict, item.commands) == ("WARN", (f"chmod go-w {tmp_path / '.venv'}",))


def test_leftovers_are_a_warning_with_a_remove_command(tmp_path: Path) -> None:
    assert folders.leftovers_item(()).verdict == "PASS"
    item = folders.leftovers_item((tmp_path,))
    assert (item.verdict, item.commands) == ("WARN", (f"sudo rm -r --one-file-system {tmp_path}",))


STARTED = RunStart(
    site="coastal",
    revision="",
    tool="",
    hosts=("coastal-router",),
    rehearsed=False,
    command="provision site=coastal inventory=here",
)


def test_unfinished_runs_are_a_warning_with_a_resume_command(tmp_path: Path) -> None:
    store = Store(tmp_path)
    assert lines(folders.unfinished_item(folders.read_runs(store, None).unfinished_runs)) == [
        "PASS unfinished runs: none"
    ]
    assert list(tmp_path.iterdir()) == [], "looking makes nothing"
    with store.start(STARTED) as journal:
        name = journal.run
    read = folders.read_runs(store, "coastal")
    assert [run.id for run in read.unfinished_runs] == [name]
    assert lines(folders.unfinished_item(read.unfinished_runs)) == [
        f"WARN unfinished runs: {name} is unfinished on coastal-router",
        "  continue when the link is available:",
        f"  provision recover resume site=coastal run={name} inventory=here",
    ]
    assert folders.read_runs(store, "scc").unfinished_runs == ()


def test_finished_run_is_not_listed_as_unfinished(tmp_path: Path) -> None:
    store = Store(tmp_path)
    with store.start(STARTED) as journal:
        journal.write(Outcome(device="coastal-router", status="changed", exit=0, message=""))
        journal.write(RunEnd(exit=0))
    assert folders.read_runs(store, None).unfinished_runs == ()
