"""`provision gateway image` as people type it; the card is a loop device that a tree shows as a card in a reader."""

import hashlib
import io
import json
import lzma
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from blocks_fake import LoopCard, Tree, loop
from image_made import ROOT_AT, disk, tree

from atlantis_netcfg.cli import main
from atlantis_netcfg.computers.image.ext4 import Ext4
from atlantis_netcfg.computers.image.plan import customise
from atlantis_netcfg.inventory import load

pytestmark = pytest.mark.slow

SHIPPED = Path(__file__).parents[4] / "inventory"
SERIAL = "20090516388200"
SIZE = 200 * 2**20
OLD = b"somebody's photographs "


@pytest.fixture(scope="module")
def vendors(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("vendor")
    image = disk(folder / "n2.img", tree(folder / "root"))
    packed = folder / "n2.img.xz"
    with lzma.open(packed, "wb", preset=0) as out:
        out.write(image.read_bytes())
    digest = hashlib.sha256(packed.read_bytes()).hexdigest()
    (folder / "n2.img.xz.sha256").write_text(f"{digest}  n2.img.xz\n")
    return packed


@dataclass
class Desk:
    """A technician's laptop with a card in its reader."""

    card: LoopCard
    tree: Tree
    state: Path
    words: list[str]
    capsys: pytest.CaptureFixture[str]

    def type(self, *more: str) -> tuple[int, str, str]:
        code = main(["gateway", "image", *self.words, *more])
        said = self.capsys.readouterr()
        return code, said.out, said.err

    @property
    def untouched(self) -> bool:
        data = self.card.device.read_bytes()
        return data == (OLD * (2**20 // len(OLD) + 1))[: 2**20] * (SIZE // 2**20)

    @property
    def receipts(self) -> list[dict[str, object]]:
        return [json.loads(path.read_text()) for path in sorted(self.state.glob("real/coastal/images/*.json"))]


@pytest.fixture
def desk(
    tmp_path: Path, vendors: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Iterator[Desk]:
    declared = load(SHIPPED)
    real = replace(declared, pilot=declared.pilot.model_copy(update={"example_values": False}))
    monkeypatch.setattr("atlantis_netcfg.inventory.load", lambda root: load(root) if root == SHIPPED else real)
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path / "state"))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    with loop(tmp_path / "behind", SIZE, OLD) as card:
        shown = Tree(tmp_path / "tree")
        shown.disk(card.number, size=SIZE).serial(SERIAL)
        monkeypatch.setattr("atlantis_netcfg.computers.image.blocks.BlockTree", lambda: shown.blocks)
        words = ["inventory=real", "site=coastal", "device=coastal-gateway", f"from={vendors}"]
        yield Desk(card, shown, tmp_path / "state", words, capsys)


@pytest.mark.smoke
def test_card_is_written(desk: Desk) -> None:
    code, out, err = desk.type(f"to={desk.card.device}", f"serial={SERIAL}", "--yes")
    assert code == 0, err
    assert f"USB, serial {SERIAL}" in out
    assert "written and verified in" in out
    assert "Not tested: booting the board from it. Its boot switch, if any, must be set to MMC." in out
    assert "writing 100 %" in err
    assert Ext4(desk.card.device, ROOT_AT).read("/etc/hostname") == b"coastal-gateway\n"
    keys = "\n".join(load(SHIPPED).hosts["coastal-gateway"].device.image.ssh_keys)  # type: ignore[union-attr] # a gateway
    assert Ext4(desk.card.device, ROOT_AT).read("/root/.ssh/authorized_keys") == f"{keys}\n".encode()
    (receipt,) = desk.receipts
    assert (receipt["outcome"], receipt["host"]) == ("written", "coastal-gateway")
    assert receipt["device"] == {"name": "sdb", "label": "", "serial": SERIAL, "size": SIZE, "bus": "USB"}
    assert list(desk.state.parent.glob("atlantis-image-*")) == []


def test_json_output(desk: Desk, vendors: Path) -> None:
    code, out, err = desk.type(f"to={desk.card.device}", f"serial={SERIAL}", "--yes", "--json")
    told = json.loads(out)
    assert (code, err, told["exit"]) == (0, "", 0)
    assert told["image"]["sha256"] == hashlib.sha256(vendors.read_bytes()).hexdigest()
    assert told["image"]["confirmed_by"] == "n2.img.xz.sha256"
    assert told["device"]["serial"] == SERIAL
    assert told["written"]["compared"] > 100 * 2**20
    assert json.loads(Path(told["receipt"]).read_text())["outcome"] == "written"


def test_image_only_touches_no_card(desk: Desk, tmp_path: Path) -> None:
    file = tmp_path / "spare.img"
    code, out, _ = desk.type("--image-only", str(file))
    assert code == 0
    assert "no card was written" in out
    assert Ext4(file, ROOT_AT).read("/etc/hostname") == b"coastal-gateway\n"
    assert file.stat().st_blocks * 512 < file.stat().st_size
    again, _, err = desk.type("--image-only", str(file))
    assert again == 3
    assert "already exists" in err
    assert desk.untouched
    assert desk.receipts == []


def test_example_values_make_an_image_and_no_card(desk: Desk, tmp_path: Path) -> None:
    desk.words[0] = f"inventory={SHIPPED}"
    code, _, err = desk.type(f"to={desk.card.device}", f"serial={SERIAL}", "--yes")
    assert code == 3
    assert "still contains example values" in err
    assert desk.untouched
    assert desk.type("--image-only", str(tmp_path / "spare.img"))[0] == 0


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["serial=another", "--yes"], "`another` is not the serial of sdb, and nothing was written"),
        ([], "no terminal to type the serial of the card; nothing was written"),
        ([f"serial={SERIAL}"], "no terminal to confirm these changes"),
        ([f"serial={SERIAL}", "--yes", "sha256=" + "0" * 64], "its SHA-256 is"),
        ([f"serial={SERIAL}", "--yes", "--image-only", "x"], "`to=` and `--image-only` cannot be used together"),
        ([f"serial={SERIAL}", "--yes", "sha256=12"], "`12` is not a SHA-256"),
    ],
)
def test_invalid_target_is_refused_and_nothing_is_written(desk: Desk, more: list[str], said: str) -> None:
    code, _, err = desk.type(f"to={desk.card.device}", *more)
    assert code == 3
    assert said in err
    assert desk.untouched
    assert desk.receipts == []


def test_missing_programs_are_reported_before_unpacking(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    def unpacked(*_given: object) -> None:
        raise AssertionError("it was unpacked")

    monkeypatch.setattr("atlantis_netcfg.operations.image.expand", unpacked)
    monkeypatch.setattr("shutil.which", lambda name, **_more: "/bin/x" if name == "e2fsck" else None)
    code, _, err = desk.type(f"to={desk.card.device}", f"serial={SERIAL}", "--yes")
    assert code == 3
    assert "`debugfs` and `mcopy` are not installed on this computer" in err
    assert "sudo apt install e2fsprogs mtools" in err
    assert desk.untouched


@pytest.mark.smoke
def test_disk_in_use_by_this_computer_is_refused(desk: Desk) -> None:
    desk.tree.mount(desk.card.number, "/home", "/dev/sdb")
    code, _, err = desk.type(f"to={desk.card.device}", f"serial={SERIAL}", "--yes")
    assert code == 3
    assert "this computer runs from it: sdb is mounted at /home" in err
    assert desk.untouched


def test_card_swapped_during_image_preparation_is_refused(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    real = customise

    def swapped(*given: object) -> tuple[str, ...]:
        (desk.tree.sys / "dev" / "block" / desk.card.number / "diskseq").write_text("8\n")
        return real(*given)  # type: ignore[arg-type] # passed on as it came

    monkeypatch.setattr("atlantis_netcfg.operations.image.customise", swapped)
    code, _, err = desk.type(f"to={desk.card.device}", f"serial={SERIAL}", "--yes")
    assert code == 3
    assert "has changed since it was shown, and nothing was written" in err
    assert desk.untouched
    assert desk.receipts == []


class Keyboard(io.StringIO):
    """Somebody sits at the laptop."""

    def isatty(self) -> bool:
        return True


@pytest.mark.smoke("serial")
@pytest.mark.parametrize(
    ("typed", "code", "said"),
    [
        (f"{SERIAL}\n", 0, "written and verified in"),
        ("yes\n", 3, "`yes` is not the serial of sdb, and nothing was written"),
        ("", 3, "`` is not the serial of sdb, and nothing was written"),
    ],
    ids=["serial", "yes", "end of input"],
)
def test_serial_must_be_typed_to_confirm(
    desk: Desk, monkeypatch: pytest.MonkeyPatch, typed: str, code: int, said: str
) -> None:
    monkeypatch.setattr("sys.stdin", Keyboard(typed))
    found, out, err = desk.type(f"to={desk.card.device}")
    assert (found, said in out + err) == (code, True)
    assert f"Everything on it will be erased. Type its serial ({SERIAL}) to continue: " in out
    assert desk.untouched is (code != 0)


def test_interrupt_before_writing_leaves_the_card_untouched(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(*_given: object) -> tuple[str, ...]:
        raise KeyboardInterrupt

    monkeypatch.setattr("atlantis_netcfg.operations.image.customise", stopped)
    code, _, err = desk.type(f"to={desk.card.device}", f"serial={SERIAL}", "--yes")
    assert code == 4
    assert "no card was written" in err
    assert desk.untouched
    assert list(desk.state.parent.glob("atlantis-image-*")) == []


def test_card_for_an_unsupported_host_is_refused(desk: Desk) -> None:
    desk.words[2] = "device=coastal-router"
    code, _, err = desk.type("--image-only", "x")
    assert code == 3
    assert "`coastal-router` is a router; cards are only for gateways, control centres and operator stations" in err


def test_missing_target_is_refused(desk: Desk) -> None:
    code, _, err = desk.type()
    assert code == 3
    assert "no destination for the image" in err


def test_failed_write_is_recorded(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(_descriptor: int, _data: memoryview, _at: int) -> int:
        raise OSError(5, "Input/output error")

    real = os.pwrite
    monkeypatch.setattr("atlantis_netcfg.computers.image.writer.os.pwrite", broken)
    code, _, err = desk.type(f"to={desk.card.device}", f"serial={SERIAL}", "--yes")
    monkeypatch.setattr("atlantis_netcfg.computers.image.writer.os.pwrite", real)
    assert code == 4
    assert "the card was not written completely:" in err
    (receipt,) = desk.receipts
    assert receipt["outcome"] == "failed"
