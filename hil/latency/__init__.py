"""How long a set-point takes from who says it to the first motor frame on the bus that is made from it."""
