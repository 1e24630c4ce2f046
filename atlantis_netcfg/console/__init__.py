r"""The text console of a RouterOS device, over SSH or a serial line, files onto it by SFTP, and commands on others.

The host key is compared before a password is sent; what is typed is in no log and no exception.
Values for the command line are quoted by `atlantis_netcfg.rsc.quote`: outside quotes `$` and `\` are syntax errors.
"""

from atlantis_netcfg.console._errors import (
    ConsoleLost,
    ConsoleRefused,
    ConsoleUnreachable,
    HostKeyChanged,
    LoginFailed,
    SafeModeHeld,
    UnknownHostKey,
)
from atlantis_netcfg.console._exec import CommandEnd, Commands, host_key_of, open_commands
from atlantis_netcfg.console._keys import fingerprint
from atlantis_netcfg.console._rows import parse_rows
from atlantis_netcfg.console._serial import open_serial
from atlantis_netcfg.console._sftp import upload
from atlantis_netcfg.console._ssh import open_ssh
from atlantis_netcfg.console._types import COMMAND_S, CONNECT_S, Console

__all__ = [
    "COMMAND_S",
    "CONNECT_S",
    "CommandEnd",
    "Commands",
    "Console",
    "ConsoleLost",
    "ConsoleRefused",
    "ConsoleUnreachable",
    "HostKeyChanged",
    "LoginFailed",
    "SafeModeHeld",
    "UnknownHostKey",
    "fingerprint",
    "host_key_of",
    "open_commands",
    "open_serial",
    "open_ssh",
    "parse_rows",
    "upload",
]
