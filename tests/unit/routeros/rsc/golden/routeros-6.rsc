# mar/02/2026 09:14:07 by RouterOS 6.49.18
# software id = ABCD-1234
#
# model = RBSXTsqG-5acD
# serial number = EXAMPLE00002
/interface bridge
add ageing-time=5m arp=enabled arp-timeout=auto auto-mac=yes dhcp-snooping=no \
    disabled=no fast-forward=yes forward-delay=15s igmp-snooping=no \
    max-message-age=20s mtu=auto name=bridge1 priority=0x8000 protocol-mode=\
    rstp transmit-hold-count=6 vlan-filtering=no
/interface ethernet
set [ find default-name=ether1 ] advertise=\
    10M-half,10M-full,100M-half,100M-full,1000M-half,1000M-full arp=enabled \
    arp-timeout=auto auto-negotiation=yes !bandwidth disabled=no full-duplex=\
    yes l2mtu=1598 mac-address=02:00:00:00:00:05 mtu=1500 name=ether1 \
    orig-mac-address=02:00:00:00:00:05 rx-flow-control=off speed=100Mbps \
    tx-flow-control=off
/interface wireless
# managed by CAPsMAN
set [ find default-name=wlan1 ] basic-rates-a/g=6Mbps,12Mbps,24Mbps band=\
    5ghz-n/ac configuration.x=1 configuration.y=2 frequency=5180 \
    ht-supported-mcs="mcs-0,mcs-1,mcs-2,mcs-3,mcs-4,mcs-5,mcs-6,mcs-7,mcs-8,mc\
    s-9,mcs-10,mcs-11,mcs-12,mcs-13,mcs-14,mcs-15" mode=station-bridge ssid=\
    "ATLANTIS quay"
/interface wireless security-profiles
set [ find default=yes ] supplicant-identity=MikroTik
/ip neighbor discovery-settings
set discover-interface-list=!dynamic
/snmp
set enabled=no engine-id="" trap-community=public
