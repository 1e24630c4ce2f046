/system identity
set name=“quay router”
