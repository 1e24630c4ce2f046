"""Real images (MBR, FAT, ext4), customised by an ordinary user and looked into by other programs than ours."""

import os
import struct
import subprocess
import sys
import tempfile
from dataclasses import replace
from ipaddress import IPv4Address, IPv4Interface
from pathlib import Path

import pytest
from image_made import BOOT_AT, KEY, ROOT, ROOT_AT, disk, run, tree

from atlantis_netcfg.computers.image.ext4 import LAYOUTS, Ext4
from atlantis_netcfg.computers.image.facts import Edit, ImageError, ImageFile, ImageRequest, Remove, StaticNetwork
from atlantis_netcfg.computers.image.plan import customise

pytestmark = pytest.mark.slow

WISH = ImageRequest(
    host="coastal-gateway",
    site="coastal",
    user="root",
    keys=(KEY,),
    static=StaticNetwork(IPv4Interface("10.64.1.10/24"), IPv4Address("10.64.1.1"), "coastal.example.org"),
    interface="eth0",
    time_zone="Europe/Lisbon",
    time_servers=(IPv4Address("192.0.2.123"),),
    source="x.img.xz, SHA-256 00",
)
N2, PLAIN = LAYOUTS["odroid-n2"], LAYOUTS["plain"]


@pytest.fixture
def image(tmp_path: Path) -> Path:
    return disk(tmp_path / "gw.img", tree(tmp_path / "root"))


def cat(image: Path, path: str) -> str:
    """By debugfs' own words, not by our reader."""
    asked = ["debugfs", "-R", f"cat {path}", f"{image}?offset={ROOT_AT}"]
    return subprocess.run(asked, check=True, capture_output=True, text=True).stdout


@pytest.mark.smoke
def test_image_is_customised_for_the_host(image: Path) -> None:
    assert customise(image, N2, WISH) == ()
    assert cat(image, "/etc/hostname") == "coastal-gateway\n"
    assert cat(image, "/root/.ssh/authorized_keys") == f"{KEY}\n"
    assert "$6$" not in cat(image, "/etc/shadow")
    assert cat(image, "/etc/passwd").count(":x:") == 4
    assert "10.64.1.10/24" in cat(image, "/etc/netplan/10-atlantis.yaml")
    assert cat(image, "/etc/netplan/01-netcfg.yaml") == ""
    assert cat(image, "/etc/ssh/ssh_host_ed25519_key") == ""
    assert cat(image, "/etc/machine-id") == ""
    run("e2fsck", "-fn", f"{image}?offset={ROOT_AT}")
    status = Ext4(image, ROOT_AT).status("/etc/localtime")
    assert status is not None
    assert status.target == "/usr/share/zoneinfo/Europe/Lisbon"


def test_boot_gap_and_fat_partition_are_preserved(image: Path, tmp_path: Path) -> None:
    before = image.read_bytes()[:BOOT_AT]
    customise(image, N2, WISH)
    assert image.read_bytes()[:BOOT_AT] == before
    run("mcopy", "-i", f"{image}@@{BOOT_AT}", "::boot.ini", "::ATLANTIS.TXT", str(tmp_path))
    assert (tmp_path / "boot.ini").read_text() == "ODROIDN2-UBOOT-CONFIG\n"
    assert "made for coastal-gateway of site coastal" in (tmp_path / "ATLANTIS.TXT").read_text()


def test_customising_twice_changes_nothing(image: Path) -> None:
    customise(image, N2, WISH)
    paths = [
        *("/etc/hosts", "/etc/shadow", "/etc/ssh/sshd_config"),
        *("/etc/netplan/10-atlantis.yaml", "/etc/atlantis/image.json"),
    ]
    once = [cat(image, path) for path in paths]
    customise(image, N2, WISH)
    assert [cat(image, path) for path in paths] == once
    assert all(once)


@pytest.mark.smoke
@pytest.mark.skipif(os.geteuid() != 0, reason="root becomes an ordinary user here; the others are one already")
def test_unprivileged_user_can_customise_an_image(image: Path, tmp_path: Path) -> None:
    """As `nobody`, in a directory of its own; the modes and owners inside are root's nevertheless."""
    place = tmp_path / "own"
    place.mkdir()
    program = (
        "import sys; sys.path[:0] = sys.argv[2:]; from pathlib import Path; from test_image_customise import *;"
        "customise(Path(sys.argv[1]), N2, WISH)"
    )
    here = Path(__file__).parent
    (image).rename(place / "gw.img")
    for path in (place, place / "gw.img"):
        run("chown", "65534:65534", str(path))
    # Every pytest that starts closes its own folder to others again: all of them, at the last moment.
    for above in (tmp_path, *(one for one in tmp_path.parents if one.is_relative_to(tempfile.gettempdir()))):
        if above != Path(tempfile.gettempdir()):
            above.chmod(0o755)
    command = ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups", sys.executable, "-B", "-c", program]
    done = subprocess.run(
        [*command, str(place / "gw.img"), str(here), str(here.parents[3])],
        cwd=place,
        check=False,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    status = Ext4(place / "gw.img", ROOT_AT).status("/root/.ssh/authorized_keys")
    assert status is not None
    assert (status.mode, status.owner) == (0o600, (0, 0))


def test_plain_ext4_image_is_customised(image: Path) -> None:
    customise(image, PLAIN, WISH)
    assert cat(image, "/etc/hostname") == "coastal-gateway\n"


def test_gpt_image_is_customised(tmp_path: Path) -> None:
    image, root = tmp_path / "gpt.img", tree(tmp_path / "root")
    with image.open("wb") as file:
        file.truncate(40 * 2**20)
    subprocess.run(["sfdisk", "-q", str(image)], input="label: gpt\n8192,65536,L\n", text=True, check=True)
    run(
        "mke2fs", "-q", "-t", "ext4", "-E", f"offset={8192 * 512},root_owner=0:0", "-d", str(root), str(image), "32768k"
    )
    customise(image, PLAIN, WISH)
    assert Ext4(image, 8192 * 512).read("/etc/hostname") == b"coastal-gateway\n"


@pytest.mark.parametrize(
    ("at", "data", "said"),
    [
        (510, b"\0\0", "the image contains no partition table"),
        (ROOT_AT + 1080, b"\0\0", "its partition 2 contains no ext4"),
        (BOOT_AT + 54, b"\0\0\0", "its partition 1 contains no FAT"),
        (ROOT_AT + 4096, b"\xff" * 64, "is damaged"),
    ],
    ids=["table", "ext4", "fat", "file system"],
)
def test_an_image_of_another_kind_is_refused(image: Path, at: int, data: bytes, said: str) -> None:
    with image.open("r+b") as file:
        file.seek(at)
        file.write(data)
    with pytest.raises(ImageError, match=said):
        customise(image, N2, WISH)


def test_full_file_system_is_reported(tmp_path: Path) -> None:
    """debugfs ends with 0 also where it could not write: reading back finds it."""
    image = disk(tmp_path / "full.img", tree(tmp_path / "root"), root_mib=4)
    root = Ext4(image, ROOT_AT)
    with pytest.raises(ImageError, match=r"/etc/large of the image could not be written|damaged after"):
        root.apply([ImageFile("/etc/large", b"x" * 8 * 2**20)])


@pytest.mark.parametrize(
    "edit", [ImageFile("/etc/a b", b""), ImageFile("/etc/../x", b""), Remove('/etc/"x"'), ImageFile("etc/x", b"")]
)
def test_path_that_debugfs_would_misparse_is_refused(image: Path, edit: Edit) -> None:
    with pytest.raises(ImageError, match="cannot be the path of a file"):
        Ext4(image, ROOT_AT).apply([edit])


def test_a_missing_program_is_named(image: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.which", lambda _name, **_more: None)
    with pytest.raises(ImageError, match="`e2fsck` is not installed") as caught:
        customise(image, N2, WISH)
    assert caught.value.hint == "sudo apt install e2fsprogs"


@pytest.mark.smoke("/root-/home/root")
@pytest.mark.parametrize(
    ("path", "target"),
    [
        ("/root", "/home/root"),
        ("/etc/shadow", "../usr/share/shadow"),
        ("/etc/netplan", "/usr/share/netplan"),
        ("/etc/hosts", "/usr/share/hosts"),
        ("/etc/systemd", "/usr/share/systemd"),
    ],
)
def test_symlink_in_place_of_a_file_or_folder_is_refused(tmp_path: Path, path: str, target: str) -> None:
    """debugfs edits the link, and what is read back is something else: that is no full file system."""
    root = tree(tmp_path / "root")
    aside = root / (Path("/etc") / target).resolve().relative_to("/")
    aside.parent.mkdir(parents=True, exist_ok=True)
    if (root / path[1:]).exists():
        (root / path[1:]).rename(aside)
    else:
        aside.mkdir()
    (root / path[1:]).symlink_to(target)
    image = disk(tmp_path / "gw.img", root)
    with pytest.raises(
        ImageError, match=(f"{path} of the image is a symbolic link to {target}; files behind a link are not edited")
    ):
        customise(image, N2, WISH)
    assert cat(image, "/etc/hostname") == "odroid\n"


def test_symlink_in_a_parent_path_is_followed(tmp_path: Path) -> None:
    root = tree(tmp_path / "root")
    (root / "var" / "home" / "odroid").mkdir(parents=True)
    (root / "home").symlink_to("var/home")
    image = disk(tmp_path / "gw.img", root)
    customise(image, N2, replace(WISH, user="odroid"))
    assert cat(image, "/var/home/odroid/.ssh/authorized_keys") == f"{KEY}\n"


def test_a_feature_that_debugfs_cannot_edit_is_named(tmp_path: Path) -> None:
    image = disk(tmp_path / "gw.img", tree(tmp_path / "root"), features="inline_data")
    with pytest.raises(ImageError, match="has the feature `inline_data`, which debugfs cannot edit"):
        customise(image, N2, WISH)


def test_unknown_file_system_feature_is_not_reported_as_damage(tmp_path: Path) -> None:
    """Bit 31 of the incompatible features: e2fsck says that it wants a newer e2fsck."""
    image = disk(tmp_path / "gw.img", tree(tmp_path / "root"), features="^metadata_csum")
    with image.open("r+b") as file:
        file.seek(ROOT_AT + 1024 + 0x60)
        (features,) = struct.unpack("<I", file.read(4))
        file.seek(ROOT_AT + 1024 + 0x60)
        file.write(struct.pack("<I", features | 1 << 31))
    with pytest.raises(ImageError, match="e2fsprogs of this computer does not know: FEATURE_I31"):
        customise(image, N2, WISH)


DEBIAN = Path(__file__).parents[4] / ".venv-setup" / "debian"


def cloud_init_runs(image: Path, folder: Path, words: str = "") -> bool:
    """What cloud-init's own generator for systemd decides at the start of a computer with this image."""
    (told,) = (DEBIAN / "cloud-init").rglob("cloud-init-generator")
    (folder / "cloud").mkdir(parents=True)
    for name in ("disabled", "enabled"):
        if (data := Ext4(image, ROOT_AT).read(f"/etc/cloud/cloud-init.{name}")) is not None:
            (folder / "cloud" / f"cloud-init.{name}").write_bytes(data)
    program = folder / "generator"
    text = told.read_text().replace("/etc/cloud/", f"{folder}/cloud/").replace("/run/cloud-init", f"{folder}/run")
    program.write_text(text.replace("/usr/lib/cloud-init/ds-identify", "/bin/true"))
    places = [str(folder / name) for name in ("normal", "early", "late")]
    subprocess.run(["sh", str(program), *places], env={"KERNEL_CMDLINE": words, "PATH": "/usr/bin:/bin"}, check=True)
    return (folder / "early" / "multi-user.target.wants" / "cloud-init.target").is_symlink()


@pytest.mark.parametrize("by", ["etc/cloud/cloud.cfg", "etc/cloud/cloud-init.enabled"])
def test_cloud_init_is_disabled(tmp_path: Path, by: str) -> None:
    image = disk(tmp_path / "gw.img", tree(tmp_path / "root", {**ROOT, by: "x: y\n"}))
    assert cloud_init_runs(image, tmp_path / "before")
    customise(image, N2, WISH)
    assert not cloud_init_runs(image, tmp_path / "after")
    assert cloud_init_runs(image, tmp_path / "told", "quiet cloud-init=enabled"), "why such an image is refused"


def test_cloud_init_stays_disabled(tmp_path: Path) -> None:
    files = {**ROOT, "etc/cloud/cloud.cfg": "preserve_hostname: false\n"}
    image = disk(tmp_path / "gw.img", tree(tmp_path / "root", files))
    assert "cloud-init of the image is disabled" in customise(image, N2, WISH)[0]
    assert cat(image, "/etc/cloud/cloud-init.disabled") != ""
    note = tmp_path / "boot.ini"
    note.write_text("ODROIDN2-UBOOT-CONFIG\nsetenv bootargs cloud-init=enabled\n")
    run("mcopy", "-o", "-i", f"{image}@@{BOOT_AT}", str(note), "::boot.ini")
    with pytest.raises(ImageError, match=r"boot\.ini on the FAT partition of the image enables cloud-init"):
        customise(image, N2, WISH)


def test_time_zone_data_may_be_missing(tmp_path: Path) -> None:
    files = {name: text for name, text in ROOT.items() if "zoneinfo" not in name}
    image = disk(tmp_path / "gw.img", tree(tmp_path / "root", files))
    assert "no time zone data" in customise(image, N2, WISH)[0]
