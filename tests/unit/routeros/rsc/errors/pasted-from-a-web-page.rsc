/system identity
set name=quay comment=x
