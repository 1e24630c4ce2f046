# 2026-03-02 09:14:07 by RouterOS 7.18.2
# software id = ABCD-1234
#
# model = RB5009UPr+S+
# serial number = EXAMPLE00001
/interface bridge
add admin-mac=02:00:00:00:00:01 auto-mac=no comment=\
    "atlantis: LAN of the site" name=bridge-lan protocol-mode=none
/interface ethernet
# poe-out status: short_circuit
set [ find default-name=ether1 ] advertise=\
    10M-half,10M-full,100M-half,100M-full,1000M-half,1000M-full comment=\
    "PtP CPE"
set [ find default-name=ether2 ] comment="Satellite terminal, 24 V passive" \
    name=ether-sat poe-out=forced-on poe-priority=0
/interface wifi
set [ find default-name=wifi1 ] channel.band=5ghz-ax .skip-dfs-channels=\
    10min-cac .width=20mhz configuration.country=Spain .mode=ap .ssid=\
    "Muelle \C3\91" disabled=no mtu=1500 security=sec1 \
    security.authentication-types=wpa2-psk,wpa3-psk .ft=yes .ft-over-ds=yes
/interface list
add name=WAN
/interface wireless cap
/ip service
set telnet disabled=yes
set api-ssl certificate=atlantis-api tls-version=only-1.2
/ip firewall address-list
add address=198.51.100.10 comment="\D2\D2\CA" list=sat-allow
/ip firewall filter
add action=accept chain=input comment=\
    "atlantis: technicians' network, never locked out" in-interface=ether8 \
    src-address=192.168.88.0/24
add action=drop chain=forward comment=\
    "atlantis: only the allow-list over satellite" dst-address-list=\
    !sat-allow log=yes log-prefix="sat drop " out-interface=ether-sat
/ip route
add blackhole comment="canary ptp 1 stays off the next link" disabled=no \
    distance=254 dst-address=192.0.2.1/32 gateway="" routing-table=main \
    scope=30
/ppp profile
set *0 local-address=10.64.255.1
/routing bgp connection
add as=65000 disabled=no local.role=ebgp name=ship output.filter-chain=\
    bgp-out .network=bgp remote.address=192.0.2.2/32 .as=65001 routing-table=\
    main
/routing table
add comment="via satellite" disabled=no fib name=via-sat
/system identity
set name=coastal-router
/system logging action
set 0 memory-lines=300
/system script
add dont-require-permissions=no name=failback owner=provision policy=\
    ftp,reboot,read,write,policy,test,password,sniff,sensitive,romon source="#\
    \_comes back after ten minutes of good canaries\r\
    \n:local n 0\r\
    \n\r\
    \n:foreach r in=[/ip route find where comment~\"^canary\"] do={ :set n (\$\
    n + 1) }\r\
    \n:if (\$n > 1\?) do={ :log info \"\$n of two; this line is long enough th\
    at no line has room for it\" }\r\
    \n"
/tool mac-server
set allowed-interface-list=none
