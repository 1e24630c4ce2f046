import cProfile
import errno
import inspect
import os
import pkgutil
import pstats
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import atlantis_netcfg.inventory
from atlantis_netcfg.core.errors import ExitCode, NoMatchError, UsageError
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.inventory import Inventory, InventoryInvalid, choose, load, report, rules, validate
from atlantis_netcfg.inventory.model import Cpe, Router
from atlantis_netcfg.inventory.rules import management
from atlantis_netcfg.routeros.render import router
from bench.many import many, name

SHIPPED = Path(__file__).parents[4] / "inventory"
ROUTER = "host_vars/coastal-router.yml"
VAULT = "!vault |\n      $ANSIBLE_VAULT;1.1;AES256\n      {digits}\n"


@pytest.fixture
def inventory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(SHIPPED, tmp_path / "inventory")
    monkeypatch.chdir(tmp_path)
    return Path("inventory")


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1
    path.write_text(text.replace(old, new), encoding="utf-8")


def vault_password(inventory: Path, digits: str = "3063") -> None:
    sealed = "password: " + VAULT.format(digits=digits).rstrip()
    edit(inventory / ROUTER, "password: EXAMPLE-vpn-coastal # EXAMPLE", sealed)


def vpn_password(declaration: Inventory) -> Secret:
    device = declaration.hosts["coastal-router"].device
    assert isinstance(device, Router)
    assert device.vpn_client is not None
    return device.vpn_client.password


def told(inventory: Path) -> list[str]:
    return [f"{finding} -> {finding.hint}" for finding in validate(inventory)]


def test_shipped_pilot_has_the_expected_sites_and_hosts() -> None:
    pilot = load(SHIPPED)
    assert list(pilot.sites) == ["scc", "coastal", "te4sea"]
    assert list(pilot.vehicles) == ["girona500", "sparus", "zarco", "stork", "mares", "eca-rov"]
    assert [host.name for host in pilot.site_hosts("te4sea")] == [
        "te4sea-router",
        "te4sea-4g",
        "te4sea-sat",
        "te4sea-gateway",
    ]
    assert {host.site for host in pilot.hosts.values()} == set(pilot.sites)


def test_revision_depends_on_contents_not_location(inventory: Path) -> None:
    before = load(inventory).revision
    assert load(inventory.absolute()).revision == before == load(SHIPPED).revision
    edit(inventory / ROUTER, "# Router", "# The router")
    assert load(inventory).revision != before


def test_file_names_are_relative_to_the_working_directory(inventory: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    edit(inventory / "hosts.yml", "            scc-cpe:\n", "            scc_cpe:\n")
    assert {finding.file for finding in validate(inventory.absolute())} >= {"inventory/hosts.yml"}
    monkeypatch.chdir("/")
    assert validate(Path(os.path.relpath(SHIPPED))) == []


def test_host_variables_can_be_a_folder(inventory: Path) -> None:
    before = load(inventory)
    (inventory / "host_vars/coastal-router").mkdir()
    (inventory / ROUTER).rename(inventory / "host_vars/coastal-router/device.yml")
    (inventory / "group_vars/routers.yml").write_text("ansible_connection: local\n", encoding="utf-8")
    after = load(inventory)
    assert (after.hosts, after.revision) == (before.hosts, after.revision)


def test_hidden_files_and_documents_are_ignored(inventory: Path) -> None:
    (inventory / ".gitkeep").touch()
    (inventory / "README.md").write_text("How the address plan came about", encoding="utf-8")
    (inventory / "host_vars/.coastal-router.yml.swp").write_bytes(b"\0")
    (inventory / "empty-folder").mkdir()
    assert told(inventory) == []


def test_byte_order_mark_and_windows_line_ends_are_accepted(inventory: Path) -> None:
    path = inventory / ROUTER
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))
    assert told(inventory) == []


def test_non_utf_8_file_is_reported(inventory: Path) -> None:
    path = inventory / "group_vars/coastal.yml"
    path.write_bytes(path.read_bytes().replace(b"Coastal testbed", b"Viana \xe0 beira-mar"))
    assert told(inventory) == [
        "inventory/group_vars/coastal.yml:5:1: this line is not UTF-8 text -> save the file as UTF-8"
    ]


def test_control_character_is_reported(inventory: Path) -> None:
    path = inventory / "group_vars/coastal.yml"
    path.write_bytes(path.read_bytes().replace(b"Coastal testbed", b"Coastal\0testbed"))
    assert told(inventory) == ["inventory/group_vars/coastal.yml:5:17: there is a control character here -> delete it"]


def test_unreadable_file_is_reported(inventory: Path) -> None:
    (inventory / ROUTER).unlink()
    (inventory / ROUTER).symlink_to("nowhere.yml")
    (finding,) = validate(inventory)
    assert str(finding) == f"inventory/{ROUTER}:1:1: the file cannot be read: no such file or directory"


def test_hosts_file_with_a_syntax_error_stops_there(inventory: Path) -> None:
    (inventory / "hosts.yml").write_text("all: [\n", encoding="utf-8")
    (finding,) = validate(inventory)
    assert finding.file == "inventory/hosts.yml"


def test_deep_nesting_is_reported(inventory: Path) -> None:
    (inventory / "host_vars/coastal-gateway.yml").write_text("device: " + "[" * 900 + "]" * 900, encoding="utf-8")
    findings = validate(inventory)
    assert [finding.file for finding in findings] == ["inventory/host_vars/coastal-gateway.yml"]


class TestVault:
    def test_encrypted_secret_cannot_be_revealed(self, inventory: Path) -> None:
        vault_password(inventory)
        secret = vpn_password(load(inventory))
        with pytest.raises(UsageError, match="still encrypted"):
            secret.reveal()
        assert "3063" not in repr(secret)

    def test_decrypted_secret_is_revealed(self, inventory: Path) -> None:
        vault_password(inventory)
        declaration = load(inventory, decrypt=lambda text: text.splitlines()[1] + " opened by the vault\n")
        assert vpn_password(declaration).reveal() == "3063 opened by the vault"

    def test_wrong_vault_password_is_reported(self, inventory: Path) -> None:
        def refuse(text: str) -> str:
            raise RuntimeError("Decryption failed on " + text)

        vault_password(inventory)
        with pytest.raises(InventoryInvalid) as caught:
            load(inventory, decrypt=refuse)
        assert str(caught.value).splitlines()[:2] == [
            f"inventory/{ROUTER}:21:15: this secret cannot be decrypted",
            "  -> check the vault password: it does not fit this value",
        ]

    def test_decrypted_secrets_are_checked_but_not_shown(self, inventory: Path) -> None:
        for host in ("coastal-cpe", "scc-cpe"):
            vaulted = "key: " + VAULT.format(digits=host.encode().hex()).rstrip()
            edit(inventory / f"host_vars/{host}.yml", "key: EXAMPLE-ptp-key # EXAMPLE", vaulted)
        assert told(inventory) == []  # sealed: nobody can say whether both ends have one key
        findings = validate(inventory, decrypt=lambda text: "tooshort"[: 4 + len(text) % 2])
        assert [finding.message for finding in findings].count(
            "the bridge's key must have 8 to 63 printable ASCII characters"
        ) == 2
        assert "toos" not in report(findings)

    def test_control_characters_in_a_decrypted_secret_are_reported(self, inventory: Path) -> None:
        vault_password(inventory)
        (finding,) = validate(inventory, decrypt=lambda _: "two\nlines")
        assert finding.message == "`password` is empty, or contains a line break or another control character"


class TestNothing:
    def test_missing_directory_is_reported(self, inventory: Path) -> None:
        with pytest.raises(NoMatchError, match="the inventory directory inventroy does not exist") as caught:
            validate(inventory.with_name("inventroy"))
        assert caught.value.hint == "inventories here: inventory"
        assert caught.value.exit is ExitCode.NOTHING

    def test_file_instead_of_directory_is_reported(self, inventory: Path) -> None:
        with pytest.raises(NoMatchError, match=r"hosts.yml is a file") as caught:
            validate(inventory / "hosts.yml")
        assert caught.value.hint == "an inventory is a directory that contains hosts.yml"

    def test_empty_directory_is_reported(self, tmp_path: Path) -> None:
        with pytest.raises(NoMatchError, match=r"^hosts\.yml is missing in ") as caught:
            load(tmp_path)
        assert caught.value.hint == "it is empty"

    @pytest.mark.parametrize("text", ["", "---\n", "all:\n", "all: {children: {sites: {children: {}}}}\n"])
    def test_inventory_without_site_is_reported(self, inventory: Path, text: str) -> None:
        (inventory / "hosts.yml").write_text(text, encoding="utf-8")
        with pytest.raises(NoMatchError, match="contains no site"):
            validate(inventory)


class TestChoose:
    def test_site_name_selects_its_hosts(self) -> None:
        assert [host.name for host in choose(load(SHIPPED), "scc")] == [
            "scc-router",
            "scc-cpe",
            "scc-vpn",
            "scc-control",
        ]

    def test_all_selects_every_host(self) -> None:
        pilot = load(SHIPPED)
        assert choose(pilot, "all") == tuple(pilot.hosts.values())

    def test_only_selects_hosts_in_inventory_order(self) -> None:
        chosen = choose(load(SHIPPED), "coastal", ["coastal-cpe", "coastal-router", "coastal-cpe"])
        assert [host.name for host in chosen] == ["coastal-router", "coastal-cpe"]
        assert isinstance(chosen[1].device, Cpe)

    @pytest.mark.parametrize(
        ("site", "only", "message", "hint"),
        [
            (
                "costal",
                (),
                "site `costal` does not exist",
                "did you mean `coastal`? the sites are: scc, coastal, te4sea, all",
            ),
            ("brussels", (), "site `brussels` does not exist", "the sites are: scc, coastal, te4sea, all"),
            (
                "te4sea",
                ("te4sea-ruter",),
                "host `te4sea-ruter` does not exist at site `te4sea`",
                "did you mean `te4sea-router`? the hosts are: te4sea-router, te4sea-4g, te4sea-sat, te4sea-gateway",
            ),
            (
                "scc",
                ("coastal-router",),
                "`coastal-router` is not at site `scc`",
                "type site=coastal device=coastal-router",
            ),
        ],
    )
    def test_no_match_is_reported_with_a_hint(self, site: str, only: tuple[str, ...], message: str, hint: str) -> None:
        with pytest.raises(NoMatchError) as caught:
            choose(load(SHIPPED), site, only)
        assert (str(caught.value), caught.value.hint) == (message, hint)


def test_time_zone_is_not_checked_without_zone_data(inventory: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    edit(inventory / "group_vars/all/pilot.yml", "Europe/Lisbon", "Europe/Viana")
    assert len(validate(inventory)) == 1
    monkeypatch.setattr(management, "available_timezones", set)
    assert validate(inventory) == []


def test_unreadable_inventory_folder_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A name that no file system takes stands for a folder of another account, which `root` would read."""
    with pytest.raises(NoMatchError, match="cannot be read: File name too long"):
        load(tmp_path / ("x" * 300))
    (tmp_path / "closed").mkdir()

    def refuse(_path: Path) -> bool:
        raise PermissionError

    monkeypatch.setattr(Path, "is_file", refuse)
    with pytest.raises(NoMatchError, match="does not exist"):
        load(tmp_path / "nowhere")


def test_unreadable_inventory_files_are_reported(inventory: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_path: Path) -> bool:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(Path, "exists", refuse)
    with pytest.raises(NoMatchError, match="cannot be read: Permission denied"):
        load(inventory)


# Hundreds of sites: loading and validating them takes work in proportion, whatever the machine.


INVENTORY = Path(__file__).parents[4] / "inventory"


def work(folder: Path, number: int) -> int:
    """How many calls loading takes; every ship is in it and can be rendered."""
    place = many(INVENTORY, folder / f"of-{number}", number)
    with cProfile.Profile() as profile:
        declaration = load(place)
    ships = [declaration.hosts[f"{name(each)}-router"] for each in range(number)]
    assert len({router(declaration, ship) for ship in ships[:3]}) == min(number, 3)
    return int(pstats.Stats(profile).total_calls)  # type: ignore[attr-defined]


def test_work_grows_linearly_with_the_sites(tmp_path: Path) -> None:
    few, some, more = (work(tmp_path, number) for number in (10, 40, 80))
    assert more - some < 2.0 * 40 / 30 * (some - few)


def test_public_names() -> None:
    assert sorted(atlantis_netcfg.inventory.__all__) == [
        *("ALL", "Finding", "Host", "Inventory", "InventoryInvalid", "Mark", "choose", "load"),
        *("report", "validate"),
    ]
    assert all(hasattr(atlantis_netcfg.inventory, name) for name in atlantis_netcfg.inventory.__all__)


def test_unknown_attribute_is_an_error() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'lode'"):
        getattr(atlantis_netcfg.inventory, "lode")  # noqa: B009 - mypy knows that it is not there


def test_import_loads_no_heavy_module() -> None:
    heavy = "('pydantic', 'yaml', 'jinja2')"
    program = f"import sys, atlantis_netcfg.inventory; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_every_rule_is_in_use() -> None:
    written = []
    for info in pkgutil.iter_modules(rules.__path__):
        if info.name.startswith("_"):
            continue
        module = import_module(f"{rules.__name__}.{info.name}")
        for label, function in inspect.getmembers(module, inspect.isfunction):
            signature = inspect.signature(function)
            own = function.__module__ == module.__name__ and not label.startswith("_")
            if own and str(signature.return_annotation).endswith("Finding]"):
                assert list(signature.parameters) == ["draft"], function
                written.append(function)
    in_use = (*rules.RULES, *rules.WARNINGS)
    assert set(written) == set(in_use)
    assert len(in_use) == len(written)


def test_every_rule_has_a_docstring() -> None:
    assert [rule.__name__ for rule in (*rules.RULES, *rules.WARNINGS) if not (rule.__doc__ or "").strip()] == []
