# 2026-03-02 09:14:07 by RouterOS 7.18.2
/interface list
add comment="towards the world" name=WAN
/ip firewall nat
add action=masquerade chain=srcnat comment="two lines\r\
    \nin one comment" out-interface="wan A"
# pppoe-out1 not ready
add action=masquerade chain=srcnat out-interface=pppoe-out1
/ip firewall service-port
# error exporting /ip/firewall/calea (timeout)
set tftp disabled=yes
