/interface list
add comment="50\% of it" name=WAN
