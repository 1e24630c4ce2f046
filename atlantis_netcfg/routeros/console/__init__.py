r"""The text console of a RouterOS device (SSH or serial line), file upload by SFTP, and commands on other hosts.

The host key is checked before a password is sent; typed text appears in no log and no exception.

Values for the command line are quoted by `routeros.rsc.quote`: outside quotes `$` and `\` are syntax errors.
"""
