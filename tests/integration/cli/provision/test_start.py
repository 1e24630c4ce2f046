"""What a run that changes nothing, and the emulated routers, do not import: their start is most of what they cost."""

import subprocess
import sys
from pathlib import Path

import pytest
from quay import ROUTER, quay

pytestmark = [pytest.mark.slow, pytest.mark.namespace]

PROGRAM = """
import sys
from atlantis_netcfg.cli import main
code = main()
print(*sys.modules, file=sys.stderr)
sys.exit(code)
"""
UNUSED = {
    *(
        *("asyncssh", "fpdf", "jeepney", "netmiko", "paramiko", "pymavlink", "pyrage", "pytest", "rich"),
        *("serial", "unittest"),
    ),
    *(f"ansible.plugins.{name}" for name in ("become.su", "connection.paramiko_ssh", "connection.winrm")),
    "atlantis_netcfg.computers.bundle",
    "atlantis_netcfg.checklist",
    "atlantis_netcfg.routeros.console",
    "atlantis_netcfg.computers.dds",
    "atlantis_netcfg.routeros.first_contact",
    "atlantis_netcfg.computers",
    "atlantis_netcfg.computers.image",
    "atlantis_netcfg.emulator.lab",
    "atlantis_netcfg.operations.common.rehearsal",
    "atlantis_netcfg.routeros.packages",
    "atlantis_netcfg.checklist.probes",
    "atlantis_netcfg.emulator.routeros.router",
    "atlantis_netcfg.vpn",
}


@pytest.mark.parametrize("how", [("--yes",), ("plan",)], ids=" ".join)
def test_unchanged_run_imports_no_unused_modules(how: tuple[str, ...], tmp_path: Path) -> None:
    with quay(tmp_path) as at:
        at.adopt()
        at.configure()
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM, *how, "site=coastal", f"device={ROUTER}", f"inventory={at.inventory}"],
            env=at.environment(),
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
        )
    assert done.returncode == 0, done.stdout + done.stderr
    imported = set(done.stderr.splitlines()[-1].split())
    assert {"ansible", "atlantis_netcfg.routeros.apply"} <= imported
    assert imported & UNUSED == set()


def test_emulated_routers_import_nothing_of_the_engine() -> None:
    """A rehearsal waits for their process."""
    program = "import sys, atlantis_netcfg.emulator.routeros.__main__; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-P", "-c", program], capture_output=True, text=True, check=True)
    imported = set(done.stdout.split())
    assert {"atlantis_netcfg.emulator.routeros.router", "atlantis_netcfg.routeros.menus"} <= imported
    engine = {"atlantis_netcfg.routeros.apply", "atlantis_netcfg.routeros.fleet", "atlantis_netcfg.runs"}
    assert imported & engine == set()
