"""Computers in a run (gateways, VPN server): data and supervision for ordinary Ansible roles.

Before the roles, `desired_state` gives each of them the desired state of its hosts, as data from pure functions. While
they run, a `Watch` in Ansible's main process holds the site's lock, writes its journal, and turns every task's result
into text.
"""
