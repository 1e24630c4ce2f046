"""Real Debian machines with systemd, for rehearsals and tests of gateway software.

A machine is a systemd-nspawn container on an overlay of a shared, unpacked Debian, in its own network namespace, with
its inventory address. Machines are in an isolated lab network. This computer reaches their sshd through a
loopback port, over an emulated link that can be slow, far and down. Root is required; `why_not` lists what else is
missing, and `NOT_REHEARSED` what a machine cannot emulate.

    with open_lab(folder) as lab:
        root = build_rootfs(TreeSpec())
        gateway = lab.start("coastal-gateway", root, address="10.64.1.10/24", gateway="10.64.1.1", keys=keys)
        gateway.link(delay_s=0.35, rate_up_bps=352_000, rate_down_bps=704_000)
        …  ssh -p gateway.port root@127.0.0.1, whose host key is gateway.host_key
        gateway.power_cut()
"""

from atlantis_netcfg.emulator.lab.hosts import NOT_REHEARSED, Machine, MachineError
from atlantis_netcfg.emulator.lab.lab import (
    OFF,
    Lab,
    missing_packages,
    open_lab,
    provide,
    reserve_name,
    why_no_namespace,
    why_not,
)
from atlantis_netcfg.emulator.lab.relay import RelayTraffic
from atlantis_netcfg.emulator.lab.rootfs import TreeSpec, build_rootfs

__all__ = [
    "NOT_REHEARSED",
    "OFF",
    "Lab",
    "Machine",
    "MachineError",
    "RelayTraffic",
    "TreeSpec",
    "build_rootfs",
    "missing_packages",
    "open_lab",
    "provide",
    "reserve_name",
    "why_no_namespace",
    "why_not",
]
