"""Files are written in one way: a link that somebody else has laid at a draft's or at the file's name leads nowhere."""

import ast
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from atlantis_netcfg.checklist._signing import SigningKey
from atlantis_netcfg.cli import declaration as cli_declaration
from atlantis_netcfg.cli import devices as cli_devices
from atlantis_netcfg.core.atomic_files import write_atomically
from atlantis_netcfg.core.crash_report import write_log
from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.core.eventlog import EventLog
from atlantis_netcfg.core.paths import write_private
from atlantis_netcfg.links.qualify.judgement import profile as thresholds
from atlantis_netcfg.links.qualify.measured_run import BudgetLimits, FarEnd, MeasuredRun, Selection, write_run
from atlantis_netcfg.links.qualify.profile import LinkProfile, write_profile
from atlantis_netcfg.operations.common import inventory_files
from atlantis_netcfg.runs import Counters, Pins, SiteLock, Usage, unwritable
from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.authority import model

ROOT = Path(__file__).parents[3]
NOW = datetime(2026, 11, 28, 12, tzinfo=UTC)
VICTIM = b"{}\n"
EMPTY: LinkProfile = LinkProfile.model_construct(**dict[str, Any]())


def measured() -> MeasuredRun:
    far_end = FarEnd(name="a", address="192.0.2.1", port=862, over_vpn=False, authenticated=True, source="192.0.2.9")
    return MeasuredRun(
        id="a",
        tool="0",
        site="coastal",
        link="4g",
        kind="lte",
        emulated=True,
        selection=Selection.ALL,
        far_end=far_end,
        begun=NOW,
        ended=NOW,
        reason="done",
        clock_synchronised=False,
        budget=BudgetLimits(),
        thresholds_name="lte",
        thresholds=thresholds("lte"),
    )


def publish(path: Path) -> None:
    ca = pki.new_ca("EXAMPLE", NOW)
    pki.publish(path, pki.new_crl(ca, [], 5, NOW), ca.certificate, above=None, now=NOW)


def hold(path: Path) -> None:
    with SiteLock(path, "coastal", "test"):
        pass


def append(path: Path) -> None:
    log = EventLog(path, lambda error: unwritable("the log", path, error))
    log.append(b"line\n")
    log.close()


def look(path: Path) -> None:
    Usage(path).record("4g", Counters(device="r", interface="ether1", rx_bytes=1, tx_bytes=1, at=NOW))


def report(path: Path) -> None:
    cli_devices._write(path, b"<report/>")


WRITERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "any file": ("file", lambda path: write_atomically(path, b"data")),
    "emulator's state": ("state", lambda path: write_private(path, b"data")),
    "pinned keys": ("pins.json", lambda path: Pins(path).pin("router", "ab")),
    "bytes of a month": ("usage.json", look),
    "lock of a site": ("lock", hold),
    "journal": ("journal.jsonl", append),
    "report of drift": ("drift.xml", report),
    "profiles of DDS": ("dds.xml", lambda path: cli_declaration._write(path.parent, {path.name: "<profiles/>"})),
    "guests": ("guests.yml", lambda path: inventory_files.put(path, "guests: {}\n")),
    "run of a measurement": ("run.json", lambda path: write_run(path.parent, measured())),
    "profile of a link": ("profile.json", lambda path: write_profile(path.parent, EMPTY)),
    "revocation list": ("crl.pem", publish),
    "key for signing": ("signing-key.pem", SigningKey.load_or_create),
    "lock of the authority": (model.LOCK_FILE, lambda path: model.Lock(path.parent, "ana").__enter__()),
}


@pytest.fixture
def shared(tmp_path: Path) -> Path:
    """A folder in which somebody else may lay links."""
    folder = tmp_path / "shared"
    folder.mkdir()
    return folder


@pytest.fixture
def victim(tmp_path: Path) -> Iterator[Path]:
    path = tmp_path / "victim"
    path.write_bytes(VICTIM)
    yield path
    assert path.read_bytes() == VICTIM


@pytest.mark.parametrize(("name", "write"), WRITERS.values(), ids=WRITERS)
def test_symlink_at_the_temporary_name_is_not_followed(
    name: str, write: Callable[[Path], object], shared: Path, victim: Path
) -> None:
    for end in (str(os.getpid()), "new", f"new.{os.getpid()}", f"{0:016}"):
        (shared / f".{name}.{end}").symlink_to(victim)
    write(shared / name)
    assert not (shared / name).is_symlink()
    assert (shared / name).is_file()


@pytest.mark.parametrize(("name", "write"), WRITERS.values(), ids=WRITERS)
def test_symlink_at_the_file_name_is_not_written_through(
    name: str, write: Callable[[Path], object], shared: Path, victim: Path
) -> None:
    (shared / name).symlink_to(victim)
    with suppress(NetcfgError):
        write(shared / name)


@pytest.mark.parametrize("writer", ["pinned keys", "bytes of a month"])
def test_symlink_at_the_lock_name_is_not_followed(writer: str, shared: Path, victim: Path) -> None:
    name, write = WRITERS[writer]
    (shared / name).with_suffix(".lock").symlink_to(victim.parent / "made")
    with pytest.raises(NetcfgError, match="cannot be written"):
        write(shared / name)
    assert not (victim.parent / "made").exists()


def test_a_crash_report_is_private_and_complete(tmp_path: Path) -> None:
    path = write_log("caf\udce9", "doing", tmp_path)
    assert path.read_text().endswith("doing\n\ncaf\\udce9")
    assert path.stat().st_mode & 0o777 == 0o600


KILLED = """\
import os, signal, sys
from pathlib import Path
from atlantis_netcfg.core.atomic_files import write_atomically
os.fsync = lambda _: (print(flush=True), signal.pause())
write_atomically(Path(sys.argv[1]), b"half")
"""


def test_only_temporary_files_of_killed_processes_are_removed(shared: Path) -> None:
    path = shared / "file"
    with subprocess.Popen([sys.executable, "-c", KILLED, str(path)], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        (draft,) = shared.iterdir()
        write_atomically(path, b"next")
        assert {*shared.iterdir()} == {draft, path}
        process.send_signal(signal.SIGKILL)
    write_atomically(path, b"last")
    assert [*shared.iterdir()] == [path]
    assert path.read_bytes() == b"last"


def test_other_file_types_with_a_temporary_name_are_ignored(shared: Path) -> None:
    folder, pipe = shared / f".file.{1:016}", shared / f".file.{2:016}"
    folder.mkdir()
    os.mkfifo(pipe)
    write_atomically(shared / "file", b"data")
    assert folder.is_dir()


def test_existing_file_is_kept_without_replace(shared: Path) -> None:
    write_atomically(shared / "file", b"first", replace=False)
    with pytest.raises(FileExistsError):
        write_atomically(shared / "file", b"second", replace=False)
    assert [path.read_bytes() for path in shared.iterdir()] == [b"first"]


def test_a_failed_write_leaves_the_old_file_alone(shared: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_atomically(shared / "file", b"old")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        write_atomically(shared / "file", b"new")
    assert [path.read_bytes() for path in shared.iterdir()] == [b"old"]


def test_modes_are_exact_unless_the_umask_applies(shared: Path) -> None:
    before = os.umask(0o027)
    try:
        write_atomically(shared / "ours", b"", mode=0o644)
        write_atomically(shared / "theirs", b"", mode=None)
    finally:
        os.umask(before)
    assert [(shared / name).stat().st_mode & 0o777 for name in ("ours", "theirs")] == [0o644, 0o640]


BOARD = "ansible_collections/atlantis/netcfg/plugins"
ELSEWHERE = {
    # Into a folder of core/temporary.py, which is new, private and gone afterwards.
    "computers/bundle/manifest.py": 1,
    "computers/bundle/resolve.py": 5,
    "computers/image/ext4.py": 2,
    "computers/image/plan.py": 1,
    "operations/retrieve_rehearsal.py": 4,
    # Into a folder that is new and ours: the draft of a bundle, the draft of an inventory.
    "computers/bundle/build.py": 3,
    "inventory/new_inventory/writing.py": 1,
    # Emulated machines and their programs: root file systems and logs in folders of their own.
    "emulator/lab/hosts.py": 3,
    "emulator/lab/lab.py": 1,
    "emulator/lab/stubs/archive.py": 6,
    "emulator/lab/stubs/programs/ros2.py": 2,
    "emulator/routeros/running.py": 1,
    "emulator/ssh.py": 1,
    # Tools of the checkout write its pages, which are in git.
    "inventory/json_schema.py": 1,
    "inventory/key_reference.py": 1,
    # Programs of a gateway, in Python's standard library alone, in folders of root or new ones.
    f"{BOARD}/module_utils/apt_run.py": 1,
    f"{BOARD}/module_utils/build_git.py": 3,
    f"{BOARD}/module_utils/build_make.py": 3,
    f"{BOARD}/module_utils/build_start.py": 2,
    f"{BOARD}/module_utils/file_transaction.py": 1,
    f"{BOARD}/module_utils/network_desired.py": 1,
    f"{BOARD}/module_utils/network_files.py": 2,
    f"{BOARD}/module_utils/ssh_access.py": 1,
    f"{BOARD}/module_utils/vpn_server.py": 1,
    f"{BOARD}/modules/bundle.py": 1,
    f"{BOARD}/plugin_utils/board/install.py": 1,
    "../templates/gateway/retrieval.py": 2,
    "../templates/gateway/retrieval_receive.py": 1,
    "../templates/gateway/ros2_hears.py": 1,
    "../templates/handout/self_test.py": 1,
    "../templates/openvpn/vpn_seen.py": 1,
}
"""How often a file is written in another way, and why that is safe."""


def plain_writes(path: Path) -> Iterator[ast.Call]:
    """`write_text`, `write_bytes`, and `open` and `fdopen` for writing that take what is there."""
    for node in ast.walk(ast.parse(path.read_text())):
        if not isinstance(node, ast.Call):
            continue
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        if name in ("write_text", "write_bytes"):
            yield node
        given = [*node.args, *(word.value for word in node.keywords if word.arg == "mode")]
        modes = [word.value for word in given if isinstance(word, ast.Constant) and isinstance(word.value, str)]
        archive = isinstance(node.func, ast.Attribute) and getattr(node.func.value, "id", "") == "tarfile"
        if name in ("open", "fdopen") and not archive and any({*mode} & {*"wa+"} and len(mode) < 4 for mode in modes):
            yield node
        if name == "open" and {"O_CREAT", "O_EXCL"} & {*ast.dump(node).split("'")} == {"O_CREAT"}:
            yield node


def test_files_are_written_by_one_module() -> None:
    package = ROOT / "atlantis_netcfg"
    found = {
        os.path.relpath(path, package): number
        for path in (*package.rglob("*.py"), *(ROOT / "templates").rglob("*.py"))
        if path != package / "core" / "atomic_files.py" and (number := len([*plain_writes(path)]))
    }
    assert found == ELSEWHERE
