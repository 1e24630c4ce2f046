r"""The text console of a RouterOS device, over SSH or a serial line, files onto it by SFTP, and commands on others.

The host key is compared before a password is sent; what is typed is in no log and no exception.
Values for the command line are quoted by `routeros.rsc.quote`: outside quotes `$` and `\` are syntax errors.
"""
