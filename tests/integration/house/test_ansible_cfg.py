"""Plain Ansible works from the checkout: ansible.cfg is valid, and holds what it promises."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from house_checkout import ROOT

pytestmark = pytest.mark.slow


def ansible(program: str, *arguments: str, home: Path) -> subprocess.CompletedProcess[str]:
    environment = {name: value for name, value in os.environ.items() if not name.startswith("ANSIBLE_")}
    return subprocess.run(
        [str(Path(sys.executable).parent / program), *arguments],
        cwd=ROOT,
        env=environment | {"HOME": str(home), "ANSIBLE_HOME": str(home), "NO_COLOR": "1", "LC_ALL": "C.UTF-8"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )


def test_every_setting_is_known(tmp_path: Path) -> None:
    process = ansible("ansible-config", "validate", "-t", "all", home=tmp_path)
    assert (process.returncode, process.stderr) == (0, "")


def test_the_inventory_is_read_without_a_warning(tmp_path: Path) -> None:
    process = ansible("ansible-inventory", "--list", home=tmp_path)
    assert (process.returncode, process.stderr) == (0, "")
    assert {"scc", "coastal", "te4sea"} <= json.loads(process.stdout).keys()


def test_playbooks_pass_the_syntax_check(tmp_path: Path) -> None:
    playbooks = [str(path.relative_to(ROOT)) for path in sorted((ROOT / "playbooks").glob("*.yml"))]
    process = ansible("ansible-playbook", "--syntax-check", *playbooks, home=tmp_path)
    assert (process.returncode, process.stderr) == (0, "")


@pytest.mark.parametrize("text", ["all: [", "{{{"])
def test_unreadable_inventory_file_stops_ansible(text: str, tmp_path: Path) -> None:
    (tmp_path / "hosts.yml").write_text(text)
    process = ansible("ansible-inventory", "-i", str(tmp_path / "hosts.yml"), "--list", home=tmp_path)
    assert process.returncode != 0
    assert "hosts.yml" in process.stderr


@pytest.mark.parametrize(
    ("variable", "host"),
    [
        ("ansible_host", "coastal-router"),
        ("ansible_user", "coastal-gateway"),
        ("ansible_ssh_common_args", "coastal-gateway"),
        ("ansible_connection", "coastal-router"),
    ],
)
def test_template_in_a_connection_variable_is_refused_unevaluated(variable: str, host: str, tmp_path: Path) -> None:
    """Ansible evaluates these ahead of a task's action; a program that they name would run on this computer."""
    inventory, ran = tmp_path / "inventory", tmp_path / "ran"
    shutil.copytree(ROOT / "inventory", inventory)
    vars_file = inventory / "host_vars" / f"{host}.yml"
    before = len(vars_file.read_text().splitlines())
    with vars_file.open("a") as file:
        file.write(f"{variable}: \"{{{{ lookup('ansible.builtin.pipe', 'touch {ran}') }}}}\"\n")
    words = ["-i", str(inventory), "playbooks/site.yml", "--check", "--limit", host]
    process = ansible("ansible-playbook", *words, home=tmp_path)
    assert process.returncode != 0
    assert f"host_vars/{host}.yml:{before + 1}:" in process.stderr, process.stdout + process.stderr
    assert "TASK" not in process.stdout
    assert not ran.exists()


@pytest.mark.parametrize(("findings", "code"), [([], 0), (["no firewall", "no bound"], 2)])
def test_plain_ansible_fails_if_there_is_a_finding(findings: list[str], code: int, tmp_path: Path) -> None:
    """The roles go on to their end; then the last task tells, and fails."""
    task = yaml.safe_load((ROOT / "playbooks" / "computers" / "computer.yml").read_text())[-1]
    roles = {
        name: (ROOT / "roles" / name / "tasks" / "main.yml").read_text() for name in ("gateway_base", "gateway_interop")
    }
    assert all(f"register: {name}_result" in text for name, text in roles.items())
    known = {
        "gateway_base_result": {"findings": findings[:1]},
        "gateway_interop_result": {"findings": findings[1:]},
    }
    play = {"hosts": "localhost", "connection": "local", "gather_facts": False, "tasks": [task]}
    (tmp_path / "play.yml").write_text(yaml.safe_dump([{**play, "vars": known if findings else {}}]))
    process = ansible("ansible-playbook", "-i", "localhost,", str(tmp_path / "play.yml"), home=tmp_path)
    assert process.returncode == code, process.stdout + process.stderr
    assert ("no firewall; no bound" in process.stdout + process.stderr) is bool(findings)


def test_the_playbook_of_docs_roles_runs_from_another_folder(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "engineers" / "roles.md").read_text(encoding="utf-8")
    playbook = tmp_path / "mine.yml"
    playbook.write_text(page.partition("```yaml\n")[2].partition("```")[0], encoding="utf-8")
    words = [str(Path(sys.executable).parent / "ansible-playbook"), "-i", str(ROOT / "inventory"), str(playbook)]
    kept = {name: value for name, value in os.environ.items() if not name.startswith("ANSIBLE_")}
    told = {
        "ANSIBLE_CONFIG": str(ROOT / "ansible.cfg"),
        "ANSIBLE_HOME": str(tmp_path),
        "ATLANTIS_STATE": str(tmp_path / "state"),
    }
    done = subprocess.run(
        [*words, "-e", "atlantis_rehearse=true"],
        cwd=tmp_path,
        env=kept | told | {"HOME": str(tmp_path), "NO_COLOR": "1", "LC_ALL": "C.UTF-8"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "coastal-router: changed" in done.stdout
