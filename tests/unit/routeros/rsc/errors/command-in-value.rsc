/ip address
set [get 0 address] disabled=no
