/system note
set note=C:\temp
