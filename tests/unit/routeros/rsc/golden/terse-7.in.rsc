# 2026-03-02 09:14:07 by RouterOS 7.18.2
/interface list add comment="towards the world" name=WAN
/ip firewall nat add action=masquerade chain=srcnat comment="two lines\r\
    \nin one comment" out-interface="wan A"/ip firewall nat
# pppoe-out1 not ready
add action=masquerade chain=srcnat out-interface=pppoe-out1
#error exporting /ip/firewall/calea (timeout)
/ip firewall service-port set tftp disabled=yes
