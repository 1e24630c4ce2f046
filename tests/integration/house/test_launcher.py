"""./provision on machines in every state that we have met, with a small package behind it."""

import json
import os
import shutil
import signal
import socket
import ssl
import subprocess
import threading
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from house_checkout import NOBODY, as_nobody, clean_environment, let_others_pass, start
from house_small import LOCK, folder_of_wheels, quick_python, small_checkout

pytestmark = pytest.mark.slow

POISON = "raise SystemExit('a module of the user was imported')\n"


def told(process: subprocess.CompletedProcess[str]) -> dict[str, Any]:
    """What the package said of its start; it always ends with 7."""
    assert process.returncode == 7, process.stderr
    report: dict[str, Any] = json.loads(process.stdout)
    return report


@pytest.fixture(scope="session")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return folder_of_wheels(tmp_path_factory.mktemp("of") / "wheels")


@pytest.fixture(scope="session")
def offline(wheels: Path) -> dict[str, str]:
    """No HOME, no index: only the folder of wheels."""
    environment = clean_environment(
        PIP_NO_INDEX="1", PIP_FIND_LINKS=str(wheels), ATLANTIS_PYTHON=str(quick_python(wheels.parent))
    )
    return {name: value for name, value in environment.items() if "INDEX_URL" not in name}


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory, offline: dict[str, str]) -> Path:
    """A checkout after its first start, which took place in as hostile an environment as we know."""
    base = tmp_path_factory.mktemp("small")
    (base / "modules").mkdir()
    for name in ("json", "pip", "sitecustomize", "encodings"):
        (base / "modules" / f"{name}.py").write_text(POISON)
    hostile = {
        "HOME": "/nonexistent",
        "CDPATH": "/",
        "PYTHONPATH": str(base / "modules"),
        "PYTHONHOME": "/nonexistent",
        "PYTHONOPTIMIZE": "2",
        "PYTHONWARNINGS": "error",
        "PIP_USER": "1",
        "PIP_TARGET": str(base / "elsewhere"),
        "PIP_REQUIRE_HASHES": "1",
        "PIP_CONSTRAINT": "/nonexistent",
        "PIP_NO_DEPS": "1",
        "VIRTUAL_ENV": "/nonexistent",
    }
    checkout = small_checkout(base / "a checkout with spaces")
    machine = {name: value for name, value in offline.items() if name != "ATLANTIS_PYTHON"}
    first = start(checkout, "one", environment=machine | hostile)
    assert told(first)["argv"] == ["one"]
    (base / "first.stderr").write_text(first.stderr)
    return checkout


@pytest.fixture
def checkout(made: Path, tmp_path: Path) -> Path:
    """A made checkout of the test's own; it was copied, so its first start moves its environment."""
    return shutil.copytree(made, tmp_path / "a copy", symlinks=True)


def test_first_start_reports_its_progress(made: Path) -> None:
    said = (made.parent / "first.stderr").read_text()
    steps = [line[:5] for line in said.splitlines() if line.startswith("[")]
    assert steps == ["[1/4]", "[2/4]", "[3/4]", "[4/4]"]
    assert str(made) in said
    assert not (made.parent / "elsewhere").exists()


def test_later_starts_are_silent_and_call_no_pip(made: Path, tmp_path: Path) -> None:
    log = made / ".venv-setup" / "log"
    before = log.stat().st_mtime_ns
    later = start(made, environment=clean_environment(PIP_INDEX_URL="http://127.0.0.1:1/"), cwd=tmp_path)
    assert told(later)["python"] == str(made / ".venv" / "bin" / "python")
    assert later.stderr == ""
    assert log.stat().st_mtime_ns == before


@pytest.mark.smoke
def test_arguments_and_exit_code_pass_untouched(made: Path) -> None:
    arguments = ["site=a b", "", "--", "-h", "it's", 'a "quote"', "$HOME", "*", "two\nlines", "ü…"]
    assert told(start(made, *arguments))["argv"] == arguments


def test_started_from_anywhere_through_symlinks(made: Path, tmp_path: Path) -> None:
    (tmp_path / "bin").mkdir()
    (tmp_path / "real name").symlink_to(made)
    (tmp_path / "bin" / "inner").symlink_to("../real name/provision")
    (tmp_path / "bin" / "provision").symlink_to("inner")
    (tmp_path / "json.py").write_text(POISON)
    process = start(tmp_path / "bin", cwd=tmp_path)
    assert told(process)["cwd"] == str(tmp_path)
    by_path = clean_environment(PATH=f"{tmp_path}/bin:{os.environ['PATH']}")
    found = subprocess.run(
        ["sh", "-c", "provision x"], env=by_path, cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert told(found)["argv"] == ["x"]
    beside = subprocess.run(
        ["sh", "provision", "y"], env=by_path, cwd=made, capture_output=True, text=True, check=False
    )
    assert told(beside)["argv"] == ["y"]


def test_python_environment_of_the_user_is_ignored(made: Path, tmp_path: Path) -> None:
    (tmp_path / "json.py").write_text(POISON)
    hostile = clean_environment(PYTHONPATH=str(tmp_path), PYTHONHOME="/nonexistent", PYTHONSTARTUP="/nonexistent")
    assert str(tmp_path) not in told(start(made, environment=hostile, cwd=tmp_path))["path"]


def test_a_moved_checkout_needs_no_index(checkout: Path) -> None:
    offline = clean_environment(PIP_NO_INDEX="1")
    moved = start(checkout, environment=offline)
    assert told(moved)["python"] == str(checkout / ".venv" / "bin" / "python")
    assert "the checkout was moved from" in moved.stderr
    assert start(checkout, environment=offline).stderr == ""
    pip = subprocess.run([checkout / ".venv" / "bin" / "pip", "--version"], capture_output=True, text=True, check=True)
    assert str(checkout) in pip.stdout


def test_changed_pins_update_the_environment_once(checkout: Path, offline: dict[str, str]) -> None:
    start(checkout, environment=offline)
    (checkout / "requirements" / "run.txt").write_text(f"# as before\n{LOCK}")
    renewed = start(checkout, environment=offline)
    told(renewed)
    assert "up to date" in renewed.stderr
    assert "waiting" not in renewed.stderr, "the start before has ended, and does not contain lock"
    assert start(checkout, environment=offline).stderr == ""


def test_unavailable_pins_leave_the_environment_unchanged(checkout: Path, offline: dict[str, str]) -> None:
    start(checkout, environment=offline)
    lock = checkout / "requirements" / "run.txt"
    lock.write_text(f"{LOCK}no-such-package-anywhere==1 --hash=sha256:{'0' * 64}\n")
    refused = start(checkout, environment=offline)
    assert (refused.returncode, refused.stdout) == (3, "")
    assert "no-such-package-anywhere" in refused.stderr
    assert "PIP_FIND_LINKS" in refused.stderr
    lock.write_text(LOCK)
    assert start(checkout, environment=offline).stderr == ""


@pytest.mark.parametrize("lock", [LOCK.replace("sha256:", "sha256:0")[:-2] + "\n", "setuptools==999\n"])
def test_package_with_another_or_no_hash_is_not_installed(lock: str, tmp_path: Path, offline: dict[str, str]) -> None:
    """Another file than the one whose SHA-256 stands in the list, and one of which none stands there."""
    checkout = small_checkout(tmp_path / "checkout")
    (checkout / "requirements" / "run.txt").write_text(lock)
    refused = start(checkout, environment=offline)
    assert (refused.returncode, refused.stdout) == (3, "")
    assert "hash" in refused.stderr.lower()
    assert not (checkout / ".venv" / "run.stamp").exists()


@pytest.mark.parametrize("damage", ["interrupted", "python is gone"])
def test_incomplete_environment_is_rebuilt(damage: str, checkout: Path, offline: dict[str, str]) -> None:
    start(checkout, environment=offline)
    if damage == "interrupted":
        kill_in_the_middle(checkout, offline)
    else:
        for python in (checkout / ".venv" / "bin").glob("python*"):
            python.unlink()
            python.symlink_to("/nonexistent/python3")
    recovered = start(checkout, environment=offline)
    told(recovered)
    assert "making it anew" in recovered.stderr
    assert start(checkout, environment=offline).stderr == ""


@pytest.mark.parametrize(
    ("index", "said"),
    [("http://127.0.0.1:1/", "does not respond"), ("https://127.0.0.1:{port}/", "is the clock right?")],
    ids=["silent", "not to be trusted"],
)
def test_unusable_package_index_is_reported(
    index: str, said: str, tmp_path: Path, untrusted: int, offline: dict[str, str]
) -> None:
    checkout = small_checkout(tmp_path / "checkout")
    environment = {name: value for name, value in clean_environment().items() if not name.startswith("PIP_")}
    settings = {"PIP_INDEX_URL": index.format(port=untrusted), "PIP_RETRIES": "1", "PIP_CONFIG_FILE": "/dev/null"}
    settings["ATLANTIS_PYTHON"] = offline["ATLANTIS_PYTHON"]
    refused = start(checkout, environment=environment | settings)
    assert (refused.returncode, refused.stdout) == (3, "")
    assert said in refused.stderr
    assert str(checkout / ".venv-setup" / "log") in refused.stderr


@pytest.fixture
def untrusted(tmp_path: Path) -> Iterator[int]:
    """A port that answers with a certificate of its own making, as a machine with a wrong clock sees every one."""
    certificate, key = tmp_path / "certificate.pem", tmp_path / "key.pem"
    make = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-subj", "/CN=127.0.0.1"]
    subprocess.run([*make, "-keyout", str(key), "-out", str(certificate)], capture_output=True, check=True)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate, key)
    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=answer_everyone, args=(server, context), daemon=True)
        thread.start()
        yield server.getsockname()[1]
        server.shutdown(socket.SHUT_RDWR)
        thread.join()


def answer_everyone(server: socket.socket, context: ssl.SSLContext) -> None:
    with suppress(OSError):
        while True:
            connection, _ = server.accept()
            with suppress(OSError), context.wrap_socket(connection, server_side=True):
                pass


def kill_in_the_middle(checkout: Path, environment: dict[str, str]) -> None:
    shutil.rmtree(checkout / ".venv")
    with subprocess.Popen(
        [checkout / "provision"], env=environment, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if line.startswith("[3/4]"):
                os.killpg(process.pid, signal.SIGKILL)
    assert not (checkout / ".venv" / "run.stamp").exists()


def test_concurrent_first_starts_install_once(tmp_path: Path, offline: dict[str, str]) -> None:
    checkout = small_checkout(tmp_path / "checkout")
    both = [
        subprocess.Popen(
            [checkout / "provision"], env=offline, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        for _ in range(2)
    ]
    said = [process.communicate() for process in both]
    assert [process.returncode for process in both] == [7, 7]
    assert sorted("waiting" in err for _, err in said) == [False, True]
    assert sum("[4/4]" in err for _, err in said) == 1


def test_interrupted_first_start_is_repaired_by_the_next_start(tmp_path: Path, offline: dict[str, str]) -> None:
    """With the real `venv`, which is long enough in work to be stopped in it."""
    checkout = small_checkout(tmp_path / "checkout")
    slow = {name: value for name, value in offline.items() if name != "ATLANTIS_PYTHON"}
    with subprocess.Popen(
        [checkout / "provision"],
        env=slow,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # Tests that a shell runs in the background hand on that Ctrl+C is ignored.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509 - no thread of ours forks here
    ) as process:
        assert process.stderr is not None
        said = ""
        for line in process.stderr:
            said += line
            if line.startswith("[2/4]"):
                os.killpg(process.pid, signal.SIGINT)
    assert process.returncode == 4
    assert "the next start goes on" in said
    told(start(checkout, environment=offline))


def test_ordinary_user_can_set_up_and_use_it(tmp_path: Path, wheels: Path, offline: dict[str, str]) -> None:
    let_others_pass(tmp_path / "below")
    let_others_pass(wheels / "below")
    checkout = small_checkout(tmp_path / "checkout")
    if as_nobody():
        for path in (checkout, *checkout.rglob("*")):
            os.chown(path, NOBODY, NOBODY)
    first = start(checkout, "x", prefix=as_nobody(), environment=offline)
    assert told(first)["argv"] == ["x"]
    assert (checkout / ".venv").stat().st_uid == (NOBODY if as_nobody() else os.geteuid())
    assert start(checkout, prefix=as_nobody(), environment=offline).stderr == ""


def test_checkout_of_another_user_is_usable_but_not_set_up(tmp_path: Path, offline: dict[str, str]) -> None:
    let_others_pass(tmp_path / "below")
    checkout = small_checkout(tmp_path / "checkout")
    checkout.chmod(0o555)
    refused = start(checkout, prefix=as_nobody(), environment=offline)
    checkout.chmod(0o755)
    assert (refused.returncode, refused.stdout) == (3, "")
    assert "a clone of your own" in refused.stderr
    told(start(checkout, environment=offline))
    theirs = start(checkout, prefix=as_nobody(), environment=offline)
    assert (told(theirs)["argv"], theirs.stderr) == ([], "")
