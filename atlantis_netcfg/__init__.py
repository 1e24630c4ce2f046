"""Provision and verify the network of a maritime-robotics test site from one inventory.

Planners without side effects compare the inventory with the state read from the devices. One executor applies the
difference under each device's own rollback protection and reports what it read back. Data flows one way: `inventory` ->
capability package (`routeros`, `links`, `computers`) -> `runs`, events.
"""

__version__ = "1.0.0"
