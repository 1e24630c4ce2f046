"""Machines on which the Python that ./provision needs is missing or incomplete, as fresh Debian and Ubuntu are."""

import os
import subprocess
import sysconfig
from pathlib import Path

import pytest
from house_checkout import as_nobody, clean_environment, let_others_pass, start
from house_small import folder_of_wheels, quick_python, small_checkout

pytestmark = pytest.mark.slow

APT_GET = "env DEBIAN_FRONTEND=noninteractive apt-get -o DPkg::Lock::Timeout=120"
NEEDED = f"{APT_GET} install -y --no-install-recommends python3-venv"


class Machine:
    """A machine of which apt-get, sudo and Python are stand-ins; `said` is what was asked of apt-get and sudo."""

    def __init__(self, base: Path) -> None:
        self.base = base
        self.programs = base / "programs"
        self.programs.mkdir()
        self.said = base / "said"
        self.said.write_text("")
        self.said.chmod(0o666)
        self.wheels = folder_of_wheels(base / "wheels")
        self.checkout = small_checkout(base / "checkout")
        let_others_pass(base / "below")

    def program(self, name: str, script: str) -> Path:
        path = self.programs / name
        path.write_text(f"#!/bin/sh\n{script}\n")
        path.chmod(0o755)
        return path

    def apt_get(self, script: str) -> None:
        self.program("apt-get", f'echo "apt-get $*" >>"{self.said}"\n{script}')

    def python_without_venv(self) -> Path:
        """A Python that lacks its package until the file `installed` exists."""
        real = quick_python(self.base, has_pip=False)
        lacking = (
            f'[ -e "{self.base}/installed" ] || case "$*" in *can_make_venv*) echo "no python3-venv"; exit ;; esac'
        )
        return self.program("incomplete-python", f'{lacking}\nexec {real} "$@"')

    def environment(self, python: Path | str) -> dict[str, str]:
        path = f"{self.programs}:/usr/bin:/bin"
        return clean_environment(
            PATH=path, ATLANTIS_PYTHON=str(python), PIP_NO_INDEX="1", PIP_FIND_LINKS=str(self.wheels)
        )

    def start(self, python: Path | str, *, prefix: list[str] | None = None) -> subprocess.CompletedProcess[str]:
        return start(self.checkout, prefix=prefix or [], environment=self.environment(python))


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    return Machine(tmp_path)


def test_root_or_sudo_installs_the_package(machine: Machine) -> None:
    python = machine.python_without_venv()
    machine.apt_get(f'case "$*" in *install*) touch "{machine.base}/installed" ;; esac')
    machine.program("sudo", f'echo "sudo $*" >>"{machine.said}"\nshift\nexec "$@"')
    started = machine.start(python)
    assert started.returncode == 7, started.stderr
    assert "by apt-get: python3-venv" in started.stderr
    assert "install -y --no-install-recommends python3-venv" in machine.said.read_text()


def test_an_ordinary_user_goes_through_sudo(machine: Machine) -> None:
    python = machine.python_without_venv()
    machine.checkout.chmod(0o777)
    machine.base.chmod(0o777)
    machine.apt_get(f'touch "{machine.base}/installed"')
    machine.program("sudo", f'echo "sudo $*" >>"{machine.said}"\nshift\nexec "$@"')
    started = machine.start(python, prefix=as_nobody())
    assert started.returncode == 7, started.stderr
    asked = machine.said.read_text().splitlines()
    assert asked[:2] == ["sudo -n true", f"sudo -n {NEEDED}"]


def test_outdated_package_list_is_updated(machine: Machine) -> None:
    python = machine.python_without_venv()
    machine.apt_get(
        f'case "$*" in *update*) touch "{machine.base}/updated" ;; '
        f'*) [ -e "{machine.base}/updated" ] && touch "{machine.base}/installed" ;; esac'
    )
    machine.program("sudo", 'shift\nexec "$@"')
    assert machine.start(python).returncode == 7
    assert [line.split()[3] for line in machine.said.read_text().splitlines()] == ["install", "update", "install"]


@pytest.mark.parametrize("sudo", [None, "exit 1"], ids=["no sudo", "sudo wants a password"])
def test_without_install_rights_the_needed_command_is_shown(sudo: str | None, machine: Machine) -> None:
    python = machine.python_without_venv()
    machine.checkout.chmod(0o777)
    machine.apt_get("exit 1")
    machine.program("sudo", sudo if sudo is not None else "exit 127")
    started = machine.start(python, prefix=as_nobody())
    assert (started.returncode, started.stdout) == (3, "")
    assert "type: sudo apt-get install -y python3-venv" in started.stderr
    assert "installing" not in started.stderr
    assert not (machine.checkout / ".venv").exists()


def test_failed_apt_shows_the_needed_command(machine: Machine) -> None:
    machine.apt_get("echo 'E: Unable to locate package'; exit 100")
    machine.program("sudo", 'shift\nexec "$@"')
    started = machine.start(machine.python_without_venv())
    assert started.returncode == 3
    assert "type: sudo apt-get install -y python3-venv" in started.stderr
    assert "Unable to locate" in (machine.checkout / ".venv-setup" / "log").read_text()


@pytest.mark.parametrize("python", ["exit 0", "exit 2"], ids=["too old", "does not run"])
def test_unsuitable_python_is_refused(python: str, machine: Machine) -> None:
    machine.apt_get("exit 1")
    machine.program("sudo", "exit 1")
    started = machine.start(machine.program("old-python", python))
    assert started.returncode == 3
    assert "Python 3.11 or newer is needed" in started.stderr


def test_start_succeeds_after_an_earlier_failure(machine: Machine) -> None:
    machine.apt_get("exit 1")
    machine.program("sudo", "exit 1")
    python = machine.python_without_venv()
    assert machine.start(python).returncode == 3
    (machine.base / "installed").touch()
    assert machine.start(python).returncode == 7
    assert machine.start(python).stderr == ""


@pytest.mark.skipif(os.geteuid() != 0, reason="hiding python3-venv takes root")
def test_debian_python_without_venv_package_gets_it(machine: Machine) -> None:
    """The real thing: Debian's python3 with the files of python3-venv hidden until apt-get is called."""
    library = Path(sysconfig.get_paths(vars={"base": "/usr"}).get("stdlib", "")).name
    hidden = Path("/usr/lib") / library / "ensurepip"
    if not hidden.is_dir():
        pytest.skip("the distribution's Python is not the one that runs the tests")
    (machine.base / "nothing").mkdir()
    machine.apt_get(f'umount "{hidden}"')
    script = f'mount --bind "{machine.base}/nothing" "{hidden}" && exec "{machine.checkout}/provision"'
    started = subprocess.run(
        ["unshare", "--mount", "sh", "-c", script],
        env=machine.environment("/usr/bin/python3"),
        capture_output=True,
        text=True,
        check=False,
    )
    assert started.returncode == 7, started.stderr
    assert machine.said.read_text().split()[-1] == "python3-venv"
