"""The planner: from what an image holds and what a host shall be to the edits; nothing is read or written."""

from dataclasses import replace
from ipaddress import IPv4Address, IPv4Interface

import pytest
import yaml

from atlantis_netcfg.computers.image import facts
from atlantis_netcfg.computers.image.plan import notes, plan

STATIC = facts.StaticNetwork(IPv4Interface("10.64.1.10/24"), IPv4Address("10.64.1.1"), "coastal.example.org")
WISH = facts.ImageRequest(
    host="coastal-gateway",
    site="coastal",
    user="root",
    keys=("ssh-ed25519 AAAA one", "ssh-ed25519 BBBB two"),
    static=STATIC,
    interface="eth0",
    time_zone="Europe/Lisbon",
    time_servers=(IPv4Address("192.0.2.123"), IPv4Address("192.0.2.124")),
    source="x.img.xz, SHA-256 00",
)
FILES = {
    "/etc/passwd": "root:x:0:0:root:/root:/bin/bash\n"
    "odroid:x:1000:1001::/home/odroid:/bin/sh\nd:x:1:1::/:/usr/sbin/nologin\n",
    "/etc/shadow": "root:$6$a$b:0:0:99999:7:::\nodroid:$6$c$d:19000::::::\nguest::19000::::::\ndaemon:*:19000::::::\n",
    "/etc/group": "root:x:0:\nshadow:x:42:\n",
    "/etc/hosts": "127.0.0.1\tlocalhost\n127.0.1.1\todroid\n192.0.2.9\tkept\n",
    "/etc/ssh/sshd_config": "# the vendor's\nPermitRootLogin yes\n",
}
PLAN = "/usr/sbin/netplan"
SEEN = facts.ImageFacts(FILES, frozenset({PLAN, "/etc/netplan", "/usr/share/zoneinfo/Europe/Lisbon"}))


def files(edits: tuple[facts.Edit, ...]) -> dict[str, str]:
    return {edit.path: edit.content.decode() for edit in edits if isinstance(edit, facts.ImageFile)}


def test_host_name_is_the_declared_one() -> None:
    found = files(plan(SEEN, WISH))
    assert found["/etc/hostname"] == "coastal-gateway\n"
    assert found["/etc/hosts"] == "127.0.0.1\tlocalhost\n192.0.2.9\tkept\n127.0.1.1\tcoastal-gateway\n"


@pytest.mark.parametrize(
    ("user", "home", "owner"), [("root", "/root", (0, 0)), ("odroid", "/home/odroid", (1000, 1001))]
)
def test_ssh_keys_are_installed_for_the_account(user: str, home: str, owner: tuple[int, int]) -> None:
    edits = plan(SEEN, replace(WISH, user=user))
    assert facts.ImageDirectory(f"{home}/.ssh", 0o700, owner) in edits
    keys = b"ssh-ed25519 AAAA one\nssh-ed25519 BBBB two\n"
    assert facts.ImageFile(f"{home}/.ssh/authorized_keys", keys, 0o600, owner) in edits


def test_passwords_are_removed() -> None:
    edits = plan(SEEN, WISH)
    text = "root:*::0:99999:7:::\nodroid:*:19000::::::\nguest:*:19000::::::\ndaemon:*:19000::::::\n"
    assert facts.ImageFile("/etc/shadow", text.encode(), 0o640, (0, 42)) in edits
    assert "/etc/passwd" not in files(edits)


def test_password_in_etc_passwd_is_removed() -> None:
    spoilt = replace(SEEN, files={**FILES, "/etc/passwd": "root::0:0:root:/root:/bin/bash\n"})
    assert files(plan(spoilt, WISH))["/etc/passwd"] == "root:x:0:0:root:/root:/bin/bash\n"


def test_ssh_accepts_only_keys_despite_vendor_settings() -> None:
    found = files(plan(SEEN, WISH))
    assert "PasswordAuthentication no\n" in found["/etc/ssh/sshd_config.d/00-atlantis.conf"]
    include = "Include /etc/ssh/sshd_config.d/*.conf\n"
    assert found["/etc/ssh/sshd_config"] == include + FILES["/etc/ssh/sshd_config"]
    once = replace(SEEN, files={**FILES, "/etc/ssh/sshd_config": f"# first\n\n{include}PermitRootLogin yes\n"})
    assert "/etc/ssh/sshd_config" not in files(plan(once, WISH))


def test_unique_identifiers_are_removed() -> None:
    seed, bus = "/var/lib/systemd/random-seed", "/var/lib/dbus/machine-id"
    listed = {"/etc/ssh": ("sshd_config", "ssh_host_rsa_key", "ssh_host_rsa_key.pub")}
    edits = plan(replace(SEEN, present=SEEN.present | {seed, bus}, names_by_folder=listed), WISH)
    removed = [edit.path for edit in edits if isinstance(edit, facts.Remove)]
    assert removed == [bus, seed, "/etc/ssh/ssh_host_rsa_key", "/etc/ssh/ssh_host_rsa_key.pub"]
    assert facts.ImageFile("/etc/machine-id", b"", 0o444) in edits


def test_netplan() -> None:
    listed = {"/etc/netplan": ("01-netcfg.yaml", "10-atlantis.yaml", "README")}
    edits = plan(replace(SEEN, names_by_folder=listed), WISH)
    assert [edit.path for edit in edits if isinstance(edit, facts.Remove)] == ["/etc/netplan/01-netcfg.yaml"]
    lan = yaml.safe_load(files(edits)["/etc/netplan/10-atlantis.yaml"])["network"]["ethernets"]["lan"]
    assert lan["match"] == {"name": "eth0"}
    assert lan["addresses"] == ["10.64.1.10/24"]
    assert lan["routes"] == [{"to": "0.0.0.0/0", "via": "10.64.1.1"}]
    dhcp = files(plan(SEEN, replace(WISH, static=None, interface="")))["/etc/netplan/10-atlantis.yaml"]
    assert yaml.safe_load(dhcp)["network"]["ethernets"]["lan"] == {
        "match": {"name": "e*"},
        "accept-ra": False,
        "dhcp4": True,
    }


def only(*present: str) -> facts.ImageFacts:
    return replace(SEEN, present=frozenset(present))


@pytest.mark.parametrize(
    ("present", "path", "static", "dhcp"),
    [
        (
            "/sbin/ifup",
            "/etc/network/interfaces",
            "    address 10.64.1.10/24\n    gateway 10.64.1.1",
            "eth0 inet dhcp\n    pre-up sysctl -qew",
        ),
        (
            "/usr/sbin/NetworkManager",
            "/etc/NetworkManager/system-connections/atlantis.nmconnection",
            "address1=10.64.1.10/24,10.64.1.1",
            "method=auto\n\n[ipv6]\nmethod=link-local\n",
        ),
        (
            "/lib/systemd/systemd-networkd",
            "/etc/systemd/network/05-atlantis.network",
            "IPv6AcceptRA=no\nLLMNR=no\nMulticastDNS=no\nAddress=10.64.1.10/24\nGateway=10.64.1.1",
            "DHCP=ipv4",
        ),
    ],
)
def test_files_of_other_network_tools(present: str, path: str, static: str, dhcp: str) -> None:
    assert static in files(plan(only(present), WISH))[path]
    text = files(plan(only(present), replace(WISH, static=None)))[path]
    assert dhcp in text
    assert "10.64.1" not in text


def test_networkd_is_enabled() -> None:
    wanted = "/etc/systemd/system/multi-user.target.wants/systemd-networkd.service"
    edits = plan(only("/lib/systemd/systemd-networkd"), WISH)
    assert facts.ImageLink(wanted, "/lib/systemd/system/systemd-networkd.service") in edits


def test_resolver_file() -> None:
    resolv = "/etc/resolv.conf"
    assert "nameserver 10.64.1.1\n" in files(plan(only("/lib/systemd/systemd-networkd"), WISH))[resolv]
    both = only("/lib/systemd/systemd-networkd", "/lib/systemd/systemd-resolved")
    assert resolv not in files(plan(both, WISH))


def test_time_zone_and_servers() -> None:
    edits = plan(replace(SEEN, present=SEEN.present | {"/etc/chrony/sources.d"}), WISH)
    found = files(edits)
    assert facts.ImageLink("/etc/localtime", "/usr/share/zoneinfo/Europe/Lisbon") in edits
    assert found["/etc/timezone"] == "Europe/Lisbon\n"
    assert "NTP=192.0.2.123 192.0.2.124\n" in found["/etc/systemd/timesyncd.conf.d/atlantis.conf"]
    assert found["/etc/chrony/sources.d/atlantis.sources"].count("iburst") == 2
    assert notes(SEEN, WISH) == ()
    assert notes(only(PLAN), WISH) == (
        "the image has no time zone data: its clock shows UTC until tzdata is installed (Europe/Lisbon)",
    )


def test_first_boot_unit() -> None:
    edits = plan(SEEN, WISH)
    assert "ssh-keygen -A\n" in files(edits)["/usr/local/sbin/atlantis-first-boot"]
    unit = "/etc/systemd/system/atlantis-first-boot.service"
    assert facts.ImageLink("/etc/systemd/system/multi-user.target.wants/atlantis-first-boot.service", unit) in edits


@pytest.mark.parametrize(
    ("seen", "wish", "said"),
    [
        (SEEN, replace(WISH, user="nobody"), "the image has no account `nobody`"),
        (SEEN, replace(WISH, user="d"), "account `d` of the image cannot log in"),
        (only(), WISH, "nothing in the image would set its address"),
        (only("/usr/sbin/ifup"), replace(WISH, interface=""), "ifupdown, which needs the interface's name"),
        (replace(SEEN, files={**FILES} | {"/etc/passwd": ""}), WISH, "the image has no account `root`"),
        (
            replace(SEEN, files={name: text for name, text in FILES.items() if "sshd" not in name}),
            WISH,
            "nobody could log in",
        ),
        (
            replace(SEEN, files={name: text for name, text in FILES.items() if "shadow" not in name}),
            WISH,
            "its passwords cannot be removed",
        ),
    ],
)
def test_unsuitable_image_is_refused(seen: facts.ImageFacts, wish: facts.ImageRequest, said: str) -> None:
    with pytest.raises(facts.ImageError, match=said):
        plan(seen, wish)


OFF = "/etc/cloud/cloud-init.disabled"
GRUB = "/etc/default/grub"


@pytest.mark.parametrize("known_by", ["/etc/cloud", "/usr/bin/cloud-init"])
def test_cloud_init_is_disabled(known_by: str) -> None:
    seen = replace(SEEN, present=SEEN.present | {known_by}, boot_words={GRUB: 'A="quiet"\n#B="cloud-init=enabled"\n'})
    edits = plan(seen, WISH)
    assert OFF in files(edits)
    assert (facts.ImageDirectory("/etc/cloud") in edits) is (known_by != "/etc/cloud")
    (note,) = notes(seen, WISH)
    assert "cloud-init of the image is disabled" in note


def test_image_without_cloud_init_gets_no_file_for_it() -> None:
    assert OFF not in files(plan(replace(SEEN, boot_words={GRUB: "cloud-init=enabled"}), WISH))


@pytest.mark.parametrize(
    "words", ["cloud-init=enabled", "console=tty0 cloud-init=enabled ds=nocloud\n", 'GRUB="cloud-init=enabled"\n']
)
def test_cloud_init_enabled_on_the_kernel_command_line_is_refused(words: str) -> None:
    """It has precedence over the file: cloud-init's generator asks it first."""
    seen = replace(SEEN, present=SEEN.present | {"/etc/cloud"}, boot_words={"boot.ini on the FAT partition": words})
    with pytest.raises(
        facts.ImageError, match=r"boot\.ini on the FAT partition of the image enables cloud-init \(`cloud-init"
    ):
        plan(seen, WISH)
