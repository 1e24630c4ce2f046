/system identity
set name=$site
