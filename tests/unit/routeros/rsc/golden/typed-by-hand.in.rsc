
# rows as people type them

/ip/firewall/filter/add chain=input action=accept comment=single
/ip firewall filter add chain=input src-address=192.168.88.0/24 \
   comment="the indent \
            of a continuation does not count"
/ip/firewall/filter
	add chain=forward   action=drop disabled=no
# ether1 feeds the PtP CPE
/interface ethernet
set [find default-name=ether1] poe-out=auto-on
set [ find where name="ether 2" disabled=no ] mtu=1500
set ether3,ether4 disabled=yes
set "ether 5" disabled=yes
remove [find]
/ip
firewall nat add chain=srcnat action=masquerade out-interface-list=WAN
/interface wifi set wifi1 configuration.country=Spain configuration.mode=ap !configuration.ssid
/system identity set name="coastal"
/ip dns cache
/ip dns cache flush max=1
/
import file-name=x.rsc
# nothing follows
