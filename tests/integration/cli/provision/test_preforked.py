"""What is typed into a process that has already imported prints and ends as the program does."""

import os
import shlex
import socket
import subprocess
import sys
from pathlib import Path

import preforked
import pytest
from quay import PROVISION

LINES = (
    ("help", "version"),
    ("help", "version", "--json"),
    ("help", "links"),
    ("inventory", "validate"),
    ("report", "runs", "site=coastal"),
    ("plan", "site=costal"),
    ("site=coastal", "--nonsense"),
)


@pytest.mark.smoke("help-version", "plan-site=costal")
@pytest.mark.parametrize("words", LINES, ids="-".join)
def test_output_and_exit_code_equal_those_of_the_program(words: tuple[str, ...], tmp_path: Path) -> None:
    environment = {**os.environ, "ATLANTIS_STATE": str(tmp_path)}
    program = subprocess.run([PROVISION, *words], env=environment, capture_output=True, text=True, check=False)
    child = preforked.run(words, env=environment)
    assert (child.returncode, child.stdout, child.stderr) == (program.returncode, program.stdout, program.stderr)


def test_it_uses_the_working_directory_and_environment_of_the_caller(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "here").mkdir()
    environment = {**os.environ, "ATLANTIS_STATE": str(tmp_path)}
    program = subprocess.run(
        [PROVISION, "inventory", "validate", "inventory=here"],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    child = preforked.run(("inventory", "validate", "inventory=here"), env=environment)
    assert (child.returncode, child.stderr) == (program.returncode, program.stderr)
    assert "does not exist" not in child.stderr


def test_it_reads_passed_file_descriptors(tmp_path: Path) -> None:
    reading, writing = os.pipe()
    with os.fdopen(writing, "wb") as pipe:
        pipe.write(b"mackerel lantern orbit velvet\n")
    try:
        words = ("vpn", "init", "sealed=vault", f"authority={tmp_path / 'authority'}", f"--passphrase-fd={reading}")
        done = preforked.run(words, env={**os.environ, "ATLANTIS_STATE": str(tmp_path)}, pass_fds=[reading])
    finally:
        os.close(reading)
    assert done.returncode == 0, done.stderr
    assert list(tmp_path.rglob("ca.crt")) != []


def test_stderr_can_be_merged_into_stdout(tmp_path: Path) -> None:
    environment = {**os.environ, "ATLANTIS_STATE": str(tmp_path)}
    done = preforked.run(("plan", "site=costal"), env=environment, stderr=subprocess.STDOUT)
    assert "did you mean `coastal`?" in done.stdout


def test_consecutive_commands_do_not_affect_each_other(tmp_path: Path) -> None:
    """Nothing of a command is left for the next one: each is forked from the process that has only imported."""
    first, second = (
        preforked.run(("help", "version", *more), env={**os.environ, "ATLANTIS_STATE": str(tmp_path)})
        for more in (("--json",), ())
    )
    assert first.stdout.startswith("{")
    assert second.stdout.startswith("provision ")


ANSIBLE_CFG = Path(__file__).parents[4] / "ansible.cfg"
PLAY = """\
- hosts: all
  gather_facts: false
  tasks:
    - ansible.builtin.command: sh -c 'echo $PPID | grep -c .; pwd; readlink /proc/self/ns/net'
      register: shown
    - ansible.builtin.debug: {var: shown.stdout}
    - ansible.builtin.fail: {msg: "{{ lookup('config', 'ANSIBLE_HOME') }} {{ lookup('env', 'OWN') }}"}
"""
ANSIBLE_LINES = (
    ("ansible-playbook", ("-i", "localhost,", "-c", "local", "play.yml")),
    ("ansible-playbook", ("-i", "localhost,", "missing.yml")),
    ("ansible-playbook", ("--nonsense",)),
    ("ansible", ("-i", "localhost,", "-c", "local", "localhost", "-m", "ansible.builtin.debug", "-a", "msg=here")),
)


@pytest.mark.smoke("ansible-playbook-words0")
@pytest.mark.parametrize(("name", "words"), ANSIBLE_LINES)
def test_ansible_output_and_exit_code_equal_those_of_the_program(
    name: str, words: tuple[str, ...], tmp_path: Path
) -> None:
    (tmp_path / "play.yml").write_text(PLAY)
    home = tmp_path / "home"
    environment = os.environ | {"ANSIBLE_CONFIG": str(ANSIBLE_CFG), "ANSIBLE_HOME": str(home), "OWN": "word"}
    path = str(Path(PROVISION).with_name(name))
    program = subprocess.run([path, *words], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    with (tmp_path / "output").open("w") as output, (tmp_path / "errors").open("w") as errors:
        process = preforked.ansible(
            path, words, env=environment, folder=tmp_path, output=output.fileno(), errors=errors.fileno()
        )
        code = process.wait()
    assert (tmp_path / "output").read_text() == program.stdout
    assert (tmp_path / "errors").read_text() == program.stderr
    assert code == program.returncode
    assert [*home.rglob("ansible-local-*")] == []


def test_shell_client_passes_its_open_file_descriptors(tmp_path: Path) -> None:
    server = preforked.server(sys.executable).fileno()
    authority = ("vpn", "init", "sealed=vault", "authority=here", "--passphrase-fd=3")
    line = f"{shlex.join([*preforked.client(server), *authority])} 3<<<'mackerel lantern orbit velvet'"
    line = f"{line}; exec {shlex.join([*preforked.client(server), 'plan', 'site=costal'])}"
    done = subprocess.run(
        ["bash", "-c", line],
        cwd=tmp_path,
        env={**os.environ, "ATLANTIS_STATE": str(tmp_path)},
        pass_fds=[server],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 7
    assert "did you mean `coastal`?" in done.stderr
    assert [*(tmp_path / "here").rglob("ca.crt")] != []


@pytest.mark.smoke("6")
@pytest.mark.parametrize("code", [0, 6, -9])
def test_client_exits_with_the_code_of_the_child(code: int) -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours, theirs, subprocess.Popen(preforked.client(theirs.fileno()), pass_fds=[theirs.fileno()]) as typed:
        _, descriptors, *_ = socket.recv_fds(ours, 1, 64)
        with socket.socket(fileno=descriptors[0]) as answer:
            answer.sendall(str(code).encode())
        for descriptor in descriptors[1:]:
            os.close(descriptor)
    assert typed.returncode == code
