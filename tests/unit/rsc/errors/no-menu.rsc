add name=x
