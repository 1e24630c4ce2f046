"""Real images onto real loop devices, which the tree shows as cards in a reader; the guard is the product's own."""

import os
import random
import subprocess
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest
from blocks_fake import LoopCard, Tree, loop

from atlantis_netcfg.computers.image.blocks import require_writable_disk
from atlantis_netcfg.computers.image.facts import BlockDeviceError, CardWriteError
from atlantis_netcfg.computers.image.source import Segment, SourceKind, segments
from atlantis_netcfg.computers.image.writer import Card, Progress, WriterStep, WrittenCard, write
from atlantis_netcfg.core.errors import ExitCode

MIB = 2**20
SIZE = 24 * MIB
OLD = b"what was on the card before "


@pytest.fixture
def image(tmp_path: Path) -> Path:
    """Data at the start, in the middle and at the end, and holes between."""
    path = tmp_path / "image"
    dice = random.Random(1)  # noqa: S311 - the same image each time
    with path.open("wb") as file:
        for at, size in ((0, 3 * MIB), (9 * MIB + 4096, 70000), (SIZE - 4096, 4096)):
            file.seek(at)
            file.write(dice.randbytes(size))
    return path


@pytest.fixture
def used(tmp_path: Path) -> Iterator[LoopCard]:
    with loop(tmp_path / "behind", 32 * MIB, OLD) as card:
        yield card


def shown(tmp_path: Path, card: LoopCard, size: int = 32 * MIB) -> Card:
    tree = Tree(tmp_path / "tree")
    tree.disk(card.number, size=size).serial("S1")
    return Card(card.device, require_writable_disk(tree.blocks, card.device), tree.blocks)


def put(image: Path, card: Card, parts: tuple[Segment, ...] | None = None) -> tuple[WrittenCard, list[Progress]]:
    told: list[Progress] = []
    return write(image, segments(image, SIZE) if parts is None else parts, card, told.append), told


def test_card_equals_the_image_and_rest_is_unchanged(tmp_path: Path, image: Path, used: LoopCard) -> None:
    written, told = put(image, shown(tmp_path, used))
    assert used.device.read_bytes()[:SIZE] == image.read_bytes()
    assert used.file.read_bytes()[SIZE:] == (OLD * (MIB // len(OLD) + 1))[:MIB] * 8
    assert written.compared == SIZE
    assert written.data + written.cleared + written.skipped == SIZE
    assert {each.step for each in told} == {WriterStep.CLEARING, WriterStep.WRITING, WriterStep.COMPARING}
    assert all(each.done_bytes == each.total for each in told if "100 %" in each.words)


def test_writing_again_writes_no_zeros(tmp_path: Path, image: Path, used: LoopCard) -> None:
    card = shown(tmp_path, used)
    put(image, card)
    again, _ = put(image, card)
    assert again.cleared == 0
    assert again.skipped > 0
    assert used.device.read_bytes()[:SIZE] == image.read_bytes()


def test_blocks_outside_the_block_map_are_neither_written_nor_read(tmp_path: Path, image: Path, used: LoopCard) -> None:
    parts = segments(image, SIZE, [(0, 4 * MIB)])
    written, _ = put(image, shown(tmp_path, used), parts)
    after, wanted = used.device.read_bytes(), image.read_bytes()
    for part in parts:
        assert after[part.start : part.end] == wanted[part.start : part.end]
    assert OLD in after[5 * MIB : 6 * MIB]
    assert written.compared < SIZE


@pytest.mark.smoke("512", "1048576")
@pytest.mark.parametrize("end", [1, 512, 4096, MIB - 512, MIB, MIB + 512])
def test_images_of_any_size(end: int, tmp_path: Path, used: LoopCard) -> None:
    image = tmp_path / "small"
    size = -(-end // 512) * 512
    image.write_bytes(bytes([7]) * end + bytes(-end % 4096))
    put(image, shown(tmp_path, used), segments(image, size))
    after = used.device.read_bytes()
    assert after[:size] == image.read_bytes()[:size]
    assert OLD[:16] in after[max(size, MIB) : max(size, MIB) + 100]


class Stopped:
    """A subscriber at which the writing stops, as by Ctrl-C."""

    def __init__(self, step: WriterStep) -> None:
        self.step = step

    def __call__(self, progress: Progress) -> None:
        if progress.step is self.step:
            raise KeyboardInterrupt


@pytest.mark.smoke("writing")
@pytest.mark.parametrize("step", [WriterStep.CLEARING, WriterStep.WRITING, WriterStep.COMPARING])
def test_interrupted_card_does_not_boot(step: WriterStep, tmp_path: Path, image: Path, used: LoopCard) -> None:
    card = shown(tmp_path, used)
    with pytest.raises(CardWriteError, match=r"it was stopped. Its first block is empty") as caught:
        write(image, segments(image, SIZE), card, Stopped(step))
    assert caught.value.exit is ExitCode.FAILED
    assert used.device.read_bytes()[:MIB] == bytes(MIB)
    put(image, card)
    assert used.device.read_bytes()[:SIZE] == image.read_bytes()


KILLED = """
import os, sys
from pathlib import Path
sys.path[:0] = sys.argv[4:]
from blocks_fake import LoopCard
from test_image_writer import SIZE, shown
from atlantis_netcfg.computers.image.writer import WriterStep
from atlantis_netcfg.computers.image.source import segments
from atlantis_netcfg.computers.image.writer import write
image, device, file = map(Path, sys.argv[1:4])
status = device.stat().st_rdev
card = LoopCard(device, file, f"{os.major(status)}:{os.minor(status)}")
def tell(progress):
    if progress.step is WriterStep.COMPARING:
        os.kill(os.getpid(), 9)
write(image, segments(image, SIZE), shown(file.parent / "child", card), tell)
"""


def test_a_kill_before_the_end_leaves_a_card_that_does_not_boot(tmp_path: Path, image: Path, used: LoopCard) -> None:
    """The power is cut after the data was written and before the first block was."""
    here = Path(__file__).parent
    (tmp_path / "child").mkdir()
    command = [sys.executable, "-c", KILLED, image, used.device, used.file, here, here.parents[3]]
    assert subprocess.run([str(word) for word in command], check=False).returncode == -9
    after = used.device.read_bytes()
    assert after[:MIB] == bytes(MIB)
    assert after[2 * MIB : 3 * MIB] == image.read_bytes()[2 * MIB : 3 * MIB]


def test_card_that_loses_data_is_detected(
    tmp_path: Path, image: Path, used: LoopCard, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a card that claims more room than it has: what was written at one place is gone when it is read back."""
    keeps, real = 9 * MIB, os.pwrite

    def lossy(descriptor: int, data: memoryview, at: int) -> int:
        return len(data) if at >= keeps else real(descriptor, data, at)

    card = shown(tmp_path, used)
    monkeypatch.setattr(os, "pwrite", lossy)
    with pytest.raises(CardWriteError, match="read back from it differ from those written"):
        put(image, card)
    monkeypatch.undo()
    assert used.device.read_bytes()[:MIB] == bytes(MIB)


def test_write_error_of_the_card_is_reported(
    tmp_path: Path, image: Path, used: LoopCard, monkeypatch: pytest.MonkeyPatch
) -> None:
    card = shown(tmp_path, used)

    def broken(_descriptor: int, _data: memoryview, _at: int) -> int:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(os, "pwrite", broken)
    with pytest.raises(CardWriteError, match=r"Input/output error.*could not be cleared either: do not use this card"):
        put(image, card)


def test_a_mounted_disk_is_refused_by_the_kernel_as_well(tmp_path: Path, image: Path, used: LoopCard) -> None:
    """The tree does not tell of it, as with a mount of another namespace: O_EXCL does."""
    held = os.open(used.device, os.O_RDWR | os.O_EXCL)
    try:
        with pytest.raises(BlockDeviceError, match="is in use by this computer, and nothing was written"):
            put(image, shown(tmp_path, used))
    finally:
        os.close(held)
    assert used.device.read_bytes()[:MIB] == used.file.read_bytes()[:MIB]
    assert used.device.read_bytes()[: len(OLD)] == OLD


def test_a_size_that_the_kernel_does_not_confirm_is_refused(tmp_path: Path, image: Path, used: LoopCard) -> None:
    with pytest.raises(BlockDeviceError, match="not the 33554944 that were shown; nothing was written"):
        put(image, shown(tmp_path, used, 32 * MIB + 512))
    assert used.device.read_bytes()[: len(OLD)] == OLD


def test_a_card_that_is_too_small_is_refused(tmp_path: Path, image: Path) -> None:
    with loop(tmp_path / "small", 16 * MIB, OLD) as card:
        with pytest.raises(BlockDeviceError, match=f"it has {16 * MIB} bytes, but the image needs {SIZE}"):
            put(image, shown(tmp_path, card, 16 * MIB))
        assert card.device.read_bytes()[: len(OLD)] == OLD


def test_segments_cover_the_image_once(image: Path) -> None:
    parts = segments(image, SIZE)
    assert parts[0].start == 0
    assert parts[-1].end == SIZE
    assert all(one.end == other.start for one, other in pairwise(parts))
    data = image.read_bytes()
    assert all(not any(data[part.start : part.end]) for part in parts if part.kind is SourceKind.ZERO)
    assert any(part.kind is SourceKind.ZERO for part in parts)
