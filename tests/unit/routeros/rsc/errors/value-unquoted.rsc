/interface list
add comment=towards the world name=WAN
