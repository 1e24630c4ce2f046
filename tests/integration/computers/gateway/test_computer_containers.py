"""Containers on a real Debian with its real podman: loaded from the pinned archive alone, bounded, seen, taken away.

The images are stand-ins made here from the machine's own Python; no registry is contacted, and none could be.
"""

import hashlib
from pathlib import Path
from typing import Any

import pytest
from debian_trees import CONTAINERS
from gateway_role import Stand
from gateway_stand import FREE_CLOCK, ROUTER, Key, ground, technician  # noqa: F401 - fixtures

from atlantis_netcfg.computers.containers import IMAGES
from atlantis_netcfg.emulator.lab import Lab, Machine, build_rootfs
from atlantis_netcfg.emulator.lab.stubs import PODMAN_IN_A_MACHINE, service_image

pytestmark = [pytest.mark.slow, pytest.mark.namespace]
UNIT = "atlantis-service-backend.service"
FOLDER = "/etc/atlantis/containers"


def with_podman() -> Path:
    """The tree of the other tests, and podman."""
    return build_rootfs(CONTAINERS)


def archive(port: int) -> tuple[bytes, str]:
    made = service_image(with_podman(), "tcp", port)
    return made, hashlib.sha256(made).hexdigest()


@pytest.fixture
def stand(ground: Lab, technician: Key, tmp_path: Path) -> Stand:  # noqa: F811 - fixtures
    words: dict[str, Any] = {"keys": (technician.public,), "gateway": ROUTER, "address": "10.64.1.10/24"}
    gateway = ground.start("coastal-gateway", with_podman(), **words)
    for path, text in PODMAN_IN_A_MACHINE.items():
        gateway.put(path, text)
    gateway.put("/etc/systemd/system/chrony.service.d/rehearsal.conf", FREE_CLOCK)
    gateway.run("systemctl daemon-reload")
    made = Stand(gateway, technician, tmp_path / "stand", ["gateway_base"])
    # Without ROS 2, which the gateway of the shipped inventory has on Ubuntu 20.04.
    made.declare({"gateways": {}})
    return made


def declare(stand: Stand, sha256: str | None, **changes: Any) -> None:  # noqa: ANN401 - keys of the declaration
    container = {"archive": "backend.tar", "sha256": sha256, "budget_mb": 2, "memory_mb": 256, **changes}
    backend = {"name": "backend", "port": 18082, "open_to": ["lan"], "container": container}
    services = [] if sha256 is None else [backend]
    stand.declare({"services": services}, "host_vars/coastal-gateway.yml", "device")


def inside(gateway: Machine) -> str:
    """The process of the container, as the computer counts."""
    return gateway.run("podman inspect --format '{{.State.Pid}}' atlantis-service-backend").stdout.strip()


def test_container_runs_from_the_pinned_archive_and_is_removed_cleanly(stand: Stand) -> None:
    gateway = stand.gateway
    image, sha256 = archive(18082)
    gateway.put_bytes(f"{IMAGES}/{sha256}.tar", image)
    variables = [{"name": "MODE", "value": "quay"}, {"name": "PASSWORD", "secret": "EXAMPLE-word of two"}]
    declare(stand, sha256, environment=variables)
    told = stand.run()
    assert (told["status"], told["exit"]) == ("changed", 0), told["message"]
    assert "EXAMPLE-word of two" not in (stand.folder / "said").read_text()
    assert stand.run()["changes"] == [], "nothing is left"

    process = inside(gateway)
    group = gateway.run(f"cat /proc/{process}/cgroup").stdout
    assert f"/{UNIT}" in group, "the unit's bounds are the container's"
    assert gateway.run(f"systemctl show --property MemoryMax --value {UNIT}").stdout.strip() == str(256 * 1024 * 1024)
    account = gateway.run("id -u svc-backend").stdout.strip()
    status = gateway.run(f"cat /proc/{process}/status").stdout
    for line in (f"Uid:\t{account}\t{account}\t{account}", "CapEff:\t0000000000000000", "NoNewPrivs:\t1"):
        assert line in status
    mounts = gateway.run(f"cat /proc/{process}/mounts").stdout.splitlines()
    root, data = (next(line.split() for line in mounts if line.split()[1] == place) for place in ("/", "/data"))
    assert root[3].split(",")[0] == "ro"
    assert data[3].split(",")[0] == "rw"
    environment = gateway.run(f"tr '\\0' '\\n' < /proc/{process}/environ").stdout.splitlines()
    assert {"MODE=quay", "PASSWORD=EXAMPLE-word of two"} <= set(environment)
    assert gateway.run(f"stat -c '%a %U' {FOLDER}/atlantis-service-backend.env").stdout.strip() == "600 root"
    assert "EXAMPLE-word" not in gateway.run("ps -eo args").stdout
    assert gateway.run("systemctl is-enabled podman.socket", check=False).stdout.strip() == "disabled"
    assert "stand-in" in gateway.run("timeout 2 bash -c 'cat < /dev/tcp/10.64.1.10/18082'").stdout

    declare(stand, None)
    assert stand.run()["exit"] == 0
    for look in ("podman ps --all --quiet", "podman images --all --quiet", f"ls {FOLDER}"):
        assert gateway.run(look, check=False).stdout.strip() == "", look
    assert stand.run()["changes"] == []


def test_container_archive_with_another_hash_is_not_loaded(stand: Stand) -> None:
    gateway = stand.gateway
    (image, sha256), (other, _) = archive(18082), archive(18083)
    gateway.put_bytes(f"{IMAGES}/{sha256}.tar", other)
    declare(stand, sha256)
    told = stand.run()
    assert told["exit"] == 6, told["message"]
    assert "the service `backend` does not run from the image of the inventory" in told["message"]
    assert any("is not the declared archive: its SHA-256 is another one" in note for note in told["notes"])
    assert gateway.run("podman images --quiet").stdout.strip() == ""
    gateway.put_bytes(f"{IMAGES}/{sha256}.tar", image)
    gateway.run(f"systemctl restart {UNIT}")
    told = stand.run()
    assert (told["exit"], told["changes"]) == (0, []), "brought, it starts by itself"


def test_drift_of_image_and_folder_is_reported(stand: Stand) -> None:
    gateway = stand.gateway
    (image, sha256), (other, newer) = archive(18082), archive(18083)
    gateway.put_bytes(f"{IMAGES}/{sha256}.tar", image)
    gateway.put_bytes(f"{IMAGES}/{newer}.tar", other)
    declare(stand, sha256)
    assert stand.run()["exit"] == 0
    gateway.run("dd if=/dev/zero of=/var/lib/svc-backend/large bs=1M count=4")
    name = f"localhost/atlantis/atlantis-service-backend:{sha256}"
    gateway.run(f"podman load --input {IMAGES}/{newer}.tar && podman tag example.org/stand-in:rehearsal {name}")
    told = stand.run()
    assert told["exit"] == 6
    assert "the service `backend` does not run from the image of the inventory" in told["message"]
    assert "the service `backend` uses more than 2 MB in /var/lib/svc-backend" in told["message"]
    gateway.run("rm /var/lib/svc-backend/large")
    gateway.run(f"systemctl restart {UNIT}")
    assert stand.run()["exit"] == 0, "a start loads the declared image anew"
    # A container that is over, and is still there, uses the older image.
    gateway.run(f"systemctl stop {UNIT} && podman create --name atlantis-service-backend {name}")
    declare(stand, newer)
    told = stand.run()
    assert "does not listen on tcp port 18082" in told["message"], "the newer image listens elsewhere"
    images = gateway.run("podman images --format '{{.Repository}}:{{.Tag}}' localhost/atlantis/*").stdout.split()
    assert images == [f"localhost/atlantis/atlantis-service-backend:{newer}"], "the older image is removed"
