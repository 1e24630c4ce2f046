/interface list
add name=WAN # the world
