/interface wifi
set wifi1 .mode=ap
