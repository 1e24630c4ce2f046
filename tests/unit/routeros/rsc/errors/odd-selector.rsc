/interface list member
set [ find interface~"^ether" ] list=LAN
