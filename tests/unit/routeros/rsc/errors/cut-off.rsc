/interface list
add comment="the file ends in mid-air" \
