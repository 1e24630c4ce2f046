"""Real Debian computers with systemd, for rehearsals and tests of what runs on a gateway computer.

A machine is a container of systemd-nspawn on an overlay of a shared, unpacked Debian, in a network namespace of its
own with its declared address. Machines stand in a yard that leads nowhere; this computer reaches their sshd through a
port of the loopback, over a bearer that can be slow, far and down. It takes root, and `why_not` says what else is
missing; what a machine cannot stand for is `NOT_REHEARSED`.

    with yard(folder) as ground:
        root = tree(TreeSpec())
        gateway = ground.start("coastal-gateway", root, address="10.64.1.10/24", gateway="10.64.1.1", keys=keys)
        gateway.link(delay_s=0.35, rate_up_bps=352_000, rate_down_bps=704_000)
        …  ssh -p gateway.port root@127.0.0.1, whose host key is gateway.host_key
        gateway.power_cut()
"""

from atlantis_netcfg.emulator.lab.hosts import NOT_REHEARSED, Machine, MachineError
from atlantis_netcfg.emulator.lab.lab import OFF, Lab, missing_packages, open_lab, provide, why_not
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
    "why_not",
]
