"""What is run on the computer after its files are in place, in its own shell."""

from __future__ import annotations

from atlantis_netcfg.gateway.parts import Check, Step

__all__ = [
    "ACCEPT_CHRONY",
    "CHECKS",
    "CLOUD_INIT",
    "CLOUD_INIT_ON",
    "HOSTNAME",
    "LOCALES",
    "SSHD",
    "STEPS",
    "SYSCTL",
    "WATCHDOG",
]

CLOUD_INIT = "/etc/cloud/cloud-init.disabled"
"""Where it stands, cloud-init does nothing at a start, unless the file below or the kernel says otherwise."""
CLOUD_INIT_ON = "/etc/cloud/cloud-init.enabled"
HOSTNAME = "/etc/hostname"
LOCALES = "/etc/locale.gen"
SSHD = "/etc/ssh/sshd_config.d/00-atlantis.conf"
SYSCTL = "/etc/sysctl.d/60-atlantis.conf"
WATCHDOG = "/etc/systemd/system.conf.d/atlantis-watchdog.conf"

ACCEPT_CHRONY = (
    "sh",
    "-c",
    'case "$(chronyd -v 2>&1)" in *"version 3"*|*"not found"*) ;; *) exec chronyd -p -f "$1" ;; esac',
    "sh",
    "%s",
)
"""chrony 3.5 of Ubuntu 20.04 cannot check a file; 4.0 and later can."""

_SET_KERNEL = f"""\
while read -r key equals value; do
    case "$key" in ''|'#'*) continue ;; esac
    place="/proc/sys/$(printf %s "$key" | tr . /)"
    printf %s "$value" > "$place" 2>/dev/null || echo "note: this kernel does not let $key be set to $value"
done < {SYSCTL}
"""
_OBEYS = f"""\
told="$(sshd -T -C user=root,host=localhost,addr=127.0.0.1,laddr=127.0.0.1,lport=22)" || exit 1
case "$told" in *"passwordauthentication no"*) exit 0 ;; esac
echo "sshd does not read {SSHD}: begin /etc/ssh/sshd_config with the line"
echo "Include /etc/ssh/sshd_config.d/*.conf"
exit 1
"""
_WATCHED = f"""\
systemctl daemon-reexec || exit 1
if [ -e {WATCHDOG} ] && ! [ -e /dev/watchdog0 ] && ! [ -e /dev/watchdog ]; then
    echo "this board shows no watchdog (/dev/watchdog0): load its driver, or take watchdog_s out of the declaration"
    exit 1
fi
"""

STEPS = (
    Step("generate the locale", ("locale-gen",), (LOCALES,)),
    Step("set the host name", ("hostname", "-F", HOSTNAME), (HOSTNAME,)),
    Step("set values of the kernel", ("sh", "-c", _SET_KERNEL), (SYSCTL,)),
    Step("see that sshd reads its new file", ("sh", "-c", _OBEYS), (SSHD, "/etc/ssh/sshd_config")),
    Step("set the watchdog", ("sh", "-c", _WATCHED), (WATCHDOG,)),
)

CHECKS = (
    Check(
        ("sh", "-c", "! command -v cloud-init >/dev/null || ! grep -qw cloud-init=enabled /proc/cmdline"),
        "cloud-init is switched on by the kernel's command line, and writes name, address and accounts anew",
        "on the computer: take `cloud-init=enabled` out of what its boot loader tells the kernel, then `sudo reboot`",
    ),
)
