/interface list
add name="WAN"comment=x
