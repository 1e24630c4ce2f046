"""What an emulated router does with packets: ports and addresses, routes, firewall, netwatch."""
