"""As many processes of Cyclone DDS as are declared find an index on one computer, and no more."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from atlantis_netcfg.computers.dds import profile_views, profiles
from atlantis_netcfg.inventory import load
from atlantis_netcfg.inventory.model import Dds, RosDistribution

pytestmark = [
    pytest.mark.slow,
    pytest.mark.namespace,
    pytest.mark.skipif(os.geteuid() != 0, reason="making a network namespace needs root"),
]

SHIPPED = Path(__file__).parents[4] / "inventory"
PROCESS = """
import sys
from cyclonedds.domain import DomainParticipant
try:
    participant = DomainParticipant(7)
except Exception:
    print("none", flush=True)
else:
    print("found", flush=True)
sys.stdin.read()
"""


def profile(participants: int) -> str:
    """Of the coastal gateway, for the cable of a test."""
    declaration = load(SHIPPED)
    dds = Dds(distribution=RosDistribution.HUMBLE, participants=participants)
    pilot = declaration.pilot.model_copy(update={"dds": dds})
    host = declaration.hosts["coastal-gateway"]
    view = profile_views(replace(declaration, pilot=pilot), host, "pypi")[0]
    (text,) = (text for name, text in profiles(view).items() if name.endswith("cyclonedds.xml"))
    return text.replace(view.address, "127.0.0.1")


@pytest.mark.parametrize("participants", [1, 3])
def test_profile_limits_the_number_of_processes(tmp_path: Path, participants: int) -> None:
    file = tmp_path / "cyclonedds.xml"
    file.write_text(profile(participants), encoding="utf-8")
    words = ["unshare", "--net", "sh", "-c", 'ip link set lo up && exec "$@"', "sh", sys.executable, "-c", START]
    done = subprocess.run(
        [*words, str(participants + 1)],
        env=os.environ | {"CYCLONEDDS_URI": f"file://{file}"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == [*["found"] * participants, "none"]


START = f"""
import subprocess, sys
from contextlib import ExitStack
with ExitStack() as stack:
    for _ in range(int(sys.argv[1])):
        started = subprocess.Popen(
            [sys.executable, "-c", {PROCESS!r}],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        stack.enter_context(started)
        stack.callback(started.stdin.close)
        print(started.stdout.readline().strip(), flush=True)
"""
