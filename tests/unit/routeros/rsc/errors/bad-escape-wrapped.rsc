/interface list
add comment=\
    "this line is wrapped, and the escape that is wrong stands in its \
    continuation: \q" name=WAN
