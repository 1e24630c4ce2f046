/interface list
add name=WAN comment="to the world
add name=LAN
