"""Computers in a run, gateways and the VPN's server: ordinary Ansible roles work, and this is what stands around them.

Before the roles `wanted` tells each of them what its hosts should hold, as data made by pure functions. While they run
a `Watch` in Ansible's main process holds the site's lock, writes its journal, and puts every task's result into words.
"""
